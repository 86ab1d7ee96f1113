"""One point of a study, solved in whatever process it lands in: plain data in, plain data out."""

from __future__ import annotations

import json
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pkmsea.errors import PkmseaError
from pkmsea.problem import build_problem
from pkmsea.solution import Solution
from pkmsea.solution.solve import chosen
from pkmsea.solution.store import motion_of, motion_record
from pkmsea.solver import Start
from pkmsea.solver.multistart import finish, multistart, restart, run_start
from pkmsea.study.calibrate import calibrate, with_drive_numbers
from pkmsea.study.study import Calibration
from pkmsea.task import Task
from pkmsea.transcription import Transcription, transcribe

BETTER = 1e-3  # relative: what a later round must gain on the first mesh to be worth refining
FAILED, NO_BETTER, DONE = "failed", "no better", "done"


@dataclass(frozen=True)
class Job:
    """A point to solve. `key` is (case, setup, point, round), the row in the table.

    Attributes
    ----------
    task : JSON of the changed task; `file` is where the original was read.
    near : motions of neighbours, as `motion_record`s in JSON, each a start.
    indices : of the random starts beside; None for the whole multi-start of the task.
    known : what the first mesh of this point's best solution claims so far [J]; None in the first round.
    result : file to save the solution in.
    """

    key: tuple[str, str, int, int]
    task: str
    file: str | None
    near: tuple[str, ...] = ()
    indices: tuple[int, ...] | None = None
    known: float | None = None
    calibrate: tuple[Calibration, ...] = ()
    result: str | None = None


def solve_point(job: Job) -> dict[str, Any]:
    """The row of a job: `energy` [J], `claimed`, `status`, `reason`, `stiffness` and so on; it does not raise."""
    begin = time.perf_counter()
    try:
        row = _solved(job, begin)
    except PkmseaError as error:
        row = failure(str(error))
    except Exception as error:  # a point that fails must not take the others with it
        row = failure(f"{type(error).__name__}: {error}")
    return {"key": job.key, **row, "seconds": time.perf_counter() - begin}


def failure(reason: str) -> dict[str, Any]:
    """The row of a point without a solution."""
    return {"outcome": FAILED, "status": FAILED, "reason": reason}


def task_of(job: Job) -> tuple[Task, dict[str, float]]:
    """The job's task, and the drive numbers that were calibrated for it."""
    task = _with_file(Task.model_validate_json(job.task), job.file)
    numbers: dict[str, float] = {}
    for c in job.calibrate:
        numbers[c.number] = calibrate(task, c.setup, c.number, c.energy, c.start)
        task = with_drive_numbers(task, **{c.number: numbers[c.number]})
    return task, numbers


def _with_file(task: Task, file: str | None) -> Task:
    task._file = Path(file) if file else None
    return task


def _solved(job: Job, begin: float) -> dict[str, Any]:
    task, numbers = task_of(job)
    transcription = transcribe(build_problem(task, job.key[1]))
    starts = _starts(transcription, job)
    claimed = min((start.energy for start in starts), default=float("inf"))
    if job.known is not None and not claimed < (1 - BETTER) * job.known:
        return {"outcome": NO_BETTER, "starts": len(starts)}
    solution = chosen(transcription, starts, workers=1, begin=begin)
    if job.result is not None:
        solution.save(job.result)
    return record(solution) | numbers


def _starts(transcription: Transcription, job: Job) -> list[Start]:
    starts = [restart(transcription, motion_of(json.loads(text))) for text in job.near]
    if job.indices is None:
        return starts + multistart(transcription, workers=1)[0]
    own = [run_start(transcription, index) for index in job.indices]
    return starts + [finish(transcription, start) if start.usable else start for start in own]


def record(solution: Solution) -> dict[str, Any]:
    """A solution as a row: numbers for people, and what makes it a `Solution` again."""
    c = solution.motion.stiffness
    return {
        "outcome": DONE,
        "energy": solution.energy,
        "claimed": solution.claimed,
        "status": "verified" if solution.verified else "not verified",
        "reason": "" if solution.verified else "; ".join(solution.faults),
        "starts": len(solution.starts),
        "stiffness": [float(x) for x in c],
        "motion": json.dumps(motion_record(solution.motion)),
        "meshes": json.dumps([asdict(mesh) for mesh in solution.meshes]),
        "task": solution.problem.task.model_dump_json(),
    }
