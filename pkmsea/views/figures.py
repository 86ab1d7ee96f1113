"""Figures of solutions: one overview of all setups side by side, as in the paper."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from scipy.ndimage import gaussian_filter

from pkmsea.actuation.cost import positive
from pkmsea.errors import InputError
from pkmsea.files import write_whole
from pkmsea.mechanism.workspace import workspace
from pkmsea.solution import Solution

COLORS = ("#444444", "#1f77b4", "#d1495b", "#3a9d5d", "#8e6bbf", "#e08e2b")
DRIVE_STYLES = ("-", "--", ":", "-.")
FORCES = {"rad": "N m", "m": "N"}  # by the unit of a position
FORMATS = (".png", ".pdf", ".svg")
NEAR_SINGULAR = 0.02  # reciprocal condition number that is drawn for redundant drives, which rarely reach zero


@matplotlib.rc_context({"text.parse_math": False})  # names may have a dollar sign
def overview(solutions: Sequence[Solution], failed: Sequence[str] = ()) -> Figure:
    """Path, cumulated energy and power of all setups above; positions and torques of each setup below.

    Energies are in J, times in s; where a result is not verified its legend entries and titles say so. Setups that
    failed are named in the title.
    """
    columns = max(3, len(solutions))
    figure = Figure(figsize=(3.9 * columns, 10.4), layout="constrained")
    rows: Any = figure.subfigures(3, 1, height_ratios=(1.3, 1, 1))
    above, middle, below = rows
    for axes, draw in zip(above.subplots(1, 3), (path_panel, energy_panel, power_panel), strict=True):
        draw(axes, solutions)
    for axes, solution in zip(middle.subplots(1, len(solutions), squeeze=False)[0], solutions, strict=True):
        position_panel(axes, solution)
    torques = below.subplots(1, len(solutions), squeeze=False, sharey=_same_unit(solutions))[0]
    for axes, solution in zip(torques, solutions, strict=True):
        torque_panel(axes, solution)
    first = solutions[0].problem
    missing = f"\nno result: {', '.join(failed)}" if failed else ""
    figure.suptitle(
        f"{first.title}: {first.cost.label}-optimal cycles of {first.cycle.period:g} s{missing}", fontsize=13
    )
    return figure


def _same_unit(solutions: Sequence[Solution]) -> bool:
    mechanisms = [solution.problem.mechanism for solution in solutions]
    return len({mechanism.units[i] for mechanism in mechanisms for i in mechanism.actuated}) == 1


def path_panel(axes: Any, solutions: Sequence[Solution]) -> None:
    """End-effector paths in the workspace with its border and singular curves; against time for one axis."""
    problem = solutions[0].problem
    if len(problem.span) != 2:
        _axis_over_time(axes, solutions)
        return
    drawn: set[str] = set()
    for solution in solutions:
        mechanism = solution.problem.actuation.mechanism
        key = str(mechanism.folder)
        if key not in drawn:
            _draw_workspace(axes, mechanism, faint=bool(drawn))
            drawn.add(key)
    for color, solution in zip(COLORS, solutions, strict=False):
        r_E = np.vstack([solution.series.r_E, solution.series.r_E[:1]])
        axes.plot(*r_E.T, color=color, label=solution.label, lw=1.4)
    for point in problem.cycle.points:
        axes.plot(*point.at, "ks", ms=4)
    horizontal, vertical = coordinates(solutions[0])
    axes.set(xlabel=horizontal, ylabel=vertical, title="End-effector path", aspect="equal")
    axes.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=len(solutions), frameon=False)


def coordinates(solution: Solution) -> list[str]:
    """Names of r_E's coordinates with their units: 'x_E [m]', or a joint's own name."""
    mechanism = solution.problem.mechanism
    follower = mechanism.description.end_effector
    names = follower.joints or [f"{axis}_E" for axis in follower.axes]
    return [f"{name} [{unit}]" for name, unit in zip(names, mechanism.end_effector_units, strict=True)]


def _axis_over_time(axes: Any, solutions: Sequence[Solution]) -> None:
    problem = solutions[0].problem
    for color, solution in zip(COLORS, solutions, strict=False):
        for axis, style in zip(range(len(problem.span)), DRIVE_STYLES, strict=False):
            name = solution.label if axis == 0 else None
            axes.plot(solution.series.t, solution.series.r_E[:, axis], style, color=color, label=name, lw=1.4)
    period = problem.cycle.period
    for w in problem.cycle.windows:
        for shift in (-period, 0.0, period):
            start, end = max(w.start + shift, 0.0), min(w.end + shift, period)
            if end >= start:
                corner = (start, w.at - w.deviation)
                axes.add_patch(Rectangle(corner, end - start, 2 * w.deviation, color="k", lw=2))
    followed = ", ".join(coordinates(solutions[0]))
    axes.set(xlabel="t [s]", ylabel=followed, title="End-effector position; rest windows in black")
    axes.legend(fontsize=8)


def _draw_workspace(axes: Any, mechanism: Any, faint: bool) -> None:
    space = workspace(mechanism)
    smooth = gaussian_filter(space.reachable.astype(float), 1.0)
    strength = 0.35 if faint else 1.0
    if not faint:
        axes.contourf(space.x, space.y, smooth, levels=[0.5, 1.5], colors=["#f1f3f6"])
    axes.contour(space.x, space.y, smooth, levels=[0.5], colors="k", linewidths=1.2, alpha=strength)
    redundant = len(mechanism.actuated) > mechanism.mobility
    level = NEAR_SINGULAR if redundant else 0.0
    finite = space.direct[np.isfinite(space.direct)]
    if finite.size and finite.min() < level < finite.max():
        contour = axes.contour(space.x, space.y, space.direct, levels=[level], colors="#c0392b", linewidths=1.0)
        contour.set(linestyle="dotted" if redundant else "dashed")


def energy_panel(axes: Any, solutions: Sequence[Solution]) -> None:
    """Cumulated electrical energy."""
    for color, solution in zip(COLORS, solutions, strict=False):
        s = solution.series
        drawn = np.cumsum(positive(s.power)) * solution.problem.cycle.period / s.t.size
        axes.plot(s.t, drawn, color=color, label=f"{solution.label}  {solution.cost.show(solution.value)}", lw=1.4)
    axes.set(xlabel="t [s]", ylabel="E_el [J]", title="Cumulated energy")
    axes.legend(fontsize=8)


def power_panel(axes: Any, solutions: Sequence[Solution]) -> None:
    """Electrical power on the bus; what is below zero is burnt."""
    for color, solution in zip(COLORS, solutions, strict=False):
        axes.plot(solution.series.t, solution.series.power, color=color, label=solution.label, lw=1.1)
    axes.axhline(0, color="k", lw=0.6)
    axes.set(xlabel="t [s]", ylabel="P_el [W]", title="Power on the bus")


def position_panel(axes: Any, solution: Solution) -> None:
    """Joint (solid) and motor (dashed) position of each drive."""
    s, actuation = solution.series, solution.problem.actuation
    for i, label in enumerate(actuation.labels):
        color = COLORS[1 + i % (len(COLORS) - 1)]
        axes.plot(s.t, s.q[:, actuation.mechanism.actuated[i]], color=color, label=f"{label} joint", lw=1.3)
        if i in solution.motion.springs:
            axes.plot(s.t, s.q_M[:, i], "--", color=color, label=f"{label} motor", lw=1.1)
    unit = ", ".join(dict.fromkeys(actuation.mechanism.units[i] for i in actuation.mechanism.actuated))
    axes.set(xlabel="t [s]", ylabel=f"q_A, q_M [{unit}]", title=f"{solution.label}: positions")
    axes.legend(fontsize=7, ncols=2)


def torque_panel(axes: Any, solution: Solution) -> None:
    """Motor torque of each drive."""
    s, actuation = solution.series, solution.problem.actuation
    for i, label in enumerate(actuation.labels):
        axes.plot(s.t, s.tau[:, i], color=COLORS[1 + i % (len(COLORS) - 1)], label=label, lw=1.2)
    unit = ", ".join(dict.fromkeys(FORCES[actuation.mechanism.units[i]] for i in actuation.mechanism.actuated))
    axes.axhline(0, color="k", lw=0.6)
    axes.set(xlabel="t [s]", ylabel=f"tau [{unit}]", title=f"{solution.label}: motor torque")
    axes.legend(fontsize=7, ncols=3)


def save_figure(figure: Figure, path: Path) -> Path:
    """Write a figure whole or not at all; the suffix tells the format."""
    if path.suffix not in FORMATS:
        raise InputError(
            f"Figures are not written as '{path.suffix}'.", f"Use one of: {', '.join(FORMATS)}.", file=path
        )
    with matplotlib.rc_context({"svg.fonttype": "none"}):
        write_whole(path, lambda temporary: figure.savefig(temporary, format=path.suffix[1:], dpi=150))
    return path
