"""Energy of a sampled or searched study against each parameter, and how a search went on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pkmsea.study import StudyResult
from pkmsea.study.answers import Axis, Part, parts_of
from pkmsea.study.study import Search
from pkmsea.study.table import VERIFIED
from pkmsea.views.study_panels import colored, energy_scale, put
from pkmsea.views.sweep import FAILED_AT

COLUMNS = 3
WIDTH, HEIGHT = 4.2, 3.5  # of a panel [in]


def scatter(result: StudyResult, axes: Sequence[Axis]) -> Figure:
    """Per case, a panel per parameter with the energies of all points, the best marked; and the history of a search."""
    study, parts = result.study, parts_of(result)
    history = isinstance(study.sample, Search)
    count = len(axes) + history
    lines = math.ceil(count / COLUMNS)
    columns = math.ceil(count / lines)
    figure = Figure(figsize=(WIDTH * columns, (HEIGHT * lines + 0.7) * len(study.cases) + 0.4), layout="constrained")
    figures: Any = figure.subfigures(len(study.cases), 1, squeeze=False)[:, 0]
    for inner, case in zip(figures, study.cases, strict=True):
        of_case = [part for part in parts if part.case == case]
        panels = inner.subplots(lines, columns, squeeze=False, sharey=True).ravel()
        for panel, axis in zip(panels, axes, strict=False):
            _energies(panel, of_case, axis)
        if history:
            _history(panels[len(axes)], of_case)
        for panel in panels[count:]:
            panel.remove()
        energy_scale(panels[0], of_case)
        handles, names = panels[0].get_legend_handles_labels()
        inner.legend(handles, names, loc="outside lower center", ncols=4, fontsize=8, frameon=False)
        if len(study.cases) > 1:
            inner.suptitle(case, fontsize=11)
    figure.suptitle(study.name, fontsize=13)
    return figure


def _energies(panel: Any, parts: Sequence[Part], axis: Axis) -> None:
    for color, part in colored(parts):
        verified = part.having(VERIFIED)
        panel.plot(verified[axis.name], verified["energy"], "o", color=color, ms=4.5, alpha=0.8, label=part.setup)
        if len(part.unverified):
            x, y = part.unverified[axis.name], part.unverified["energy"]
            panel.plot(x, y, "o", color=color, mfc="none", ms=4.5, label=f"{part.setup}: not verified")
        if len(part.failed):
            x = part.failed[axis.name]
            height = np.full(len(x), FAILED_AT)
            across = panel.get_xaxis_transform()
            panel.plot(x, height, "x", color=color, ms=6, transform=across, label=f"{part.setup}: failed")
        if best := part.best():
            name = f"{part.setup}: best, {best['energy']:.4g} J"
            panel.plot(best[axis.name], best["energy"], "*", color=color, mec="k", mew=0.8, ms=14, label=name)
            panel.axvline(best[axis.name], color=color, lw=0.8, ls=":")
    put(axis, panel, "x")
    _finish(panel)


def _history(panel: Any, parts: Sequence[Part]) -> None:
    """Energy of every trial in their order, and the least verified one so far."""
    for color, part in colored(parts):
        trials = part.rows.sort_values("point")
        number, verified = trials["point"] + 1, trials["status"] == VERIFIED
        for chosen, face in ((verified, color), (~verified, "none")):
            panel.plot(number[chosen], trials["energy"][chosen], "o", color=color, mfc=face, ms=4, alpha=0.6)
        least = trials["energy"].where(verified).cummin().ffill()
        panel.plot(number, least, drawstyle="steps-post", color=color, lw=1.6)
    panel.set(xlabel="trial; the line is the best so far")
    _finish(panel)


def _finish(panel: Any) -> None:
    panel.grid(alpha=0.3)
    if panel.get_subplotspec().is_first_col():
        panel.set_ylabel("E [J]")
