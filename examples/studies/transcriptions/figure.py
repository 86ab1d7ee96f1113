"""The runs as a figure."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from cases import Run
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from report import TINY, TRUTH, cases

MARKERS, COLORS = "osv^DX", ("#1f77b4", "#d1495b", "#e08e2b", "#3a9d5d", "#8e6bbf", "#444444")
GAPS, EXCESS = (1e-5, 1e3), (1e-4, 1e1)  # what the panels show
TICKS = (50, 100, 200, 400, 800, 1600)


def figure(runs: Sequence[Run], titles: dict[str, str]) -> Figure:
    """Per case: claim against truth above, true energy against the case's best below, over the size of the grid."""
    shown = cases(runs)
    columns = min(3, len(shown))
    rows = -(-len(shown) // columns)
    drawn = Figure(figsize=(max(4.3 * columns, 9), 5.6 * rows + 0.8), layout="constrained")
    panels = drawn.subplots(2 * rows, columns, sharex=True, sharey="row", squeeze=False)
    for i, (kappa, drives) in enumerate(shown):
        above, below = panels[2 * (i // columns) : 2 * (i // columns) + 2, i % columns]
        case = [run for run in runs if (run.kappa, run.drives) == (kappa, drives)]
        best = min(run.true for run in case if np.isfinite(run.true))
        for scheme, marker, color in zip(titles, MARKERS, COLORS, strict=False):
            found = [run for run in case if run.scheme == scheme]
            draw(above, found, [abs(run.true / max(run.claimed, TINY) - 1) for run in found], GAPS, marker, color)
            draw(below, found, [run.true / best - 1 for run in found], EXCESS, marker, color)
        above.axhspan(GAPS[0] / 2, TRUTH, color=COLORS[3], alpha=0.12, lw=0)
        above.set_title(f"κ = {kappa:g} W/(N m)², {drives}", fontsize=10)
        if i % columns == 0:
            above.set_ylabel("|true / claimed − 1|")
            below.set_ylabel("true / best true − 1")
    for axes in panels[-1]:
        axes.set_xlabel("evaluations of the cost per period")
    handles = [
        Line2D([], [], color=color, marker=marker, mew=1.5, label=title)
        for title, marker, color in zip(titles.values(), MARKERS, COLORS, strict=False)
    ]
    drawn.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=9, frameon=False)
    return drawn


def draw(axes: Any, found: Sequence[Run], values: Sequence[float], span: tuple[float, float], marker: str, color: str):
    """One scheme in one panel; open markers did not converge, values beyond the span are drawn on its border."""
    at = [run.points for run in found]
    clipped = np.clip(np.nan_to_num(values, nan=span[1]), *span)
    axes.plot(at, clipped, color=color, lw=1.2)
    for x, y, run in zip(at, clipped, found, strict=True):
        axes.plot(x, y, marker, color=color, mfc=color if run.outcome == "optimal" else "white", ms=6, mew=1.5)
    axes.set(xscale="log", yscale="log", ylim=(span[0] / 2, span[1] * 2), xlim=(TICKS[0] * 0.85, TICKS[-1] * 1.18))
    axes.set_xticks(TICKS, [str(tick) for tick in TICKS])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
