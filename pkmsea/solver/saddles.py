"""Saddle points are left: on along a direction in which the cost falls to second order, and solved again.

Symmetric tasks have symmetric stationary points, and solvers stay on them; often a better motion breaks the symmetry.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pkmsea.solver.multistart import LAST, Start, improve
from pkmsea.solver.nlp import ScaledNlp, scaled
from pkmsea.solver.optimality import descent, last_parameter
from pkmsea.transcription import Transcription

SADDLES = 6  # that are left, one after the other, before it is enough
HALVINGS = 12  # of the way along the direction, from one typical change of the variables
SHARE = 0.25  # of the fall that the curvature promises, which is enough


def leave_saddles(transcription: Transcription, start: Start) -> Start:
    """The start, or what it comes to when every saddle point on its way is left."""
    for _ in range(SADDLES):
        x = _beyond(transcription, start)
        if x is None:
            break
        again = improve(transcription, start.index, x, LAST, limited=start.limited, warm=True)
        if not again.usable or not again.claimed < start.claimed:
            break
        start = replace(
            again,
            finished=start.finished,
            repeats=start.repeats,
            iterations=start.iterations + again.iterations,
            seconds=start.seconds + again.seconds,
        )
    return start


def _beyond(transcription: Transcription, start: Start) -> np.ndarray | None:
    """A lower point beside a saddle, on the better of its two sides; None where the start is none."""
    assert start.x is not None
    try:
        nlp = transcription.nlp(start.x, start.limited)
        p = last_parameter(nlp, start.x)
        found = descent(nlp, start.x, p)
    except (FloatingPointError, RuntimeError):  # CasADi's word for a point that cannot be evaluated
        return None
    if found is None:
        return None
    problem = scaled(nlp)
    sides = [_lower(problem, start.x / problem.scale, p, sign * found[0], found[1]) for sign in (1.0, -1.0)]
    lower = [side for side in sides if side is not None]
    return min(lower, key=lambda side: side[0])[1] * problem.scale if lower else None


def _lower(
    problem: ScaledNlp, z: np.ndarray, p: np.ndarray, direction: np.ndarray, curvature: float
) -> tuple[float, np.ndarray] | None:
    """Value and place of the first point, halving after halving, at which the cost has fallen enough."""
    here = float(problem.oracle(z, p)[0])
    step = 1.0 / float(np.abs(direction).max())
    for _ in range(HALVINGS):
        at = np.clip(z + step * direction, problem.lower, problem.upper)
        try:
            value = float(problem.oracle(at, p)[0])
        except RuntimeError:
            value = np.inf
        if value <= here + SHARE * curvature * step**2 / 2:
            return value, at
        step /= 2
    return None
