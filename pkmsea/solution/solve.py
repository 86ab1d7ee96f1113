"""From a task to its solutions: multi-start, refinement of the best, choice of the best verified one."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from pkmsea.errors import Infeasible, InputError, NotConverged, SolveError, blaming
from pkmsea.problem import Problem, build_problem
from pkmsea.solution.contention import contention, least_widened
from pkmsea.solution.refine import Refined, refine, unrefined
from pkmsea.solution.solution import Solution
from pkmsea.solver import Outcome, Start, multistart
from pkmsea.solver.multistart import Progress, distinct, improve, restart
from pkmsea.solver.spread import collect, spread
from pkmsea.solver.threads import one_thread
from pkmsea.task import Task, load_task
from pkmsea.transcription import Transcription, transcribe

REFINED = 4  # best distinct optima that are refined, so that a verified one can be chosen
NEAR = 0.05  # of the best, relative: those farther away are not refined
ROUNDS = 3  # of refining the next best, while none of those before is verified
GAIN = 2.0  # times what refining has gained the best: what it may gain another


Solvable = str | Path | Task | Problem | Transcription


@one_thread
def solve(
    source: Solvable,
    setup: str | None = None,
    *,
    workers: int | None = None,
    progress: Progress | None = None,
    near: Solution | None = None,
) -> Solution:
    """Solve one problem: the energy-optimal cycle and stiffnesses together.

    Parameters
    ----------
    source : the path of a task file, a task, a problem, or a transcription, which is then solved as it is.
    setup : name of the task's setup; may be left out if there is only one.
    workers : processes of the multi-start; default: the cores that this process may use.
    progress : called with every finished start.
    near : a solution of a neighbouring task; the only start then, in place of the multi-start.

    Raises
    ------
    InputError : the task is wrong. Infeasible, NotConverged : there is no motion, or no start found one.
    """
    begin = time.perf_counter()
    source = load_task(source) if isinstance(source, str | Path) else source
    with blaming(source.file if isinstance(source, Task) else None):
        transcription = _transcribed(source, setup)
        if near is None:
            starts, interrupted = multistart(transcription, workers, progress)
        else:
            starts, interrupted = [restart(transcription, near.motion)], False
        try:
            return select(transcription, starts, workers=workers, begin=begin, interrupted=interrupted)
        except (Infeasible, NotConverged) as error:
            if (start := _by_widening(transcription, len(starts), error)) is None:
                raise
        return select(transcription, [*starts, start], workers=workers, begin=begin)


def _by_widening(transcription: Transcription, index: int, error: SolveError) -> Start | None:
    """Where no start found a motion: one from a motion that was led into the limits; None where nothing is limited.

    Raises
    ------
    Infeasible : there is none; says which limits contend.
    """
    found = least_widened(transcription)
    if found is None:
        return None
    if not found.kept:
        contending = contention(transcription.problem, found)
        told = Infeasible(f"{error.cause} {contending}", contending.remedy, key=error.key)
        told.contention = contending
        raise told from None
    limited = tuple(side.bound.label for side, _ in found.shares)
    return replace(improve(transcription, index, found.x, slice(None), limited=limited), finished=True)


def _transcribed(source: Task | Problem | Transcription, setup: str | None) -> Transcription:
    if isinstance(source, Task):
        source = build_problem(source, setup)
    elif setup is not None:
        raise InputError("Only a task has setups.", "Leave the setup out.", key="setup", value=setup)
    if isinstance(source, Problem):
        return transcribe(source)
    if not isinstance(source, Transcription):
        raise InputError(
            "This cannot be solved.",
            "Give the path of a task file, a Task, a Problem or a Transcription.",
            value=source,
        )
    return source


def select(
    transcription: Transcription,
    starts: Sequence[Start],
    *,
    workers: int | None = None,
    begin: float,
    interrupted: bool = False,
    required: Sequence[Start] = (),
) -> Solution:
    """Refine the best distinct optima of some starts, and the next best where none of these is verified; the best
    verified one is the solution. Raises as `solve` does.

    `begin` is when the starts began, by `time.perf_counter`; after an interrupt nothing is refined. The `required`
    starts are refined whatever they claim on the first mesh.
    """
    problem = transcription.problem
    finished = [start for start in starts if start.finished]
    optima = distinct(finished or starts)
    candidates = _promising(optima)
    candidates += [start for start in required if start.usable and start not in candidates]
    if not candidates and interrupted:
        raise KeyboardInterrupt
    if not candidates:
        raise _nothing_found(transcription, starts)

    def solution(of: Refined) -> Solution:
        seconds = time.perf_counter() - begin
        return Solution(problem, of.motion, of.audit.claimed, tuple(starts), of.meshes, seconds, interrupted)

    best: Solution | None = None
    rest = [start for start in optima if start not in candidates]
    for _ in range(ROUNDS):
        if not candidates or interrupted:
            break
        found, interrupted = _refined(transcription, workers, candidates, required)
        ranked = [solution(x) for x in sorted(filter(None, found), key=lambda x: x.rank)]
        if verified := next((s for s in ranked if s.verified), None):
            return verified
        best = best or next(iter(ranked), None)
        candidates, required = _promising(rest), ()
        rest = rest[len(candidates) :]
    if best is None and interrupted:
        plain = filter(None, (unrefined(transcription, start) for start in candidates))
        best = next(map(solution, plain), None)
    if best is None:
        raise _unusable(problem)
    return best


def _refined(
    transcription: Transcription, workers: int | None, optima: list[Start], required: Sequence[Start]
) -> tuple[list[Refined | None], bool]:
    """The best optimum on finer meshes, then those that these may bring before it; True after an interrupt."""

    def all_of(starts: list[Start]) -> tuple[list[Refined | None], bool]:
        return collect(spread(transcription, workers, [(refine, start) for start in starts]))

    first, *others = optima
    found, interrupted = all_of([first])
    best = found[0] if found else None
    if best is not None and best.verified:
        value = best.audit.value
        most = value + GAIN * (first.claimed - value)
        others = [start for start in others if start.claimed < most or start in required]
    if interrupted or not others:
        return found, interrupted
    more, interrupted = all_of(others)
    return found + more, interrupted


def solve_all(task: Task | str | Path, *, workers: int | None = None) -> list[Solution]:
    """Solve every setup of a task, in its order."""
    task = load_task(task) if isinstance(task, str | Path) else task
    return [solve(task, setup.name, workers=workers) for setup in task.setups]


def _promising(optima: list[Start]) -> list[Start]:
    """The best few, at least one, which a finer mesh may bring into another order."""
    return [start for start in optima if start.claimed <= (1 + NEAR) * optima[0].claimed][:REFINED]


def _unusable(problem: Problem) -> NotConverged:
    return NotConverged(
        "Every optimum that was found is unusable: between the grid points the motion leaves the workspace or crosses "
        "a singularity.",
        "Raise options.starts, or options.samples for a finer grid.",
        key=f"setup '{problem.name}'",
    )


def _nothing_found(transcription: Transcription, starts: Sequence[Start]) -> Infeasible | NotConverged:
    problem, counts = transcription.problem, Counter(start.outcome for start in starts)
    how = ", ".join(f"{count} {outcome.value}" for outcome, count in counts.items()) or "none ran"
    told, key = f"{len(starts)} starts: {how}", f"setup '{problem.name}'"
    if starts and counts[Outcome.UNREACHABLE] == len(starts) and (reason := _unreachable(transcription)):
        return Infeasible(
            f"No path leads through the rest windows ({told}): {reason}.",
            "Move the points, or raise options.starts"
            + ("; a joint that may turn without end has type='continuous' in the URDF." if "gains" in reason else "."),
            key=key,
        )
    if any(start.outcome is Outcome.INFEASIBLE or start.limited for start in starts):
        limits = ", ".join(bound.label for bound in problem.bounds) or "the rest windows"
        patience = ", or options.iterations" if counts[Outcome.ITERATIONS] else ""
        return Infeasible(
            f"No motion was found that keeps the rest windows and the limits within the period of "
            f"{problem.cycle.period:g} s ({told}).",
            f"Lengthen the period, widen the windows, or raise the limits ({limits}){patience}.",
            key=key,
        )
    return NotConverged(
        f"No start found an optimum ({told}).",
        "Raise options.starts, options.iterations or options.time_limit, or narrow the stiffness bounds.",
        key=key,
    )


def _unreachable(transcription: Transcription) -> str:
    """Why the plain path cannot be followed."""
    try:
        transcription.start(None)
    except FloatingPointError as error:
        return str(error)
    return ""
