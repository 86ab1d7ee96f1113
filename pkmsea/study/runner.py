"""A study on its way: from coarse to fine, neighbours starting each other, every finished point stored at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pkmsea.ending import stop_if
from pkmsea.errors import Unwritable
from pkmsea.files import file_name
from pkmsea.problem import Problem
from pkmsea.solution.solution import write
from pkmsea.study.calibrate import with_numbers
from pkmsea.study.jobs import Answer, CalibrationJob, Job, Key, PointJob, PointKey, crashed, failure, run
from pkmsea.study.order import Order, Wait
from pkmsea.study.points import Points, levels, points_of
from pkmsea.study.pool import Pool
from pkmsea.study.search import Searcher
from pkmsea.study.study import KEY, Search, Study
from pkmsea.study.table import CRASHED, DONE, FAILED, OPTIMUM, VERIFIED, Table, first_claim, rank, records
from pkmsea.study.tasks import posed

SEEDS = 6  # best local minima among the points that start the optimum

Row = dict[str, Any]


@dataclass(frozen=True)
class Progress:
    """How far a study is: points done (failed ones among them) of all; `best` is the least energy so far [J]."""

    done: int
    failed: int
    total: int
    best: float


class Runner:
    """Solves the points that are left. What is settled of the points decides which starts the next ones get."""

    def __init__(
        self,
        study: Study,
        out: Path,
        table: Table,
        pool: Pool,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self.study, self.out, self.table, self.pool, self.progress = study, out, table, pool, progress
        self.rows: dict[PointKey, Row] = {}
        self.order: Order[Key, Job] = Order(self._examine)
        self.points = Points((), np.empty((0, 0)), np.empty((0, 0)))
        self.before: dict[int, Sequence[int]] = {}  # the points of coarser levels
        self.failed, self.least = 0, np.inf
        self.calibrated: dict[str, Row] = {key: {"number": x} for key, x in table.calibrated().items()}
        self.calibrations: dict[str, CalibrationJob] = {}
        self.running: dict[PointKey, tuple[Problem, dict[str, float]]] = {}  # with the calibrated numbers in it
        for row in records(table.rows()):
            self._learn(row)
        rounds = 1 if isinstance(study.sample, Search) else study.rounds
        self.total = len(study.cases) * len(study.names) * (study.size * rounds + study.optimum)

    def everything(self) -> None:
        """All points, from coarse to fine and round by round, then the optimum."""
        self._tell()
        if isinstance(self.study.sample, Search):
            self._search(Searcher(self.study, self.study.sample))
            return
        self.points = points_of(self.study)
        done: list[int] = []
        for level in levels(self.points):
            self.before |= dict.fromkeys(level, tuple(done))
            done += level
        pairs = self._pairs()
        keys: list[Key] = [(*pair, i, turn) for turn in range(self.study.rounds) for i in done for pair in pairs]
        self._solve(keys + [(*pair, OPTIMUM, 0) for pair in pairs if self.study.optimum])

    def _pairs(self) -> list[tuple[str, str]]:
        return [(case, setup) for case in self.study.cases for setup in self.study.names]

    def _search(self, searcher: Searcher) -> None:
        """Trials in small groups; each group is asked for when the results of the one before are known."""
        while (points := searcher.ask()) is not None:
            begin = len(points.values) - searcher.asked
            group = range(begin, len(points.values))
            self.points = points
            self.before |= dict.fromkeys(group, range(begin))
            self._solve([(*pair, point, 0) for point in group for pair in self._pairs()])
            case = next(iter(self.study.cases))
            rows = [self._best(case, self.study.names[0], point) for point in group]
            searcher.tell([row["energy"] if row and row["status"] == VERIFIED else None for row in rows])

    def _solve(self, keys: Sequence[Key]) -> None:
        """Solve what these keys stand for, each as soon as it can be, and store the rows as they come."""
        ready = self.order.add(keys)

        def more() -> list[Job]:
            jobs = ready.copy()
            ready.clear()
            return jobs

        for answer in self.pool.unordered(run, more, crashed):
            stop_if()
            self._take(answer)
            ready += self.order.settle(answer.key)

    def _examine(self, key: Key) -> Job | Wait[Key] | None:
        """The job of a key, the key that it waits for, or None where nothing is to be done any more."""
        if isinstance(key, str):
            return None if key in self.calibrated else self.calibrations[key]
        case, setup, point, turn = key
        if key in self.rows:
            return None
        if point == OPTIMUM:
            last = self.study.rounds - 1
            awaited = ((case, setup, i, last) for i in range(len(self.points.values)))
            unsettled = next((other for other in awaited if other not in self.order.settled), None)
            return Wait(unsettled) if unsettled else self._job(key, None, self._minima(case, setup), None)
        values = self.points.at(point)
        if turn == 0:
            near = self._nearest(key, self.before[point], self.study.neighbours)
            if isinstance(near, Wait):
                return near
            own = range(point * self.study.starts + 1, (point + 1) * self.study.starts + 1)
            return self._job(key, values, near, tuple(own) if near else None)
        if (case, setup, point, turn - 1) not in self.order.settled:
            return Wait((case, setup, point, turn - 1))
        near = self._nearest(key, range(len(self.points.values)), 2 * len(self.points.names))
        if isinstance(near, Wait):
            return near
        known = self._parents(key) if turn == 1 else []
        near = [i for i in near if i not in known]
        return self._job(key, values, near, ()) if near and self._best(case, setup, point, turn) else None

    def _nearest(self, key: PointKey, among: Sequence[int], count: int) -> list[int] | Wait[Key]:
        """The points that start a key: the nearest with a motion in the rounds before its own; or what to wait for."""
        case, setup, point, turn = key
        before = max(turn, 1)
        found: list[int] = []
        for i in self.points.nearest(point, among, len(among)):
            if len(found) == count:
                break
            other: Key = (case, setup, i, before - 1)
            if other not in self.order.settled:
                return Wait(other)
            if self._best(case, setup, i, before):
                found.append(i)
        return found

    def _parents(self, key: PointKey) -> list[int]:
        """The points that started a key's point in the first round, which is settled."""
        case, setup, point, _ = key
        near = self._nearest((case, setup, point, 0), self.before[point], self.study.neighbours)
        assert not isinstance(near, Wait)
        return near

    def _job(
        self, key: PointKey, values: dict[str, float] | None, near: Sequence[int], indices: tuple[int, ...] | None
    ) -> Job | Wait[Key] | None:
        """A job, unless its task is impossible; `values` are None for the task as it says itself."""
        case, setup, point, turn = key
        own = self._best(case, setup, point, turn) if turn else None
        file = str(self.study.base.file) if self.study.base.file else None
        numbers: dict[str, float] = {}
        try:
            problem, calibrate = posed(self.study, case, setup, values, self.out)
            for c, reference in calibrate:
                job = CalibrationJob.of(c, with_numbers(reference, **numbers), file)
                if job.key not in self.calibrated:
                    self.calibrations[job.key] = job
                    return Wait(job.key)
                if "number" not in (found := self.calibrated[job.key]):
                    self._add(key, found)
                    return None
                numbers[c.number] = found["number"]
            problem = with_numbers(problem, **numbers)
        except Unwritable:
            raise
        except Exception as error:  # a point that fails must not take the others with it
            self._add(key, failure(error))
            return None
        self.running[key] = problem, numbers
        before = self.study.rounds if point == OPTIMUM else turn or 1
        motions = tuple(row["motion"] for i in near if (row := self._best(case, setup, i, before)))
        known = first_claim(own) if own else None
        keep = self.study.results == "all" and point != OPTIMUM
        return PointJob(problem=problem, file=file, key=key, near=motions, indices=indices, known=known, keep=keep)

    def _take(self, answer: Answer) -> None:
        """Store what has come of a job."""
        key, found = answer.key, dict(answer.found)
        if isinstance(key, str):
            self.calibrated[key] = found
            if "number" in found:
                self.table.add_calibrated(key, found["number"])
            return
        problem, numbers = self.running.pop(key)
        if answer.dataset is not None:
            case, setup, point, turn = key
            folders = file_name(case, list(self.study.cases)), file_name(setup, self.study.names)
            write(answer.dataset, problem, self.out.joinpath("results", *folders, f"{point}_{turn}.nc"))
        self._add(key, numbers | found)

    def _add(self, key: PointKey, found: Row) -> None:
        values = {} if key[2] == OPTIMUM else self.points.at(key[2])
        row = dict(zip(KEY, key, strict=True)) | values | found
        self.table.add(row)
        self._learn(row)
        self._tell()

    def _learn(self, row: Row) -> None:
        self.rows[row["case"], row["setup"], row["point"], row["round"]] = row
        self.failed += row["outcome"] in (FAILED, CRASHED)
        if row["status"] == VERIFIED:
            self.least = min(self.least, row["energy"])

    def _best(self, case: str, setup: str, point: int, before: int = 1) -> Row | None:
        """The best row with a motion of a point, of the rounds before one."""
        rows = [self.rows.get((case, setup, point, turn)) for turn in range(before)]
        return min((row for row in rows if row and row["outcome"] == DONE), key=rank, default=None)

    def _minima(self, case: str, setup: str) -> list[int]:
        """Points that are no worse than their neighbours, best first."""
        points, rounds = self.points, self.study.rounds
        every = range(len(points.values))
        energy = {i: rank(row) for i in every if (row := self._best(case, setup, i, rounds))}
        around = {i: points.nearest(i, list(energy), 2 * len(points.names)) for i in energy}
        minima = [i for i in energy if all(energy[i] <= energy[j] for j in around[i])]
        return sorted(minima, key=lambda i: energy[i])[:SEEDS]

    def _tell(self) -> None:
        if self.progress is not None:
            self.progress(Progress(len(self.rows), self.failed, self.total, self.least))
