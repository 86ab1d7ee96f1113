"""gallery.png: every mechanism with its paths and its energies."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pinocchio as pin

import pkmsea

matplotlib.use("Agg")
import matplotlib.pyplot as plt

COLUMNS = 4
PATH_STEP = 10  # of the dense grid's 4000 instants or more
COLORS = {"rigid": "#444444", "SEA": "#d1495b", "PEA": "#1f77b4", "SEA and PEA": "#8e6bbf"}
OTHER = "#e08e2b"
KEY = """squares: fixed joints
dark, light: the mechanism in its
operating points

coloured: path of the end effector,
position over time where it has one axis

bars: electrical energy per cycle,
relative to rigid drives

SEA: springs in series
PEA: springs in parallel"""
EYE = np.radians((-50.0, 25.0))  # azimuth and elevation from which spatial mechanisms are seen


def draw(solved: list[list[pkmsea.Solution]], path: Path) -> None:
    """Mechanism and path above, energies below, for every task."""
    rows = -(-(len(solved) + 1) // COLUMNS)
    figure = plt.figure(figsize=(3.6 * COLUMNS, 4.4 * rows), layout="constrained")
    *cells, last = figure.subfigures(rows, COLUMNS).ravel()
    for cell, solutions in zip(cells, solved, strict=False):
        above, below = cell.subplots(2, 1, height_ratios=(3, 1))
        cell.suptitle(solutions[0].problem.title, fontsize=12)
        sketch(above, solutions)
        bars(below, solutions)
    last.text(0.08, 0.55, KEY, fontsize=11, va="center")
    figure.savefig(path, dpi=80)


def sketch(axes: Any, solutions: list[pkmsea.Solution]) -> None:
    """The links as lines in the operating points, and the paths of all setups."""
    mechanism = solutions[0].problem.actuation.mechanism
    view = projection(mechanism.description.end_effector.axes)
    series, times = solutions[0].series, solutions[0].problem.cycle.times
    for time, color in zip(times, ("0.25", "0.75"), strict=False):
        for line in links(mechanism, series.q[np.abs(series.t - time).argmin()]):
            axes.plot(*(view @ line.T), "-o", color=color, lw=3, ms=4, solid_capstyle="round", zorder=-float(color))
    fixed = [
        mechanism.model.jointPlacements[i].translation for i, p in enumerate(mechanism.model.parents) if i and not p
    ]
    axes.plot(*(view @ np.array(fixed).T), "s", color="k", ms=8)
    over_time = axes.inset_axes((0, 0.68, 0.36, 0.3), xticks=[], yticks=[]) if mechanism.mobility == 1 else None
    for solution in solutions:
        color = COLORS.get(solution.name, OTHER)
        if over_time:
            over_time.plot(solution.series.t, solution.series.r_E, color=color, lw=1.2)
        else:
            path = np.array([tip(mechanism, q) for q in solution.series.q[::PATH_STEP]])
            axes.plot(*(view @ path.T), color=color, lw=1.6, zorder=2)
    axes.set_aspect("equal", adjustable="datalim")
    axes.axis("off")


def projection(followed: tuple[str, ...]) -> np.ndarray:
    """World to picture (2, 3): the plane of the motion, or a view from `EYE`."""
    if len(followed) < 3:
        return np.eye(3)[[0, 1 if "y" in followed else 2]]
    (c, s), (ce, se) = ((np.cos(angle), np.sin(angle)) for angle in EYE)
    return np.array([[-s, c, 0], [-se * c, -se * s, ce]])


def tip(mechanism: pkmsea.Mechanism, q: np.ndarray) -> np.ndarray:
    return np.array(mechanism.tree.placement[mechanism.description.end_effector.frame](q))[:3, 3]


def links(mechanism: pkmsea.Mechanism, q: np.ndarray) -> list[np.ndarray]:
    """Lines (2, 3): from each joint to the joints and named frames on its link; along the stroke of a sliding joint."""
    model, description = mechanism.model, mechanism.description
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    origin = [placement.translation for placement in data.oMi]
    root = [model.jointPlacements[i].translation for i in range(model.njoints)]
    lines = [(origin[model.parents[i]] if model.parents[i] else root[i], origin[i]) for i in range(1, model.njoints)]
    named = {description.end_effector.frame, *(name for closure in description.closures for name in closure.frames)}
    for frame in (model.frames[model.getFrameId(name)] for name in named):
        lines.append((origin[frame.parentJoint], data.oMi[frame.parentJoint].act(frame.placement.translation)))
    return [np.array(line) for line in lines]


def bars(axes: Any, solutions: list[pkmsea.Solution]) -> None:
    """Energy per cycle of every setup."""
    names, rigid = [s.name for s in solutions], solutions[0].energy
    drawn = axes.barh(names, [s.energy / rigid for s in solutions], color=[COLORS.get(n, OTHER) for n in names])
    labels = [f"{s.energy:.3g} J" if s is solutions[0] else f"{s.energy / rigid:.1%}" for s in solutions]
    axes.bar_label(drawn, labels, padding=3)
    axes.set(xlim=(0, 1.3), xticks=[])
    axes.invert_yaxis()
    axes.spines[["top", "right", "bottom"]].set_visible(False)
