"""From a task to its solutions: multi-start, refinement until claimed and true energy agree, audit."""

from __future__ import annotations

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pkmsea.errors import Infeasible, NotConverged
from pkmsea.problem import Problem, build_problem
from pkmsea.solution.audit import GAP, Audit, audit
from pkmsea.solution.solution import Mesh, Solution
from pkmsea.solver import Outcome, Start, multistart
from pkmsea.solver.multistart import Progress, distinct, improve
from pkmsea.task import Task, load_task
from pkmsea.transcription import Motion, Transcription, transcribe

AUDITED = 4  # best distinct optima that are audited, so that a verified one can be chosen
MESHES = 4  # at most, each twice as fine as the one before


def solve(
    task: Task | str | Path, setup: str | None = None, *, workers: int | None = None, progress: Progress | None = None
) -> Solution:
    """Solve one setup of a task: the energy-optimal cycle and stiffnesses together.

    Parameters
    ----------
    task : a task, or the path of a task file.
    setup : name of the setup; may be left out if there is only one.
    workers : processes of the multi-start; default: the cores that this process may use.
    progress : called with every finished start.

    Raises
    ------
    InputError : the task is wrong. Infeasible, NotConverged : there is no motion, or no start found one.
    """
    begin = time.perf_counter()
    problem = build_problem(load_task(task) if isinstance(task, str | Path) else task, setup)
    transcription = transcribe(problem)
    starts, interrupted = multistart(transcription, workers, progress)
    finished = [start for start in starts if start.finished]
    candidates = distinct(finished or starts)[:AUDITED]
    if not candidates and interrupted:
        raise KeyboardInterrupt
    if not candidates:
        raise _nothing_found(problem, starts)
    best = min(candidates, key=lambda start: _rank(problem, transcription, start))
    motion, claimed, meshes = _refine(problem, transcription, best)
    seconds = time.perf_counter() - begin
    return Solution(problem, motion, claimed, tuple(starts), tuple(meshes), seconds, interrupted)


def solve_all(task: Task | str | Path, *, workers: int | None = None) -> list[Solution]:
    """Solve every setup of a task, in its order."""
    task = load_task(task) if isinstance(task, str | Path) else task
    return [solve(task, setup.name, workers=workers) for setup in task.setups]


def _rank(problem: Problem, transcription: Transcription, start: Start) -> tuple[bool, float]:
    """Verified or refinable ones first, then by true energy."""
    assert start.x is not None
    try:
        result, _ = audit(problem, transcription.motion(start.x), start.energy)
    except FloatingPointError:
        return True, np.inf
    return result.gap > 10 * GAP or result.window > 0, result.energy


def _refine(problem: Problem, transcription: Transcription, best: Start) -> tuple[Motion, float, list[Mesh]]:
    """Solve on finer meshes until the audit finds no fault; the first mesh is the multi-start's."""
    assert best.x is not None
    motion, claimed = transcription.motion(best.x), best.energy
    try:
        result = audit(problem, motion, claimed)[0]
    except FloatingPointError as error:
        raise NotConverged(
            f"Every optimum that was found is unusable: {error} between the grid points.",
            "Raise options.starts, or options.samples for a finer grid.",
            file=problem.task.file,
            key=f"setup '{problem.setup.name}'",
        ) from error
    meshes = [_mesh(motion, transcription, result, best)]
    finer = transcription.refined()
    while finer is not None and not result.verified and len(meshes) < MESHES:
        found = improve(finer, best.index, finer.transfer(motion), final=True, first=1)
        if found.x is None or not found.usable:
            break
        try:
            finer_result = audit(problem, finer.motion(found.x), found.energy)[0]
        except FloatingPointError:
            break
        motion, claimed, result = finer.motion(found.x), found.energy, finer_result
        meshes.append(_mesh(motion, finer, result, found))
        finer = finer.refined()
    return motion, claimed, meshes


def _mesh(motion: Motion, transcription: Transcription, result: Audit, start: Start) -> Mesh:
    size, samples = motion.basis.size, transcription.samples
    return Mesh(size, samples, result.claimed, result.energy, start.iterations, start.seconds)


def _nothing_found(problem: Problem, starts: Sequence[Start]) -> Infeasible | NotConverged:
    counts: dict[str, int] = {}
    for start in starts:
        counts[start.outcome.value] = counts.get(start.outcome.value, 0) + 1
    how = ", ".join(f"{count} {outcome}" for outcome, count in counts.items()) or "none ran"
    where: dict[str, Any] = {"file": problem.task.file, "key": f"setup '{problem.setup.name}'"}
    if any(start.outcome is Outcome.INFEASIBLE or start.limited for start in starts):
        limits = ", ".join(sorted({f"{b.quantity} of {b.name}" for b in problem.bounds})) or "the rest windows"
        return Infeasible(
            f"No motion was found that keeps the rest windows and the limits within the period of "
            f"{problem.cycle.period:g} s ({len(starts)} starts: {how}).",
            f"Lengthen the period, widen the windows, or raise the limits ({limits}).", **where,
        )  # fmt: skip
    return NotConverged(
        f"No start found an optimum ({len(starts)} starts: {how}).",
        "Raise options.starts, options.iterations or options.time_limit, or narrow the stiffness bounds.", **where,
    )  # fmt: skip
