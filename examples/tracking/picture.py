"""tracking.png: paths, errors, torque and power of the wrong plant under the three laws."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from plant import Run

import pkmsea

matplotlib.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.patches import Rectangle

COLORS = ("#d1495b", "#e08e2b", "#1f77b4")
PLAN = {"color": "0.15", "lw": 1.2, "ls": "--", "label": "plan"}
ON_PLANT = {"color": "0.5", "lw": 1.2, "ls": ":", "label": "planned path, on this plant"}
MARGIN = 0.03  # around the planned path [m]; what leaves it is cut
SMALLEST = 0.1  # error that is drawn [mm]


def draw(solution: pkmsea.Solution, plant: pkmsea.Solution, runs: dict[str, Run], path: Path) -> None:
    """Four panels; `runs` on the plant by the law's name."""
    figure, panels = plt.subplots(2, 2, figsize=(11.5, 8.5), width_ratios=(1, 1.25), layout="constrained")
    for (name, run), color in zip(runs.items(), COLORS, strict=True):
        style = {"color": color, "lw": 1.3, "label": name}
        panels[0, 0].plot(*run.r_E.T, **style)
        panels[0, 1].semilogy(run.t, 1e3 * run.error, **style)
        last = run.t >= run.t[-1] - solution.problem.cycle.period + run.step / 2
        since = run.t[last] - run.t[last][0]
        panels[1, 0].plot(since, run.tau[last, 0], **style)
        panels[1, 1].plot(since, np.cumsum(np.maximum(run.power[last], 0)) * run.step, **style)
    path_panel(panels[0, 0], solution)
    error_panel(panels[0, 1], solution, max(run.t[-1] + run.step for run in runs.values()))
    for s, style in ((solution.series, PLAN), (plant.series, ON_PLANT)):
        panels[1, 0].plot(s.t, s.tau[:, 0], **style)
        panels[1, 1].plot(s.t, np.cumsum(np.maximum(s.power, 0)) * s.t[1], **style)
    panels[1, 0].set(title="Torque of drive A, last cycle", xlabel="t [s]", ylabel="torque [N m]")
    panels[1, 1].set(title="Energy drawn, last cycle", xlabel="t [s]", ylabel="energy [J]")
    for panel in panels.ravel():
        panel.grid(alpha=0.25)
    panels[1, 1].legend(loc="upper left", framealpha=1)
    figure.suptitle("Springs 10 % softer than modelled, payload of 10 % of the moving mass", fontsize=13)
    figure.savefig(path, dpi=110)


def path_panel(axes: Any, solution: pkmsea.Solution) -> None:
    """The plan and its rest windows over the simulated paths."""
    plan = np.vstack([solution.series.r_E, solution.series.r_E[:1]])
    axes.plot(*plan.T, **PLAN, zorder=3)
    for point in solution.problem.cycle.points:
        at, half = np.array(point.at), point.per_axis("window")
        axes.add_patch(Rectangle(at - half, *(2 * half), fill=False, color="k", zorder=4))
    low, high = plan.min(axis=0) - MARGIN, plan.max(axis=0) + MARGIN
    axes.set(title="Path of the end effector", xlabel="x_E [m]", ylabel="y_E [m]", aspect="equal")
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    axes.locator_params(nbins=5)


def error_panel(axes: Any, solution: pkmsea.Solution, end: float) -> None:
    """Rests are shaded; the window's half width is a line."""
    cycle = solution.problem.cycle
    for w in cycle.windows:
        for start in np.arange(-1, round(end / cycle.period) + 1) * cycle.period + w.start:
            axes.axvspan(max(start, 0), min(start + w.end - w.start, end), color="0.9", lw=0)
    axes.axhline(1e3 * min(w.deviation for w in cycle.windows), color="0.4", lw=1, ls=":")
    axes.set(title="Error of the end effector; rests shaded", xlabel="t [s]", ylabel="error [mm]")
    axes.set(xlim=(0, end), ylim=(SMALLEST, None))
