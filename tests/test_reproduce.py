"""The paper's tables: reduced in the default run, whole behind the marker `long`."""

from __future__ import annotations

from pathlib import Path

import pytest

from pkmsea.paper import Row, calibrated_numbers, reproduce
from pkmsea.solution import solve
from pkmsea.task import load_task

# largest ratio to the rigid robot, true energies; asked for in the first issue, reached by an earlier prototype
AT_MOST = {
    (2, "PKM SEA"): 0.99, (2, "RAPKM SEA"): 1.32, (3, "PKM SEA"): 0.94, (3, "RAPKM SEA"): 1.22,
    (4, "PKM SEA"): 0.75, (4, "RAPKM SEA"): 0.445,
}  # fmt: skip
EXAMPLES = Path(__file__).parents[1] / "examples"
RIGID_ROWS = {2: 0.287, 3: 0.348, 4: 0.373}


def by_setup(rows: list[Row]) -> dict[str, Row]:
    return {row.setup: row for row in rows}


def test_table_1() -> None:
    rows = by_setup(list(reproduce([1], starts=4, workers=1)))
    assert all(row.solution.verified for row in rows.values())
    assert rows["FA-RD"].solution.energy == pytest.approx(4.07, rel=0.005)
    assert rows["FA-SEA"].solution.energy == pytest.approx(2.776, rel=0.01)
    assert rows["FA-SEA"].solution.stiffness[0] == pytest.approx(79.2, rel=0.01)
    assert rows["RA-SEA"].solution.energy <= 1.245
    assert rows["FA-SEA"].remark == "6.1 points below the paper"


def test_table_1_as_the_paper_transcribes_it() -> None:
    """Windows at 200 samples only; the audit must say that they do not hold in between."""
    task = load_task(EXAMPLES / "tasks" / "linear_axis_as_in_the_paper.yaml")
    solutions = {setup.name: solve(task, setup.name, workers=1) for setup in task.setups}
    assert solutions["FA-RD"].claimed == pytest.approx(4.07, rel=0.001)
    assert solutions["FA-SEA"].claimed == pytest.approx(2.897, rel=0.002)
    assert solutions["FA-SEA"].stiffness[0] == pytest.approx(80.5, rel=0.005)
    assert solutions["RA-SEA"].claimed <= 1.30
    assert all("rest window is overstepped" in solution.status for solution in solutions.values())


@pytest.mark.parametrize("table", [2, 3, 4])
def test_calibration_gives_the_rigid_rows(table: int) -> None:
    numbers = calibrated_numbers(table)
    (rigid, *_) = (row for row in reproduce([table], starts=1, workers=1, setups=["PKM RD"]))
    assert rigid.solution.energy == pytest.approx(RIGID_ROWS[table], rel=1e-3)
    assert 60 < numbers["copper_loss"] < 66


@pytest.mark.parametrize("table", [pytest.param(3, marks=pytest.mark.long), 4])
def test_two_arm_rows(table: int) -> None:
    (_, row) = reproduce([table], starts=4, workers=1, setups=["PKM RD", "PKM SEA"])
    assert row.solution.verified
    assert row.ratio <= AT_MOST[table, "PKM SEA"]


@pytest.mark.long
@pytest.mark.parametrize("table", [2, 3, 4])
def test_whole_tables(table: int) -> None:
    rows = by_setup(list(reproduce([table])))
    assert all(row.solution.verified for row in rows.values())
    for setup in ("PKM SEA", "RAPKM SEA"):
        assert rows[setup].ratio <= AT_MOST[table, setup]
    assert rows["RAPKM RD"].ratio > 1  # the third arm's weight costs more than its drive helps
