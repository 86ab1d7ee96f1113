"""Running a study: from coarse to fine, neighbours starting each other, every finished point stored at once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pkmsea.ending import deferred, stop_if
from pkmsea.errors import InputError, one_line
from pkmsea.files import file_name
from pkmsea.solution import Solution
from pkmsea.study.fingerprint import fingerprint
from pkmsea.study.order import Order, Wait
from pkmsea.study.point import Job, failure, lost, reason, save_best, solution_of, solve_point
from pkmsea.study.points import Points, levels, points_of
from pkmsea.study.pool import Pool, open_pool
from pkmsea.study.search import Searcher
from pkmsea.study.study import KEY, Search, Study, load_study
from pkmsea.study.table import DONE, FAILED, HIDDEN, NAME, VERIFIED, Table, best, first_claim, rank, records
from pkmsea.study.tasks import check, posed

CALIBRATED = "calibrated"  # folder
OPTIMUM = -1  # the point that stands for the task as it says itself
SEEDS = 6  # best local minima among the points that start the optimum

Key = tuple[str, str, int, int]  # case, setup, point, round
Row = dict[str, Any]


@dataclass(frozen=True)
class Progress:
    """How far a study is: points done (failed ones among them) of all; `best` is the least energy so far [J]."""

    done: int
    failed: int
    total: int
    best: float


@dataclass(frozen=True, eq=False, repr=False)
class StudyResult:
    """What a study has found; `rows` are all solved rows, `folder` is where table and result files are."""

    study: Study
    rows: pd.DataFrame
    folder: Path
    interrupted: bool

    def __repr__(self) -> str:
        stopped = ", interrupted" if self.interrupted else ""
        return one_line(f"<StudyResult '{self.study.name}': {len(self.rows)} rows in {self.folder}{stopped}>")

    @property
    def table(self) -> pd.DataFrame:
        """The best row of every case, setup and point: parameters, energy [J], stiffness c_i, status and so on."""
        return best(self.rows[self.rows["point"] != OPTIMUM]).drop(columns=HIDDEN)

    @property
    def optima(self) -> pd.DataFrame:
        """The task as it says itself, by case and setup; empty without `optimum`."""
        return best(self.rows[self.rows["point"] == OPTIMUM])

    def solution(self, case: str, setup: str, point: int) -> Solution:
        """The best solution of a point, ready to be drawn, played, verified or exported; -1 is the optimum.

        Raises
        ------
        InputError : there is no solution of this point.
        """
        found = best(self.rows[self.rows["outcome"] == DONE])
        chosen = found[(found["case"] == case) & (found["setup"] == setup) & (found["point"] == point)]
        if chosen.empty:
            raise InputError(
                f"Point {point} of case '{case}' and setup '{setup}' has no solution.",
                "Look at the table for those that have.", file=self.folder / NAME,
            )  # fmt: skip
        return solution_of(records(chosen)[0])


def run_study(
    source: Study | str | Path,
    out: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> StudyResult:
    """Run a study, or what is left of it, into a folder.

    Parameters
    ----------
    source : a study, or the path of a study file.
    out : folder of the table (study.sqlite), of result files and of changed mechanisms.
    workers : processes; default: the cores that this process may use. Results do not depend on it.
    scheduler : address of a Dask scheduler whose workers are used instead; they must see `out` under the same path.
    progress : called after every point.

    Raises
    ------
    InputError : the study is wrong, or the folder holds points of another one.
    """
    study = load_study(source) if isinstance(source, str | Path) else source
    out = Path(out)
    drives = check(study, out)
    interrupted = False
    with open_pool(workers, scheduler) as pool, deferred():
        table = Table(out / NAME, list(study.vary), drives, fingerprint(study))
        try:
            _Run(study, out, table, pool, progress).everything()
        except KeyboardInterrupt:
            interrupted = True
    rows = table.rows()
    table.close()
    if study.results != "none":
        save_best(best(rows), out / "best")
    return StudyResult(study, rows, out, interrupted)


class _Run:
    """A study on its way. What is settled of the points decides which starts the next ones get."""

    def __init__(
        self,
        study: Study,
        out: Path,
        table: Table,
        pool: Pool,
        progress: Callable[[Progress], None] | None,
    ) -> None:
        self.study, self.out, self.table, self.pool, self.progress = study, out, table, pool, progress
        self.rows: dict[Key, Row] = {}
        self.order: Order[Key, Job] = Order(self._examine)
        self.points = Points((), np.empty((0, 0)), np.empty((0, 0)))
        self.before: dict[int, Sequence[int]] = {}  # the points of coarser levels
        self.failed, self.least = 0, np.inf
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
        keys = [(*pair, point, turn) for turn in range(self.study.rounds) for point in done for pair in pairs]
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

        for row in self.pool.unordered(solve_point, more, lost):
            stop_if()
            self._add(row)
            ready += self.order.settle(tuple(row[name] for name in KEY))

    def _examine(self, key: Key) -> Job | Wait[Key] | None:
        """The job of a key, the key that it waits for, or None where nothing is to be done any more."""
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

    def _nearest(self, key: Key, among: Sequence[int], count: int) -> list[int] | Wait[Key]:
        """The points that start a key: the nearest with a motion in the rounds before its own; or what to wait for."""
        case, setup, point, turn = key
        before = max(turn, 1)
        found: list[int] = []
        for i in self.points.nearest(point, among, len(among)):
            if len(found) == count:
                break
            if (other := (case, setup, i, before - 1)) not in self.order.settled:
                return Wait(other)
            if self._best(case, setup, i, before):
                found.append(i)
        return found

    def _parents(self, key: Key) -> list[int]:
        """The points that started a key's point in the first round, which is settled."""
        case, setup, point, _ = key
        near = self._nearest((case, setup, point, 0), self.before[point], self.study.neighbours)
        assert not isinstance(near, Wait)
        return near

    def _job(
        self, key: Key, values: dict[str, float] | None, near: Sequence[int], indices: tuple[int, ...] | None
    ) -> Job | None:
        """A job, unless its task is impossible; `values` are None for the task as it says itself."""
        case, setup, point, turn = key
        own = self._best(case, setup, point, turn) if turn else None
        try:
            problem, calibrate = posed(self.study, case, setup, values, self.out)
        except Exception as error:  # a point that fails must not take the others with it
            self._add(failure(key, values or {}, reason(error)))
            return None
        before = self.study.rounds if point == OPTIMUM else turn or 1
        rows = [row for i in near if (row := self._best(case, setup, i, before))]
        file = None
        if self.study.results == "all" and point != OPTIMUM:
            folders = file_name(case, list(self.study.cases)), file_name(setup, self.study.names)
            file = str(self.out.joinpath("results", *folders, f"{point}_{turn}.nc"))
        origin = str(self.study.base.file.resolve()) if self.study.base.file else None
        near_motions, known = tuple(row["motion"] for row in rows), first_claim(own) if own else None
        cache = str(self.out / CALIBRATED)
        return Job(key, values or {}, problem, origin, near_motions, indices, known, calibrate, cache, file)

    def _add(self, row: Row) -> None:
        self.table.add(row)
        self._learn(row)
        self._tell()

    def _learn(self, row: Row) -> None:
        self.rows[row["case"], row["setup"], row["point"], row["round"]] = row
        self.failed += row["outcome"] == FAILED
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
