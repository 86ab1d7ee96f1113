"""benchmark.png: time per iteration against the grid."""

from __future__ import annotations

from pathlib import Path
from statistics import median
from typing import Any

import matplotlib
import numpy as np

matplotlib.use("Agg")
import matplotlib.pyplot as plt

FITTED = 4  # finest grids that the power law is fitted to; on coarse ones the overhead of an iteration rules

NAMES = {"flat": "pkmsea", "paper": "paper's transcription"}

Record = dict[str, Any]


def name(case: Record) -> str:
    """How a case is called in the tables."""
    return f"rockit, {case['formulation']}" if case["kind"] == "rockit" else NAMES[case["kind"]]


def per_iteration(result: Record) -> float:
    """Median of the starts' seconds per iteration."""
    return median(run["solver_seconds"] / max(run["iterations"], 1) for run in result["runs"])


def plot(good: list[Record], path: Path) -> float | None:
    """Time per iteration against N; the exponent of the law fitted to the finest grids, None for fewer than two."""
    grid = [(c["result"]["samples"], 1e3 * per_iteration(c["result"])) for c in good if c["group"] == "grid"]
    if len(grid) < 2:
        return None
    N, ms = np.array(grid).T
    fine = N[-FITTED:]
    slope, offset = np.polyfit(np.log(fine), np.log(ms[-FITTED:]), 1)
    figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
    axes.loglog(N, ms, "o", color="C0", label="pkmsea")
    axes.loglog(fine, np.exp(offset) * fine**slope, color="C0", lw=1, label=f"$N^{{{slope:.2f}}}$")
    for i, case in enumerate(c for c in good if c["group"] == "baselines" and c["kind"] != "flat" and c["table"] == 3):
        axes.loglog(case["result"]["samples"], 1e3 * per_iteration(case["result"]), "s^v"[i % 3], color=f"C{i + 1}",
                    label=name(case))  # fmt: skip
    axes.set(xlabel="grid points N", ylabel="time per iteration [ms]", title="PKM SEA, friction, stiffness optimised")
    axes.set_xticks(N, [f"{n:.0f}" for n in N], minor=False)
    axes.minorticks_off()
    axes.grid(True, which="major", alpha=0.3)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)
    plt.close(figure)
    return float(slope)
