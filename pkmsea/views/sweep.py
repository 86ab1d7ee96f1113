"""Energy over one parameter of a study: all setups, what the first one needs more or less, and the springs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pkmsea.actuation.drive import Range
from pkmsea.study import Study, StudyResult
from pkmsea.study.answers import Axis, Part, parts_of
from pkmsea.study.table import VERIFIED
from pkmsea.views.figures import COLORS, DRIVE_STYLES
from pkmsea.views.study_panels import colored, energy_scale, logarithmic, put

WIDTH, HEIGHT = 5.2, 3.3  # of a panel [in]
RELATIVE = "E/E"  # column; no varied parameter can be called so
FAILED_AT = 0.03  # height of the crosses of failed points in a panel


@dataclass(frozen=True)
class Crossing:
    """Where the ratio to the first setup passes 1; `pays` if it falls below."""

    at: float
    pays: bool
    verified: bool

    def label(self, setup: str, axis: Axis) -> str:
        doubt = "" if self.verified else " (not verified)"
        return f"{setup} pays {'from' if self.pays else 'up to'} {axis.value(self.at)}{doubt}"


def sweep(result: StudyResult, axis: Axis) -> Figure:
    """A column per case: energy, energy relative to the first setup with its crossings at 1, and optimal stiffness."""
    study, parts = result.study, parts_of(result)
    heights = [1.3] + [1.0] * (len(study.names) > 1) + [1.0] * any(_springs(part, study, axis) for part in parts)
    figure = Figure(figsize=(WIDTH * len(study.cases), HEIGHT * sum(heights) + 0.6), layout="constrained")
    grid = figure.subplots(
        len(heights), len(study.cases), squeeze=False, sharex=True, sharey="row", height_ratios=heights
    )
    for column, case in zip(grid.T, study.cases, strict=True):
        of_case = [part for part in parts if part.case == case]
        panels = iter(column)
        _energies(next(panels), of_case, axis)
        if len(study.names) > 1:
            _ratios(next(panels), of_case, axis)
        for panel in panels:
            _stiffness(panel, of_case, study, axis)
        column[0].set_title(case if len(study.cases) > 1 else "")
        put(axis, column[-1], "x")
    energy_scale(grid[0, 0], parts)
    figure.suptitle(study.name, fontsize=13)
    return figure


def _energies(panel: Any, parts: Sequence[Part], axis: Axis) -> None:
    """Energy of every setup; failed points are crosses at the bottom, where the line has a gap."""
    for color, part in colored(parts):
        _line(panel, part.rows, axis, "energy", color, part.setup)
        x = part.failed[axis.name]
        panel.plot(
            x, np.full(len(x), FAILED_AT), "x", color=color, ms=6, label=f"{part.setup}: failed" if len(x) else None,
            transform=panel.get_xaxis_transform(),
        )  # fmt: skip
        _optima(panel, part, axis, color)
    if any(len(part.unverified) for part in parts):
        panel.plot([], [], "o", color="k", mfc="white", ms=5, label="not verified")
    panel.set_ylabel("E [J]")
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8)


def _optima(panel: Any, part: Part, axis: Axis, color: str) -> None:
    marks = part.marks([axis])
    for chosen, name, marker, size in (
        (marks[:1], "co-optimised", "*", 13),
        (marks[1:], "its other local optima", "D", 5),
    ):
        if chosen:
            energy = f", {chosen[0].energy:#.4g} J" if chosen[0].best else ""
            panel.plot(
                [mark.at[0] for mark in chosen], [mark.energy for mark in chosen], marker, ms=size, color=color,
                mec="k", mew=0.7, zorder=3, label=f"{part.setup}: {name}{energy}",
            )  # fmt: skip


def _line(panel: Any, rows: Any, axis: Axis, column: str, color: str, label: str | None, style: str = "-") -> None:
    """A line with gaps, full circles on it, and hollow ones where a point is not verified."""
    rows = rows.sort_values(axis.name)
    verified = rows["status"] == VERIFIED
    panel.plot(rows[axis.name], rows[column], style, color=color, lw=1.4, label=label)
    for chosen, face in ((rows[verified], color), (rows[~verified], "white")):
        panel.plot(chosen[axis.name], chosen[column], "o", color=color, mfc=face, ms=4.5)


def _ratios(panel: Any, parts: Sequence[Part], axis: Axis) -> None:
    """Energy relative to the first setup; where it passes 1, the setup begins or ceases to pay."""
    panel.axhline(1.0, color=COLORS[0], lw=1.2)
    for color, part in colored(parts)[1:]:
        rows = relative(parts[0], part, axis)
        _line(panel, rows, axis, RELATIVE, color, None)
        for crossing in crossings(rows, axis):
            panel.axvline(crossing.at, color=color, lw=1, ls=":")
            panel.plot(crossing.at, 1.0, "D", color=color, mec="k", ms=6, label=crossing.label(part.setup, axis))
    panel.set(ylabel=f"E / E of {parts[0].setup}")
    panel.grid(alpha=0.3)
    if panel.get_legend_handles_labels()[1]:
        panel.legend(fontsize=8)


def relative(first: Part, other: Part, axis: Axis) -> Any:
    """The other setup's points with RELATIVE, its energy over the first one's; NaN where one of them failed. A ratio is
    verified if both energies are."""
    both = other.rows.merge(first.rows[["point", "energy", "status"]], on="point", suffixes=("", "_first"))
    doubtful = (both["status"] == VERIFIED) & (both["status_first"] != VERIFIED)
    status = both["status"].mask(doubtful, both["status_first"])
    return both.assign(**{RELATIVE: both["energy"] / both["energy_first"], "status": status}).sort_values(axis.name)


def crossings(rows: Any, axis: Axis) -> list[Crossing]:
    """Where RELATIVE passes 1 between neighbouring points that are both solved, by linear interpolation over the even
    coordinate of the axis."""
    found = []
    x, above = axis.even(rows[axis.name]), rows[RELATIVE].to_numpy(float) - 1.0
    sure = (rows["status"] == VERIFIED).to_numpy()
    for i, j in pairwise(range(len(x))):
        if np.isfinite(above[[i, j]]).all() and (above[i] > 0) != (above[j] > 0):
            at = x[i] + (x[j] - x[i]) * above[i] / (above[i] - above[j])
            at = float(np.exp(at)) if axis.logarithmic else float(at)
            found.append(Crossing(at, bool(above[j] <= 0), bool(sure[i] and sure[j])))
    return found


def _springs(part: Part, study: Study, axis: Axis) -> list[str]:
    """Stiffness columns of a setup that its task leaves to the optimiser and the study does not vary."""
    drives = study.base.setup(part.setup).drives
    drives = drives * len(part.springs) if len(drives) == 1 else drives
    free = [name for name in part.springs if isinstance(drives[int(name[2:]) - 1].stiffness, Range)]
    varied = part.spring_of(axis.name) if len(part.solved) else None
    return [name for name in free if varied is None or name != part.springs[varied]]


def _stiffness(panel: Any, parts: Sequence[Part], study: Study, axis: Axis) -> None:
    for color, part in colored(parts):
        for style, name in zip(DRIVE_STYLES, _springs(part, study, axis), strict=False):
            _line(panel, part.rows, axis, name, color, f"{part.setup}: {name}", style)
    panel.set_ylabel("optimal stiffness\n[N m/rad, N/m]")
    logarithmic(panel, "y")
    panel.grid(alpha=0.3)
    panel.legend(fontsize=8)
