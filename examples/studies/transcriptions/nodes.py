"""Nodes in time: what a motion is there, and where they have to keep the rest windows."""

from __future__ import annotations

import numpy as np

from pkmsea.motion import Motion
from pkmsea.motion.series import Series, series
from pkmsea.problem import Problem
from pkmsea.transcription.windows import sampled_deviation


def sampled(problem: Problem, motion: Motion, t: np.ndarray, names: tuple[str, ...]) -> list[np.ndarray]:
    """Series of a motion at times t, interpolated: good enough for a first x."""
    dense: Series = series(problem, motion)
    period = problem.cycle.period
    return [
        np.stack([np.interp(t, dense.t, column, period=period) for column in getattr(dense, name).T], axis=1)
        for name in names
    ]


def aligned(problem: Problem, wanted: float) -> int:
    """The number of equal steps nearest to a wanted one for which all window edges are nodes."""
    edges = np.array([t for w in problem.cycle.windows for t in (w.start, w.end)]) / problem.cycle.period
    fitting = [k for k in range(1, 4 * int(wanted) + 1) if np.abs(edges * k - np.round(edges * k)).max() < 1e-9]
    return min(fitting, key=lambda k: (abs(k - wanted), -k))


def window_box(problem: Problem, t: np.ndarray) -> np.ndarray:
    """Bounds of r_E at nodes t, (2, K, delta); infinite outside the rest windows, whose edges belong to them.

    The windows are as much narrower than asked as those of the schemes with splines (`linear_rows`).
    """
    period = problem.cycle.period
    box = np.stack([np.full((t.size, len(problem.span)), side) for side in (-np.inf, np.inf)])
    for w in problem.cycle.windows:
        away = (t - (w.start + w.end) / 2 + period / 2) % period - period / 2
        inside = np.abs(away) <= (w.end - w.start) / 2 + 1e-9
        deviation = sampled_deviation(w, int(inside.sum()))
        box[:, inside, w.axis] = w.at + deviation * np.array([[-1], [1]])
    return box
