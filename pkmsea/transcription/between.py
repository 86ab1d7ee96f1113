"""What limited signals do between the samples of a periodic grid, at which an NLP holds their limits."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.interpolate import make_interp_spline

from pkmsea.motion import Motion
from pkmsea.motion.series import limited_signal, series
from pkmsea.problem import Bound, Problem

DEGREE = 5  # of the periodic spline through instants
NEWTON = 3  # steps to where its derivative vanishes
FINER = 4  # instants per sample
SHARE = 0.02  # of a limit's width, and of its signal's range: what a trajectory far from the solution may ask for
FAR = 10.0  # times the range of a signal
SLACK = 5e-7  # of a limit's size: what is left of changes from one trajectory to the next


def beyond(values: np.ndarray) -> np.ndarray:
    """How far samples (K,) of a periodic signal get beyond each sample at an extremum within half a step around it.

    Positive at a maximum, negative at a minimum, zero where there is none: values + beyond(values) holds the extrema.
    """
    count = values.size
    closed = np.append(values, values[0])
    spline = make_interp_spline(np.arange(count + 1), closed, DEGREE, bc_type="periodic")
    slope, curvature = spline.derivative(1), spline.derivative(2)
    t, shift = np.arange(count), np.zeros(count)
    for _ in range(NEWTON):
        at = (t + shift) % count
        bend = curvature(at)
        shift = np.clip(shift - slope(at) / np.where(bend == 0, np.inf, bend), -1.0, 1.0)
    found = spline((t + shift) % count) - values
    return np.asarray(np.where(np.abs(shift) <= 0.5, found, 0.0))


def exact(problem: Problem, motion: Motion, bounds: Sequence[Bound], count: int) -> list[np.ndarray]:
    """What bounds limit, by the exact flat map at `count` instants of a period, each (count,).

    Raises
    ------
    FloatingPointError : the motion leaves the workspace.
    """
    t = np.arange(count) * problem.cycle.period / count
    s = None if all(bound.of_end_effector for bound in bounds) else series(problem, motion, count)
    return [limited_signal(bound, motion, t, s) for bound in bounds]


def extremes(problem: Problem, motion: Motion, bounds: Sequence[Bound], samples: int) -> list[np.ndarray]:
    """Smallest and largest value of each bound's signal at every sample, extrema within half a step around it included.

    (2, samples) each. Raises as `exact` does.
    """
    reach = np.arange(samples)[:, None] * FINER + np.arange(-FINER // 2, FINER // 2 + 1)
    found = []
    for values in exact(problem, motion, bounds, FINER * samples):
        extra, own = beyond(values), values[::FINER]
        sides = []
        for sign in (-1.0, 1.0):
            v = sign * values
            peak = (v >= np.roll(v, 1)) & (v >= np.roll(v, -1))
            highest = np.where(peak, v + np.maximum(sign * extra, 0.0), -np.inf)
            sides.append(sign * np.maximum(sign * own, highest[reach % values.size].max(axis=1)))
        found.append(np.array(sides))
    return found


def room(bound: Bound, values: np.ndarray, ends: np.ndarray) -> np.ndarray:
    """What the lower and the upper limit must leave at each sample (2, samples), and SLACK with it.

    `values` (samples,) are those of an NLP, `ends` (2, samples) their `extremes`. Minus infinity where a limit is FAR
    off, so that the NLP need not hold it.
    """
    sizes, span = bound.sizes(values), float(np.ptp(values))
    out = np.array([values - ends[0], ends[1] - values])
    needed = np.clip(out, 0.0, SHARE * min(bound.upper - bound.lower, span)) + SLACK * sizes[:, None]
    needed[bound.excesses(values) * sizes < -FAR * span] = -np.inf
    return needed
