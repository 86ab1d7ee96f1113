"""What a study hands out, solved in whatever process it lands in: values in, values out; no file is read or written."""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from hashlib import sha256
from typing import Any

from pkmsea.errors import InputError, PkmseaError, SolveError, Unwritable, blaming
from pkmsea.problem import Problem, task_of
from pkmsea.solution import Solution
from pkmsea.solution.netcdf import Dataset
from pkmsea.solution.records import motion_of, motion_record
from pkmsea.solution.solve import NEAR, select
from pkmsea.solver import Start
from pkmsea.solver.multistart import distinct, finish, multistart, restart, run_start
from pkmsea.solver.threads import one_thread
from pkmsea.study.calibrate import calibrated
from pkmsea.study.fingerprint import versions
from pkmsea.study.study import Calibration
from pkmsea.study.table import CRASHED, DONE, FAILED, NO_BETTER, UNVERIFIED, VERIFIED
from pkmsea.transcription import Transcription, transcribe

BETTER = 1e-3  # relative: what a later round must gain on the first mesh to be worth refining

PointKey = tuple[str, str, int, int]  # case, setup, point, round: the row in the table
Key = PointKey | str  # or what a calibrated number depends on


@dataclass(frozen=True)
class Answer:
    """What has come of a job: columns of its row, `number` where that was looked for, and the `dataset` to save."""

    key: Key
    found: Mapping[str, Any]
    dataset: Dataset | None = None


@dataclass(frozen=True, kw_only=True)
class Job(ABC):
    """A problem, to be solved as a subclass says; errors name `file`, and only these `versions` solve it."""

    key: Any
    problem: Problem
    file: str | None = None
    versions: str = field(default_factory=versions)

    @abstractmethod
    def solve(self, begin: float) -> Answer:
        """Solve it; `begin` is when that began, by `time.perf_counter`."""


@dataclass(frozen=True, kw_only=True)
class CalibrationJob(Job):
    """A drive number to find, told by the problem's energy."""

    key: str
    calibration: Calibration

    @classmethod
    def of(cls, calibration: Calibration, problem: Problem, file: str | None) -> CalibrationJob:
        text = task_of(problem).model_dump_json() + calibration.model_dump_json()
        return cls(key=sha256(text.encode()).hexdigest(), calibration=calibration, problem=problem, file=file)

    def solve(self, begin: float) -> Answer:
        c = self.calibration
        return Answer(self.key, {"number": calibrated(self.problem, c.number, c.energy, c.start, c.tolerance)})


@dataclass(frozen=True, kw_only=True)
class PointJob(Job):
    """A point to solve.

    Attributes
    ----------
    near : motions of neighbours, as `motion_record`s in JSON, each a start.
    indices : of the random starts beside; None for the whole multi-start of the task.
    known : what this point's best solution so far claims on the first mesh [J]; None in the first round.
    keep : whether the solution is to be saved.
    """

    key: PointKey
    near: tuple[str, ...] = ()
    indices: tuple[int, ...] | None = None
    known: float | None = None
    keep: bool = False

    def solve(self, begin: float) -> Answer:
        transcription = transcribe(self.problem)
        starts = self._starts(transcription)
        claimed = min((start.claimed for start in starts), default=float("inf"))
        if self.known is not None and not claimed < (1 - BETTER) * self.known:
            return Answer(self.key, {"outcome": NO_BETTER, "status": NO_BETTER, "starts": len(starts)})
        known = starts[: len(self.near)] if self.indices is None else []  # their motions were known on finer meshes
        solution = select(transcription, starts, workers=1, begin=begin, required=known)
        if solution.interrupted:
            raise KeyboardInterrupt
        return Answer(self.key, record(solution), solution.dataset() if self.keep else None)

    def _starts(self, transcription: Transcription) -> list[Start]:
        starts = [restart(transcription, motion_of(json.loads(text))) for text in self.near]
        if self.indices is None:
            found, interrupted = multistart(transcription, workers=1)
            if interrupted:
                raise KeyboardInterrupt
            return starts + found
        enough = (1 + NEAR) * min((start.claimed for start in starts), default=float("inf"))
        own = [run_start(transcription, index) for index in self.indices]
        return starts + [finish(transcription, start) if start.claimed <= enough else start for start in own]


@one_thread
def run(job: Job) -> Answer:
    """What comes of a job, an error of its problem as well.

    Raises
    ------
    SolveError : this process has other versions. KeyboardInterrupt
    """
    if job.versions != versions():
        raise SolveError(
            f"A process of the study has {versions()}, but the study was started with {job.versions}.",
            "Give all of them the same environment.",
        )
    begin = time.perf_counter()
    try:
        with blaming(job.file):
            answer = job.solve(begin)
    except Exception as error:  # a point that fails must not take the others with it
        answer = Answer(job.key, failure(error))
    return replace(answer, found=dict(answer.found) | {"seconds": time.perf_counter() - begin})


def failure(error: Exception) -> dict[str, Any]:
    """The row of a point without a solution: that is its own, or the error tells nothing of it, as a full memory."""
    own = isinstance(error, InputError | SolveError) and not isinstance(error, Unwritable)
    reason = str(error) if isinstance(error, PkmseaError) else f"{type(error).__name__}: {error}"
    return {"outcome": FAILED if own else CRASHED, "status": FAILED, "reason": reason}


def crashed(job: Job) -> Answer:
    """The answer to a job whose processes died."""
    return Answer(job.key, {"outcome": CRASHED, "status": FAILED, "reason": "its process died again and again"})


def record(solution: Solution) -> dict[str, Any]:
    """A solution as columns of a row: numbers for people, and what makes it a `Solution` again."""
    return {
        "outcome": DONE,
        "energy": solution.value,
        "claimed": solution.claimed,
        "status": VERIFIED if solution.verified else UNVERIFIED,
        "reason": "" if solution.verified else "; ".join(solution.faults),
        "starts": len(solution.starts),
        "stiffness": [float(x) for x in solution.motion.stiffness],
        "optima": json.dumps(_optima(solution)),
        "motion": json.dumps(motion_record(solution.motion)),
        "meshes": json.dumps([asdict(mesh) for mesh in solution.meshes]),
    }


def _optima(solution: Solution) -> list[dict[str, Any]]:
    """Energy as claimed [J] and stiffness of the distinct optima of all starts, best first."""
    return [{"claimed": s.claimed, "stiffness": list(s.stiffness)} for s in distinct(solution.starts)]
