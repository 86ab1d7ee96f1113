"""The paper's four tables beside ours, solved anew in both readings."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from pkmsea.errors import SolveError
from pkmsea.paper.readings import (
    READINGS,
    RIGID,
    TABLES,
    WITHOUT_LIMITS,
    Numbers,
    Reading,
    assumed,
    at_stiffness,
    calibrated_numbers,
    paper_tables,
    table_task,
)  # fmt: skip
from pkmsea.solution import Solution, solve
from pkmsea.solver import Start
from pkmsea.task import Task

POINTS_OF_DIFFERENCE = 3.0  # percentage points of the ratio beyond which a row carries a remark
AT_PAPER_STARTS = 6  # of a solve at the paper's own springs, at most

Report = Callable[[str, int], Callable[[Start], None]]


@dataclass(frozen=True, eq=False)
class Row:
    """One row of a table in one reading: the paper's values and ours. Energies in J.

    Ratios are relative to the rigid row, and None where that one has failed; so is `reference_verified`. `at_paper` is
    our optimum with the paper's springs, None where there are none or it has failed.
    """

    table: int
    reading: Reading
    title: str
    solution: Solution
    at_paper: Solution | None
    rigid: Solution | None
    paper_energy: float | None
    paper_ratio: float | None
    paper_stiffness: tuple[float, ...]
    assumed: Numbers

    @property
    def setup(self) -> str:
        return self.solution.name

    @property
    def interrupted(self) -> bool:
        """Whether an interrupt ended a solve of this row."""
        return any(s is not None and s.interrupted for s in (self.solution, self.at_paper))

    @property
    def ratio(self) -> float | None:
        return self._relative(self.solution)

    @property
    def ratio_at_paper(self) -> float | None:
        return self._relative(self.at_paper)

    @property
    def reference_verified(self) -> bool | None:
        return None if self.rigid is None else self.rigid.verified

    def _relative(self, solution: Solution | None) -> float | None:
        return None if solution is None or self.rigid is None else solution.energy / self.rigid.energy

    @property
    def remark(self) -> str:
        """Says so where ours differs from the paper's ratio by more than POINTS_OF_DIFFERENCE, and why."""
        if self.reference_verified is False:
            return "* the rigid row is not verified"
        if self.paper_ratio is None:
            return "not in the paper"
        if self.ratio is None:
            return "the rigid row has failed"
        points = 100 * (self.ratio - self.paper_ratio)
        if abs(points) <= POINTS_OF_DIFFERENCE:
            return ""
        reason = assumed()["readings"][self.reading]["reasons"].get(self.table, {}).get(self.setup, "")
        said = f"{abs(points):.1f} points {'below' if points < 0 else 'above'} the paper"
        return f"{said}: {reason}" if reason else said

    def record(self) -> dict[str, Any]:
        """The row as plain data, for `pkmsea reproduce --json`."""
        s, at = self.solution, self.at_paper
        return {
            "table": self.table,
            "reading": self.reading,
            "setup": self.setup,
            "energy": s.energy,
            "claimed": s.claimed,
            "ratio": self.ratio,
            "reference_verified": self.reference_verified,
            "stiffness": [float(c) for c in s.stiffness],
            "at_paper_stiffness": at and {"energy": at.energy, "ratio": self.ratio_at_paper, "status": at.status},
            "paper_energy": self.paper_energy,
            "paper_ratio": self.paper_ratio,
            "paper_stiffness": list(self.paper_stiffness),
            "status": s.status,
            "verified": s.verified,
            "seconds": s.seconds,
            "assumed": self.assumed,
            "remark": self.remark,
        }


def reproduce(
    tables: Iterable[int] = TABLES,
    *,
    readings: Sequence[Reading] = READINGS,
    workers: int | None = None,
    report: Report | None = None,
    note: Callable[[str], None] | None = None,
    starts: int | None = None,
    setups: Sequence[str] | None = None,
    failed: Callable[[int, Reading, str, SolveError], None] | None = None,
) -> Iterator[Row]:
    """Solve the setups of the paper's tables in each reading and yield a row as soon as it is there.

    Tables 2 to 4 end with RAPKM RD, which the paper leaves out. `starts` overrides the multi-start's size,
    `setups` keeps only the named rows; the rigid row comes first in every table and must be among them. A setup without
    a solution is told to `failed` (table, reading, setup, error), and the others go on; without it, its error comes.
    """
    for table in tables:
        for reading in readings:
            numbers = calibrated_numbers(table, note, reading)
            task = table_task(table, numbers, reading)
            if starts is not None:
                task = task.with_starts(starts)
            rigid: Solution | None = None
            for name in [s.name for s in task.setups if setups is None or s.name in setups]:
                tell = report and report(f"table {table} {reading}, {name}", task.options.starts)
                try:
                    solution = solve(task, name, workers=workers, progress=tell)
                except SolveError as error:
                    if failed is None:
                        raise
                    failed(table, reading, name, error)
                    continue
                rigid = solution if name == RIGID[table] else rigid
                at_paper, interrupt = None, None
                try:
                    at_paper = None if solution.interrupted else _at_paper(table, task, name, workers)
                except SolveError:
                    pass
                except KeyboardInterrupt as error:
                    interrupt = error
                yield _row(table, reading, solution, at_paper, rigid, numbers)
                if interrupt is not None:
                    raise interrupt


def _at_paper(table: int, task: Task, name: str, workers: int | None) -> Solution | None:
    """The optimum with the paper's own springs."""
    springs = tuple(paper_tables()[table]["rows"].get(name, {}).get("stiffness", ()))
    if not springs:
        return None
    fixed = at_stiffness(task.setup(name), springs)
    only = task.model_copy(update={"setups": (fixed,)})
    return solve(only.with_starts(min(task.options.starts, AT_PAPER_STARTS)), name, workers=workers)


def _row(
    table: int,
    reading: Reading,
    solution: Solution,
    at_paper: Solution | None,
    rigid: Solution | None,
    numbers: Numbers,
) -> Row:
    printed = paper_tables()[table]
    rows, reference = printed["rows"], printed["rows"][RIGID[table]]["energy"]
    paper = rows.get("RAPKM SEA" if solution.name == WITHOUT_LIMITS else solution.name)
    energy, ratio, springs = (
        (paper["energy"], paper["energy"] / reference, tuple(paper["stiffness"])) if paper else (None, None, ())
    )
    return Row(table, reading, printed["title"], solution, at_paper, rigid, energy, ratio, springs, numbers)
