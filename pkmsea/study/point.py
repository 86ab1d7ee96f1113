"""One point of a study, solved in whatever process it lands in: plain data in, plain data out."""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd

from pkmsea.errors import PkmseaError, blaming
from pkmsea.files import file_name
from pkmsea.problem import Problem, build_problem, task_of
from pkmsea.solution import Mesh, Solution
from pkmsea.solution.records import motion_of, motion_record
from pkmsea.solution.solve import NEAR, select
from pkmsea.solver import Start
from pkmsea.solver.multistart import distinct, finish, multistart, restart, run_start
from pkmsea.study.calibrate import calibrated, with_numbers
from pkmsea.study.kept import kept
from pkmsea.study.study import KEY, Calibration
from pkmsea.study.table import DONE, FAILED, NO_BETTER, UNVERIFIED, VERIFIED, rank, records
from pkmsea.task import Task
from pkmsea.transcription import Transcription, transcribe

BETTER = 1e-3  # relative: what a later round must gain on the first mesh to be worth refining


@dataclass(frozen=True)
class Job:
    """A point to solve.

    Attributes
    ----------
    key : case, setup, point and round, the row in the table.
    values : of the varied parameters.
    problem : what is solved there; `file` is the one that its errors name.
    near : motions of neighbours, as `motion_record`s in JSON, each a start.
    indices : of the random starts beside; None for the whole multi-start of the task.
    calibrate : numbers to find first, each with the problem whose energy tells it.
    known : what this point's best solution so far claims on the first mesh [J]; None in the first round.
    cache : folder where calibrated numbers are kept, for the points that differ in another setup only.
    result : file to save the solution in.
    """

    key: tuple[str, str, int, int]
    values: Mapping[str, float]
    problem: Problem
    file: str | None = None
    near: tuple[str, ...] = ()
    indices: tuple[int, ...] | None = None
    known: float | None = None
    calibrate: tuple[tuple[Calibration, Problem], ...] = ()
    cache: str = "."
    result: str | None = None


def solve_point(job: Job) -> dict[str, Any]:
    """The row of a job: `energy` [J], `claimed`, `status`, `reason`, `stiffness` and so on; it does not raise."""
    begin = time.perf_counter()
    try:
        with blaming(job.file):
            row = _named(job.key, job.values) | _solved(job, begin)
    except Exception as error:  # a point that fails must not take the others with it
        row = failure(job.key, job.values, reason(error))
    return row | {"seconds": time.perf_counter() - begin}


def failure(key: tuple[str, str, int, int], values: Mapping[str, float], reason: str) -> dict[str, Any]:
    """The row of a point without a solution."""
    return _named(key, values) | {"outcome": FAILED, "status": FAILED, "reason": reason}


def reason(error: Exception) -> str:
    """Why a point has failed, in its row."""
    return str(error) if isinstance(error, PkmseaError) else f"{type(error).__name__}: {error}"


def lost(job: Job) -> dict[str, Any]:
    """The row of a job whose processes died."""
    return failure(job.key, job.values, "its process died again and again")


def _named(key: tuple[str, str, int, int], values: Mapping[str, float]) -> dict[str, Any]:
    return dict(zip(KEY, key, strict=True)) | dict(values)


def calibrated_numbers(job: Job) -> dict[str, float]:
    """The drive numbers that are calibrated for a job, each with those before it put in."""
    numbers: dict[str, float] = {}
    for c, problem in job.calibrate:
        reference = with_numbers(problem, **numbers)
        text = task_of(reference).model_dump_json() + c.model_dump_json()
        search = partial(calibrated, reference, c.number, c.energy, c.start, c.tolerance)
        numbers[c.number] = kept(Path(job.cache), text, search)
    return numbers


def _solved(job: Job, begin: float) -> dict[str, Any]:
    numbers = calibrated_numbers(job)
    transcription = transcribe(with_numbers(job.problem, **numbers))
    starts = _starts(transcription, job)
    claimed = min((start.claimed for start in starts), default=float("inf"))
    if job.known is not None and not claimed < (1 - BETTER) * job.known:
        return {"outcome": NO_BETTER, "status": NO_BETTER, "starts": len(starts)}
    known = starts[: len(job.near)] if job.indices is None else []  # their motions were known on finer meshes
    solution = select(transcription, starts, workers=1, begin=begin, required=known)
    if solution.interrupted:
        raise KeyboardInterrupt
    if job.result is not None:
        solution.save(job.result)
    return record(solution) | numbers


def _starts(transcription: Transcription, job: Job) -> list[Start]:
    starts = [restart(transcription, motion_of(json.loads(text))) for text in job.near]
    if job.indices is None:
        found, interrupted = multistart(transcription, workers=1)
        if interrupted:
            raise KeyboardInterrupt
        return starts + found
    enough = (1 + NEAR) * min((start.claimed for start in starts), default=float("inf"))
    own = [run_start(transcription, index) for index in job.indices]
    return starts + [finish(transcription, start) if start.claimed <= enough else start for start in own]


def record(solution: Solution) -> dict[str, Any]:
    """A solution as a row: numbers for people, and what makes it a `Solution` again."""
    c = solution.motion.stiffness
    return {
        "outcome": DONE,
        "energy": solution.value,
        "claimed": solution.claimed,
        "status": VERIFIED if solution.verified else UNVERIFIED,
        "reason": "" if solution.verified else "; ".join(solution.faults),
        "starts": len(solution.starts),
        "stiffness": [float(x) for x in c],
        "optima": json.dumps(_optima(solution)),
        "motion": json.dumps(motion_record(solution.motion)),
        "meshes": json.dumps([asdict(mesh) for mesh in solution.meshes]),
        "task": task_of(solution.problem).model_dump_json(),
    }


def _optima(solution: Solution) -> list[dict[str, Any]]:
    """Energy as claimed [J] and stiffness of the distinct optima of all starts, best first."""
    return [{"claimed": s.claimed, "stiffness": list(s.stiffness)} for s in distinct(solution.starts)]


def solution_of(row: Mapping[str, Any]) -> Solution:
    """The solution that a row of the table stands for, without its starts."""
    task = Task.model_validate_json(row["task"])
    meshes = tuple(Mesh(**mesh) for mesh in json.loads(row["meshes"]))
    motion = motion_of(json.loads(row["motion"]))
    return Solution(build_problem(task, row["setup"]), motion, row["claimed"], (), meshes, row["seconds"])


def save_best(rows: pd.DataFrame, folder: Path) -> list[Path]:
    """Write the result file of the best point of each case and setup."""
    solved = records(rows[rows["outcome"] == DONE])
    pairs = dict.fromkeys((row["case"], row["setup"]) for row in solved)
    chosen = [min((r for r in solved if (r["case"], r["setup"]) == pair), key=rank) for pair in pairs]
    titles = [f"{case} {setup}" for case, setup in pairs]
    files = [folder / f"{file_name(title, titles)}.nc" for title in titles]
    return [solution_of(row).save(file) for row, file in zip(chosen, files, strict=True)]
