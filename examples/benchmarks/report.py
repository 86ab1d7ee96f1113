"""report.md from the records of a run."""

from __future__ import annotations

import os
import platform
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from figure import name, per_iteration, plot

PACKAGES = ("pkmsea", "casadi", "pin", "numpy", "rockit-meco")
COLUMNS = ("N", "optimal", "iterations", "s per solve", "ms per iteration", "evaluation", "IPOPT", "build s", "MB",
           "E true [J]", "claimed to true")  # fmt: skip

Record = dict[str, Any]


def machine() -> dict[str, Any]:
    """What the times depend on."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text(encoding="utf-8").splitlines() if info.exists() else []
    model = next((line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")), "")
    return {"processor": model or platform.processor(), "cores": os.cpu_count(), "system": platform.platform(),
            "python": platform.python_version(), **{name: _version(name) for name in PACKAGES}}  # fmt: skip


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def cells(result: Record) -> list[str]:
    """A table row of the starts' medians; the energy is the lowest true one of the optimal starts."""
    runs = result["runs"]
    optimal = [run for run in runs if run["outcome"] == "optimal" and run["energy"] is not None]
    share = median(run["evaluation_seconds"] / run["solver_seconds"] for run in runs)
    best = min(optimal or runs, key=lambda run: run["energy"] or np.inf)
    energy = best["energy"]
    return [
        f"{result['samples']}", f"{len(optimal)} of {len(runs)}", f"{median(run['iterations'] for run in runs):.0f}",
        f"{median(run['seconds'] for run in runs):.3g}", f"{1e3 * per_iteration(result):.3g}",
        f"{share:.0%}", f"{1 - share:.0%}", f"{result['build_seconds']:.2g}", f"{result['memory_MB']:.0f}",
        "-" if energy is None else f"{energy:.4f}", "-" if energy is None else f"{best['claimed'] / energy - 1:+.2%}",
    ]  # fmt: skip


def table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    head = list(header)
    return "\n".join(f"| {' | '.join(row)} |" for row in [head, ["---"] * len(head), *rows])


def baseline_rows(good: list[Record]) -> list[list[str]]:
    """Ours and the baselines on the same task; ratios are to ours."""
    rows, rivals = [], [case for case in good if case["group"] == "baselines"]
    for case in rivals:
        result = case["result"]
        own = next((c["result"] for c in rivals if c["kind"] == "flat" and c["table"] == case["table"]), None)
        ratios = ["-", "-"]
        if own is not None and own["samples"] == result["samples"]:
            theirs, ours = (median(run["seconds"] for run in r["runs"]) for r in (result, own))
            outcome = result["runs"][0]["outcome"]
            ratios = [f"{theirs / ours:.1f}" if outcome == "optimal" else outcome,
                      f"{per_iteration(result) / per_iteration(own):.1f}"]  # fmt: skip
        rows.append([name(case), str(case["table"]), *cells(result), *ratios])
    return rows


def neighbour_rows(good: list[Record]) -> list[list[str]]:
    found = [case["result"] for case in good if case["group"] == "neighbours"]
    return [[start, result[start]["outcome"], str(result[start]["iterations"]), f"{result[start]['seconds']:.3g}",
             f"{result[start]['claimed']:.5f}"] for result in found for start in ("cold", "warm")]  # fmt: skip


def write_report(results: Record, folder: Path) -> Path:
    """Write report.md and benchmark.png; returns the report's path."""
    good = [case for case in results["cases"] if "error" not in case["result"]]
    setups, grids = ([c for c in good if c["group"] == group] for group in ("setups", "grid"))
    parts = ["# Benchmark", ", ".join(f"{key} {value}" for key, value in results["machine"].items() if value)]
    parts += ["Medians over the starts. A solve is one start to full sharpness, on a transcription that is built "
              "('build s'). 'IPOPT' is its time beside function evaluation: linear algebra, mostly.",
              "## Setups of the paper",
              table(("setup", "table", *COLUMNS), ([c["setup"], str(c["table"]), *cells(c["result"])] for c in setups)),
              "## Grid: PKM SEA of table 3", table(COLUMNS, (cells(c["result"]) for c in grids))]  # fmt: skip
    if (exponent := plot(good, folder / "benchmark.png")) is not None:
        parts += [
            f"Time per iteration on the finest grids grows as $N^{{{exponent:.2f}}}$.",
            "![Time per iteration](benchmark.png)",
        ]
    parts += ["## Fixed stiffness, 5 % off a solved neighbour",
              table(("start", "outcome", "iterations", "s", "E claimed [J]"), neighbour_rows(good)),
              "## Baselines on PKM SEA", table(("formulation", "table", *COLUMNS, "x ours, solve", "x ours, iteration"),
                                               baseline_rows(good))]  # fmt: skip
    errors = [f"- {case['kind']} {case['setup']} table {case['table']}: {case['result']['error']}"
              for case in results["cases"] if "error" in case["result"]]  # fmt: skip
    parts += ["## Not measured", "\n".join(errors)] if errors else []
    path = folder / "report.md"
    path.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return path
