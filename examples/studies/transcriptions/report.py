"""The runs as a table and as a figure."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from cases import Run
from matplotlib.figure import Figure

MARKERS, COLORS = "osv^Dx", ("#1f77b4", "#d1495b", "#e08e2b", "#3a9d5d", "#8e6bbf", "#444444")
TRUTH = 0.005  # gap that pkmsea accepts
LEAST, MOST = 1e-5, 1e3  # gaps beyond are drawn on the border


def write_csv(runs: Sequence[Run], file: Path) -> None:
    """One line per run."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, [*asdict(runs[0]), "gap"])
        writer.writeheader()
        for run in runs:
            writer.writerow(asdict(run) | {"gap": f"{run.gap:.6f}"})


def cases(runs: Sequence[Run]) -> list[tuple[float, str]]:
    """The cases that were run, in their order."""
    return list(dict.fromkeys((run.kappa, run.drives) for run in runs))


def table(runs: Sequence[Run], titles: dict[str, str]) -> str:
    """Per case and scheme, claimed / true energy at each size as Markdown."""
    sizes = sorted({run.size for run in runs})
    lines = [
        "| case | scheme | " + " | ".join(f"N = {size}" for size in sizes) + " |",
        "|---|---|" + "---|" * len(sizes),
    ]
    for kappa, drives in cases(runs):
        name = f"κ = {kappa:g}, {drives}"
        for scheme, title in titles.items():
            found = {r.size: r for r in runs if (r.kappa, r.drives, r.scheme) == (kappa, drives, scheme)}
            lines.append(f"| {name} | {title} | " + " | ".join(cell(found[size]) for size in sizes) + " |")
            name = ""
    return "\n".join(lines) + "\n"


def cell(run: Run) -> str:
    """Claimed / true [mJ]; bold where they agree and the solve converged, starred where it did not converge."""
    text = f"{_millijoules(run.claimed)} / {_millijoules(run.true)}"
    if run.outcome != "optimal":
        return f"{text} *"
    return f"**{text}**" if abs(run.gap) <= TRUTH else text


def _millijoules(energy: float) -> str:
    value = 1e3 * energy
    return "-" if not np.isfinite(value) else f"{value:.1f}" if value < 1e4 else f"{value:.0e}"


def figure(runs: Sequence[Run], titles: dict[str, str]) -> Figure:
    """Gap between claim and truth over the number of points, one panel per case; open markers did not converge."""
    shown = cases(runs)
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    drawn = Figure(figsize=(4.2 * columns, 3.4 * rows + 0.9), layout="constrained")
    panels = drawn.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes, (kappa, drives) in zip(panels.ravel(), shown, strict=False):
        axes.axhspan(LEAST / 2, TRUTH, color="#3a9d5d", alpha=0.12, lw=0)
        for (scheme, title), marker, color in zip(titles.items(), MARKERS, COLORS, strict=False):
            found = [r for r in runs if (r.kappa, r.drives, r.scheme) == (kappa, drives, scheme)]
            gaps = np.clip([abs(r.gap) if np.isfinite(r.gap) else MOST for r in found], LEAST, MOST)
            points = np.array([r.points for r in found])
            axes.plot(points, gaps, color=color, lw=1.2, label=title)
            for x, y, r in zip(points, gaps, found, strict=True):
                done = r.outcome == "optimal"
                axes.plot(x, y, marker, color=color, mfc=color if done else "white", ms=6)
        axes.set_title(f"κ = {kappa:g} W/(N m)², {drives}", fontsize=10)
        axes.set(xscale="log", yscale="log", ylim=(LEAST / 2, MOST * 2))
        axes.grid(alpha=0.3)
    for axes in panels[-1]:
        axes.set_xlabel("evaluations of the cost per period")
    for axes in panels[:, 0]:
        axes.set_ylabel("|claimed / true − 1|")
    handles, labels = panels[0, 0].get_legend_handles_labels()
    drawn.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    return drawn
