"""Why no motion keeps all limits: which of them contend, by how much, and the shortest period that works."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pkmsea.motion import Motion
from pkmsea.problem import Problem
from pkmsea.problem.bounds import TOUCHING, near
from pkmsea.solver.ipopt import solve_nlp
from pkmsea.task import Cycle
from pkmsea.transcription import Transcription, transcribe
from pkmsea.transcription.relaxed import Side

ROUNDS = 4  # of putting more limits in
NEAR = 0.3  # of a limit's size: what comes so near goes in
NONE = 1e-4  # share of a limit that counts as not widened
CLOSE = 1.005  # ratio of the shortest period to one that does not work
STRETCH, LONGEST = 1.5, 100.0  # of the period, from one try to the next, and in all
TRIES = 4  # first trajectories


@dataclass(frozen=True, eq=False)
class Widened:
    """A motion for which limits are widened as little as possible, each by a share of its size."""

    x: np.ndarray
    motion: Motion
    shares: tuple[tuple[Side, float], ...]
    reached: tuple[str, ...]

    @property
    def kept(self) -> bool:
        return all(share <= NONE for _, share in self.shares)


def widened(transcription: Transcription, x: np.ndarray, limited: Sequence[str] = ()) -> Widened | None:
    """From a trajectory; None where none keeps the rest windows, whatever the limits, or nothing is limited."""
    excesses = None
    for _ in range(ROUNDS):
        try:
            excesses = transcription.excesses(x) if excesses is None else excesses
            limited = tuple(dict.fromkeys([*limited, *near(excesses, NEAR)]))
            found = transcription.relaxed(x, limited)
            if found is None:
                return None
            nlp, sides = found
            point = solve_nlp(nlp, transcription.problem.options)
            x, shares = np.split(point.x, [point.x.size - len(sides)])
            excesses = transcription.excesses(x)
        except FloatingPointError:
            return None
        if not point.usable:
            return None
        if set(near(excesses, 0.0)) <= set(limited):
            break
    motion = transcription.motion(x)
    pairs = tuple(zip(sides, shares.tolist(), strict=True))
    wide = {side.bound.label for side, share in pairs if share > NONE}
    reached = tuple(label for label in near(excesses or {}, TOUCHING) if label not in wide)
    return Widened(x, motion, pairs, reached)


@dataclass(frozen=True, eq=False)
class Contention:
    """What keeps a problem from having a motion.

    Attributes
    ----------
    widened : limits that stand in the way, and what they would have to be, such as 'dq A <= 3 needs 3.4'.
    reached : labels of the limits that the motion reaches with these.
    stated : where the widened limits stand: keys of the task, or joints of the URDF.
    period : the shortest period that works with all limits as they are [s], to 1 %; None where none up to LONGEST times
        the task's does.
    """

    widened: tuple[str, ...]
    reached: tuple[str, ...]
    stated: tuple[str, ...]
    period: float | None

    def __str__(self) -> str:
        beside = f", beside {', '.join(self.reached)}" if self.reached else ""
        period = f"The shortest period that works is {self.period:.4g} s" if self.period else "No longer period works"
        return f"These limits contend: {'; '.join(self.widened)}{beside}. {period}."

    @property
    def remedy(self) -> str:
        widen = f"iden {', '.join(dict.fromkeys(self.stated))}."
        return f"Lengthen the period to {self.period:.4g} s, or w{widen}" if self.period else f"W{widen}"


def least_widened(transcription: Transcription) -> Widened | None:
    """The best of a few first trajectories, as `widened` makes it of each."""
    found = [w for x in _starts(transcription) if (w := widened(transcription, x)) is not None]
    return min(found, key=lambda w: sum(share for _, share in w.shares), default=None)


def contention(problem: Problem, found: Widened) -> Contention:
    """What a motion says for which limits had to be widened."""
    wide = [(side, share) for side, share in found.shares if share > NONE]
    needed, stated = tuple(side.needed(share) for side, share in wide), tuple(side.stated for side, _ in wide)
    return Contention(needed, found.reached, stated, _shortest(problem, found))


def _shortest(problem: Problem, found: Widened) -> float | None:
    """Longer and longer periods until one works, then halving, each from the motion before it."""
    short = problem.cycle.period
    longer = max((1 + share) ** (1 / max(side.bound.order, 1)) for side, share in found.shares)
    long, motion = short * max(longer, CLOSE**2), found.motion
    limited = tuple(side.bound.label for side, _ in found.shares)

    def works(period: float) -> Motion | None:
        transcription = transcribe(replace(problem, cycle=stretched(problem.cycle, period)))
        again = widened(transcription, transcription.transfer(motion), limited)
        return again.motion if again is not None and again.kept else None

    while (better := works(long)) is None:
        short, long = long, STRETCH * long
        if long > LONGEST * problem.cycle.period:
            return None
    motion = better
    while long > CLOSE * short:
        middle = float(np.sqrt(short * long))
        better = works(middle)
        short, long, motion = (middle, long, motion) if better is None else (short, middle, better)
    return long


def stretched(cycle: Cycle, period: float) -> Cycle:
    """The same cycle in another period: the middles of the rests move along, their lengths stay."""
    ratio = period / cycle.period
    points = [p if p.time is None else p.model_copy(update={"time": p.time * ratio}) for p in cycle.points]
    return cycle.model_copy(update={"period": period, "points": tuple(points)})


def _starts(transcription: Transcription) -> Iterator[np.ndarray]:
    seed = transcription.problem.options.seed
    for index in range(TRIES):
        try:
            yield transcription.start(np.random.default_rng([seed, index]) if index else None)
        except FloatingPointError:
            continue
