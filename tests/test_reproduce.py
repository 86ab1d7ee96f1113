"""The paper's tables in both readings: reduced in the default run, whole behind the marker `long`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pkmsea.paper import READINGS, Reading, Row, calibrated_numbers, reproduce
from pkmsea.paper.readings import WITHOUT_LIMITS, assumed, paper_tables, table_task
from pkmsea.problem import build_problem
from pkmsea.solution import solve
from pkmsea.solution.audit import audit
from pkmsea.task import load_task

# largest ratio to the rigid robot, true energies; asked for in the first issue, reached by an earlier prototype
AT_MOST = {
    (2, "PKM SEA"): 0.981, (2, "RAPKM SEA"): 1.32, (3, "PKM SEA"): 0.933, (3, "RAPKM SEA"): 1.214,
    (4, "PKM SEA"): 0.746, (4, "RAPKM SEA"): 0.429,
}  # fmt: skip
# what a closed-form model with quintic splines finds at the implied rests: ratio, and how near
IMPLIED = {(2, "PKM SEA"): (0.984, 0.005), (3, "PKM SEA"): (0.851, 0.005), (4, "PKM SEA"): (0.40, 0.015)}
IMPLIED |= {(3, "RAPKM SEA"): (1.207, 0.007)}
AT_PAPER = {(2, "RAPKM SEA"): (1.405, 0.015)}
EXAMPLES = Path(__file__).parents[1] / "examples"
RIGID_ROWS = {2: 0.287, 3: 0.348, 4: 0.373}


def by_setup(rows: list[Row]) -> dict[str, Row]:
    return {row.setup: row for row in rows}


def test_table_1() -> None:
    rows = by_setup(list(reproduce([1], readings=["printed"], workers=1, setups=["FA-RD", "FA-SEA"])))
    assert all(row.solution.verified for row in rows.values())
    assert rows["FA-RD"].solution.energy == pytest.approx(4.07, rel=0.005)
    assert rows["FA-SEA"].solution.energy == pytest.approx(2.776, rel=0.01)
    assert rows["FA-SEA"].solution.stiffness[0] == pytest.approx(79.2, rel=0.01)
    assert rows["FA-SEA"].remark.startswith("6.1 points below the paper: a rest of 0.24 s")


@pytest.mark.long
def test_redundant_row_of_table_1() -> None:
    *_, row = reproduce([1], readings=["printed"], setups=["FA-RD", "RA-SEA"])
    assert row.solution.verified and row.solution.energy <= 1.245
    assert row.ratio_at_paper == pytest.approx(0.44, abs=0.01)


def test_the_rest_of_the_linear_axis() -> None:
    (_, row) = reproduce([1], readings=["implied"], workers=1, setups=["FA-RD", "FA-SEA"])
    assert row.solution.verified and row.ratio == pytest.approx(0.743, abs=0.005)
    assert row.record()["at_paper_stiffness"]["ratio"] == pytest.approx(0.753, abs=0.005)


AS_IN_THE_PAPER = EXAMPLES / "tasks" / "linear_axis_as_in_the_paper.yaml"


@pytest.mark.parametrize(("setup", "claimed", "stiffness"), [("FA-RD", 4.07, []), ("FA-SEA", 2.897, [80.5])])
def test_table_1_as_the_paper_transcribes_it(setup: str, claimed: float, stiffness: list[float]) -> None:
    """Windows at 200 samples only; the audit must say that they do not hold in between."""
    solution = solve(load_task(AS_IN_THE_PAPER).with_starts(1), setup, workers=1)
    assert solution.claimed == pytest.approx(claimed, rel=0.002)
    assert solution.stiffness == pytest.approx(stiffness, rel=0.005)
    assert "rest window is overstepped" in solution.status


@pytest.mark.long
def test_redundant_row_as_the_paper_transcribes_it() -> None:
    solution = solve(load_task(AS_IN_THE_PAPER), "RA-SEA", workers=1)
    assert solution.claimed <= 1.30
    assert "rest window is overstepped" in solution.status


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("table", [2, 3, 4])
def test_calibration_gives_the_rigid_rows(table: int, reading: Reading) -> None:
    numbers = calibrated_numbers(table, reading=reading)
    (rigid, *_) = reproduce([table], readings=[reading], starts=1, workers=1, setups=["PKM RD"])
    assert rigid.solution.energy == pytest.approx(RIGID_ROWS[table], rel=1e-3)
    assert numbers["copper_loss"] == pytest.approx(88.1 if reading == "implied" else 63.3, rel=2e-3)


def test_readings_differ_by_rests_and_seeds_alone() -> None:
    printed, implied = (table_task(3, reading=reading) for reading in READINGS)
    as_printed = {"points": printed.cycle.points}
    setups = tuple(setup.model_copy(update={"seed": None}) for setup in implied.setups)
    again = implied.model_copy(update={"cycle": implied.cycle.model_copy(update=as_printed), "setups": setups})
    assert again == printed
    signs = assumed()["readings"]["implied"]["elbow_signs"]["value"]
    for setup in implied.setups:
        mechanism = build_problem(implied, setup.name).mechanism
        of = dict(zip(mechanism.joints, mechanism.seed, strict=True))
        assert all(np.sign(-of[f"elbow_{arm}"]) == signs[arm] for arm in mechanism.description.actuated)


def test_a_value_says_where_it_is_from() -> None:
    def values(record: dict[str, Any]) -> Iterator[dict[str, Any]]:
        for inner in record.values():
            if isinstance(inner, dict):
                yield from [inner] if "value" in inner else values(inner)

    for value in values(assumed()):
        assert value["from"] in ("stated", "calibrated", "inferred", "assumed") and value["reason"]


@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("table", [pytest.param(3, marks=pytest.mark.long), 4])
def test_two_arm_rows(table: int, reading: Reading) -> None:
    (_, row) = reproduce([table], readings=[reading], starts=4, workers=1, setups=["PKM RD", "PKM SEA"])
    assert row.solution.verified
    if reading == "printed":
        assert row.ratio <= AT_MOST[table, "PKM SEA"]
    else:
        ratio, near = IMPLIED[table, "PKM SEA"]
        assert row.ratio == pytest.approx(ratio, abs=near)
        assert row.solution.stiffness == pytest.approx(row.paper_stiffness, rel=0.3)


def test_the_papers_two_tables_contradict_each_other() -> None:
    """0.422 J with friction and 0.424 J without cannot both be least: a motion of one costs less in the other."""
    *_, row = reproduce([3], readings=["implied"], starts=2, workers=1, setups=["PKM RD", "RAPKM SEA"])
    rows = {table: paper_tables()[table]["rows"]["RAPKM SEA"]["energy"] for table in (2, 3)}
    assert row.solution.energy <= rows[3]
    frictionless = build_problem(table_task(2, calibrated_numbers(2, reading="implied"), "implied"), "RAPKM SEA")
    costs = audit(frictionless, row.solution.motion, 0.0)[0].value
    assert costs < row.solution.energy < rows[2]


@pytest.mark.long
@pytest.mark.parametrize("reading", READINGS)
@pytest.mark.parametrize("table", [2, 3, 4])
def test_whole_tables(table: int, reading: Reading) -> None:
    rows = by_setup(list(reproduce([table], readings=[reading])))
    assert all(row.solution.verified for row in rows.values())
    assert rows["RAPKM RD"].ratio > 1  # the third arm's weight costs more than its drive helps
    if reading == "printed":
        assert all(rows[setup].ratio <= AT_MOST[table, setup] for setup in ("PKM SEA", "RAPKM SEA"))
    expected = {setup: value for (of, setup), value in IMPLIED.items() if of == table and reading == "implied"}
    for setup, (ratio, near) in expected.items():
        assert rows[setup].ratio == pytest.approx(ratio, abs=near)
    if reading == "implied" and table == 2:
        ratio, near = AT_PAPER[2, "RAPKM SEA"]
        assert rows["RAPKM SEA"].ratio_at_paper == pytest.approx(ratio, abs=near)
    if reading == "implied" and table == 4:
        assert rows["RAPKM SEA"].ratio <= 0.335
        assert rows["RAPKM SEA"].ratio_at_paper <= 0.442  # of many valleys; the paper's own value is 43.2 to 44.2 %
    assert (WITHOUT_LIMITS in rows) == (table == 2 and reading == "printed")
