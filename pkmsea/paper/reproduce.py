"""The paper's four tables beside ours, solved anew."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from pkmsea.errors import SolveError
from pkmsea.files import read_yaml
from pkmsea.solution import Solution, solve
from pkmsea.solver import Start
from pkmsea.study import calibrate, with_drive_numbers
from pkmsea.task import Task, load_task

FOLDER = Path(__file__).parent
TABLES = (1, 2, 3, 4)
POINTS_OF_DIFFERENCE = 3.0  # percentage points of the ratio beyond which a row carries a remark
START = {"copper_loss": 63.4, "friction": 4.75e-3, "inertia": 4.6e-4}  # where the calibrations begin

Report = Callable[[int, str, Start], None]


@dataclass(frozen=True, eq=False)
class Row:
    """One row of a table: the paper's values and ours. Energies in J.

    Ratios are relative to the rigid row, and None where that one has failed; so is `reference_verified`.
    """

    table: int
    title: str
    solution: Solution
    ratio: float | None
    reference_verified: bool | None
    paper_energy: float | None
    paper_ratio: float | None
    paper_stiffness: tuple[float, ...]
    assumed: dict[str, float]

    @property
    def setup(self) -> str:
        return self.solution.name

    @property
    def remark(self) -> str:
        """Says so where ours differs from the paper's ratio by more than POINTS_OF_DIFFERENCE."""
        if self.reference_verified is False:
            return "* the rigid row is not verified"
        if self.paper_ratio is None:
            return "not in the paper"
        if self.ratio is None:
            return "the rigid row has failed"
        points = 100 * (self.ratio - self.paper_ratio)
        if abs(points) <= POINTS_OF_DIFFERENCE:
            return ""
        why = "; base geometry and working mode are assumed" if self.table > 1 else ""
        return f"{abs(points):.1f} points {'below' if points < 0 else 'above'} the paper{why}"

    def record(self) -> dict[str, Any]:
        """The row as plain data, for `pkmsea reproduce --json`."""
        s = self.solution
        return {
            "table": self.table,
            "setup": self.setup,
            "energy": s.energy,
            "claimed": s.claimed,
            "ratio": self.ratio,
            "reference_verified": self.reference_verified,
            "stiffness": [float(c) for c in s.stiffness],
            "paper_energy": self.paper_energy,
            "paper_ratio": self.paper_ratio,
            "paper_stiffness": list(self.paper_stiffness),
            "status": s.status,
            "verified": s.verified,
            "seconds": s.seconds,
            "assumed": self.assumed,
            "remark": self.remark,
        }


@cache
def paper_tables() -> dict[int, dict[str, Any]]:
    """The values that the paper prints, by table number."""
    tables: dict[int, dict[str, Any]] = read_yaml(FOLDER / "tables.yaml")
    return tables


def paper_task(table: int, numbers: dict[str, float] | None = None) -> Task:
    """The task of a table, with calibrated numbers of the drives put in."""
    return with_drive_numbers(load_task(FOLDER / ("linear_axis.yaml" if table == 1 else "pkm.yaml")), **numbers or {})


def calibrated_numbers(table: int, note: Callable[[str], None] | None = None) -> dict[str, float]:
    """The drive numbers of tables 2 to 4, each calibrated on a rigid row of the paper (see assumed.yaml)."""
    if table == 1:
        return {}
    say = note or (lambda text: None)
    say("calibrating the copper loss")
    numbers = {"copper_loss": _calibrated("copper_loss", 2, ())}
    if table == 3:
        say("calibrating the friction")
        numbers["friction"] = _calibrated("friction", 3, tuple(numbers.items()))
    if table == 4:
        say("calibrating the rotor inertia")
        numbers["inertia"] = _calibrated("inertia", 4, tuple(numbers.items()))
    return numbers


@cache
def _calibrated(number: Any, table: int, others: tuple[tuple[str, float], ...]) -> float:
    energy = paper_tables()[table]["rows"]["PKM RD"]["energy"]
    return calibrate(paper_task(2, dict(others)), "PKM RD", number, energy, START[number])


def reproduce(
    tables: Iterable[int] = TABLES,
    *,
    workers: int | None = None,
    report: Report | None = None,
    note: Callable[[str], None] | None = None,
    starts: int | None = None,
    setups: Sequence[str] | None = None,
    failed: Callable[[int, str, SolveError], None] | None = None,
) -> Iterator[Row]:
    """Solve the setups of the paper's tables and yield a row as soon as it is there.

    Tables 2 to 4 end with RAPKM RD, which the paper leaves out. `starts` overrides the multi-start's size,
    `setups` keeps only the named rows; the rigid row comes first in every table and must be among them. A setup without
    a solution is told to `failed` (table, setup, error), and the others go on; without it, its error is raised.
    """
    for table in tables:
        numbers = calibrated_numbers(table, note)
        task = paper_task(table, numbers)
        if starts is not None:
            task = task.with_starts(starts)
        chosen = [setup.name for setup in task.setups if setups is None or setup.name in setups]
        rigid: Solution | None = None
        for name in chosen:
            tell = None if report is None else (lambda start, n=name, t=table: report(t, n, start))
            try:
                solution = solve(task, name, workers=workers, progress=tell)
            except SolveError as error:
                if failed is None:
                    raise
                failed(table, name, error)
                continue
            rigid = solution if name == chosen[0] else rigid
            yield _row(table, solution, rigid, numbers)


def _row(table: int, solution: Solution, rigid: Solution | None, numbers: dict[str, float]) -> Row:
    printed = paper_tables()[table]
    rows, reference = printed["rows"], next(iter(printed["rows"].values()))["energy"]
    paper = rows.get(solution.name)
    assumed = numbers or {"copper_loss": solution.problem.actuation.drives[0].copper_loss}
    ratio = None if rigid is None else solution.energy / rigid.energy
    verified = None if rigid is None else rigid.verified
    if paper is None:
        return Row(table, printed["title"], solution, ratio, verified, None, None, (), assumed)
    return Row(
        table, printed["title"], solution, ratio, verified, paper["energy"], paper["energy"] / reference,
        tuple(paper["stiffness"]), assumed,
    )  # fmt: skip
