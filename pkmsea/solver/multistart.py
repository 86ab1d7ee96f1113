"""Many seeded starts of one problem, on all cores; every start ends in a typed outcome."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from pkmsea.motion import Motion
from pkmsea.problem.bounds import near
from pkmsea.solver.ipopt import Outcome, solve_nlp
from pkmsea.solver.spread import collect, spread
from pkmsea.transcription import Transcription

SCREENING, SHARPENING, LAST = slice(0, 2), slice(2, None), slice(-1, None)  # of an NLP's steps
CUT_OFF = 120  # iterations per step: most starts need 20 to 80, and those that need more end badly
FINISHED = 4  # starts at least that go on
AGREEING = 8  # starts that find one optimum between them are enough
ROUNDS = 5  # of solving with more limits, at most
NEAR = 0.2  # of a limit's size: what comes so near goes into the NLP with those that are overstepped
LEAST = 1e-3  # [s] that a time limit leaves a solve
GUESS_TRIES = 8  # random paths drawn per start until one stays in the workspace, clear of singularities

Progress = Callable[["Start"], None]


@dataclass(frozen=True, eq=False)
class Start:
    """One start of the multi-start and where it ended.

    Attributes
    ----------
    index : 0 is the plain guess, the others are random, each from its own seed.
    x : the NLP's variables; None where no start could be made.
    claimed : value of the cost as the transcription sees it; infinite where there is no usable point.
    stiffness : of the elastic drives.
    limited : labels of the limits of drives and joints that had to be put into the NLP.
    finished : whether it was among the best and went on to the full sharpness; the others were only screened.
    repeats : index of the better start whose optimum it found, too; None where it is the best of its own.
    """

    index: int
    outcome: Outcome
    x: np.ndarray | None
    claimed: float
    stiffness: tuple[float, ...]
    iterations: int
    seconds: float
    limited: tuple[str, ...] = ()
    finished: bool = False
    repeats: int | None = None

    @property
    def usable(self) -> bool:
        return bool(np.isfinite(self.claimed))


def run_start(transcription: Transcription, index: int) -> Start:
    """Screen the start of this index: solve the first steps, and cut off what goes astray."""
    begin = time.perf_counter()
    options = transcription.problem.options
    x = None
    for attempt in range(GUESS_TRIES if index else 1):
        rng = np.random.default_rng([options.seed, index, attempt]) if index else None
        try:
            x = transcription.start(rng)
            break
        except FloatingPointError:
            continue
    if x is None:
        return Start(index, Outcome.UNREACHABLE, None, np.inf, (), 0, time.perf_counter() - begin)
    return improve(transcription, index, x, SCREENING, begin=begin)


def improve(
    transcription: Transcription,
    index: int,
    x: np.ndarray,
    steps: slice,
    *,
    limited: tuple[str, ...] = (),
    warm: bool = False,
    begin: float | None = None,
) -> Start:
    """Solve some steps from x: with the limits of drives and joints that are `limited`, then with those it needs, too.

    `warm` is for an x that is nearly optimal; otherwise, what takes many iterations is cut off. Limits hold between the
    samples as the x there does, from which an NLP is made: a warm one is made again until it has no effect.
    """
    begin = time.perf_counter() if begin is None else begin
    options, iterations = transcription.problem.options, 0
    if options.time_limit is not None:
        left = options.time_limit - (time.perf_counter() - begin)
        options = options.model_copy(update={"time_limit": max(left, LEAST)})
    if not warm and transcription.quick:
        options = options.model_copy(update={"iterations": min(options.iterations, CUT_OFF)})
    seen: list[np.ndarray] = []
    for _ in range(ROUNDS):
        try:
            nlp = transcription.nlp(x, limited, seen)
            point = solve_nlp(nlp, options, range(nlp.steps)[steps] or range(nlp.steps)[LAST], warm)
            iterations += sum(point.iterations)
            claimed = transcription.claimed(point.x) if point.usable else np.inf
            excesses = transcription.excesses(point.x) if point.usable else {}
        except FloatingPointError:
            return Start(index, Outcome.STALLED, None, np.inf, (), iterations, time.perf_counter() - begin, limited)
        over, close = near(excesses, 0.0), near(excesses, NEAR)
        if not over or (not warm and set(over) <= set(limited)):
            break
        seen += [x] if warm else []
        x, limited = point.x, (*limited, *(label for label in close if label not in limited))
    stiffness = tuple(transcription.motion(point.x).springs.values())
    seconds = time.perf_counter() - begin
    return Start(index, point.outcome, point.x, claimed, stiffness, iterations, seconds, limited)


def restart(transcription: Transcription, motion: Motion) -> Start:
    """Solve at full sharpness from the optimal motion of a neighbouring problem."""
    return replace(improve(transcription, 0, transcription.transfer(motion), LAST, warm=True), finished=True)


def multistart(
    transcription: Transcription, workers: int | None = None, progress: Progress | None = None
) -> tuple[list[Start], bool]:
    """The starts, in the order of their indices; the best distinct ones are sharpened to the end.

    The search ends after the first AGREEING starts if they have all found the same optimum.
    An interrupt (Ctrl-C) ends the search at once; what has been found is returned as it is, and True with it.
    """
    count = transcription.problem.options.starts
    done: list[Start] = []
    interrupted = False
    for indices in (range(min(AGREEING, count)), range(AGREEING, count)):
        calls = [(run_start, index) for index in indices]
        found, interrupted = collect(spread(transcription, workers, calls), progress)
        done += found
        if interrupted or (all(start.outcome is Outcome.OPTIMAL for start in done) and len(distinct(done)) == 1):
            break
    groups = clusters(done)
    leaders = {start.index: group[0].index for group in groups for start in group[1:]}
    done = [replace(start, repeats=leaders.get(start.index)) for start in done]
    best = [group[0] for group in groups][: 0 if interrupted else max(FINISHED, count // 6)]
    sharpened, again = collect(spread(transcription, workers, [(finish, s) for s in best]))
    finished = {s.index: s for s in sharpened}
    return sorted((finished.get(s.index, s) for s in done), key=lambda s: s.index), interrupted or again


def distinct(starts: Iterable[Start], value: float = 1e-3, stiffness: float = 0.05) -> list[Start]:
    """The usable starts, best first, without those that repeat a better one's value and stiffness (relative)."""
    return [group[0] for group in clusters(starts, value, stiffness)]


def clusters(starts: Iterable[Start], value: float = 1e-3, stiffness: float = 0.05) -> list[list[Start]]:
    """The usable starts, grouped with the best one whose value and stiffness they repeat (relative); best first."""
    groups: list[list[Start]] = []
    for start in sorted((s for s in starts if s.usable), key=lambda s: s.claimed):
        same = (group for group in groups if _same(start, group[0], value, stiffness))
        group = next(same, None)
        if group is None:
            groups.append([start])
        else:
            group.append(start)
    return groups


def _same(a: Start, b: Start, value: float, stiffness: float) -> bool:
    near = abs(a.claimed - b.claimed) <= value * abs(b.claimed)
    return near and np.allclose(np.log(a.stiffness), np.log(b.stiffness), rtol=0, atol=stiffness)


def finish(transcription: Transcription, start: Start) -> Start:
    """Sharpen a screened start to the end; the better of the two is kept."""
    assert start.x is not None
    begin = time.perf_counter() - start.seconds
    final = improve(transcription, start.index, start.x, SHARPENING, limited=start.limited, warm=True, begin=begin)
    iterations = start.iterations + final.iterations
    if not final.usable or final.claimed > start.claimed:
        return replace(start, finished=True, iterations=iterations, seconds=final.seconds)
    return replace(final, finished=True, iterations=iterations)
