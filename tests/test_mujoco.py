"""A second engine: MuJoCo, with its own dynamics, constraints and steps, needs the energy that a result prints."""

from __future__ import annotations

from dataclasses import replace

import pytest
from conftest import ELASTIC, RIGID, SLIDER_ELASTIC, task
from mujoco_replay import Replay, replay

from pkmsea.paper import reproduce
from pkmsea.solution import Solution, solve
from pkmsea.verification.dynamics import Robot
from pkmsea.verification.reference import Reference, reference

ENERGY = 0.01  # asked for; MuJoCo agrees to 3e-6
END_EFFECTOR = 1e-4  # [m]; its steps are of the order of 1e-4 s
CLOSURE = 1e-6  # [m]; its constraints are springs
FEEDBACK = 1e-3
SETUPS = {
    "slider": ("linear_axis_2", SLIDER_ELASTIC),
    "two rigid arms": ("pkm_2rrr", RIGID),
    "two elastic arms": ("pkm_2rrr", ELASTIC | {"friction": 4.79e-3}),
    "three rigid arms": ("pkm_3rrr", RIGID),
    "three elastic arms": ("pkm_3rrr", ELASTIC),
}


def replayed(said: Reference) -> Replay:
    return replay(Robot(said.drives), said)


def agrees(found: Replay, energy: float) -> bool:
    return (
        abs(found.energy - energy) < ENERGY * energy
        and found.end_effector < END_EFFECTOR
        and found.closure < CLOSURE
        and found.feedback < FEEDBACK
    )


@pytest.mark.parametrize("name", SETUPS)
def test_mujoco_agrees(name: str) -> None:
    solution = solve(task(*SETUPS[name]), workers=1)
    found = replayed(reference(solution))
    assert agrees(found, solution.energy), (found, solution.energy)


@pytest.fixture(scope="module")
def elastic() -> Solution:
    return solve(task(*SETUPS["two elastic arms"]), workers=1)


def test_mujoco_disagrees_with_a_wrong_torque(elastic: Solution) -> None:
    said = reference(elastic)
    found = replayed(replace(said, series=said.series | {"tau": 1.02 * said.series["tau"]}))
    assert abs(found.energy - elastic.energy) > ENERGY * elastic.energy
    assert found.feedback > FEEDBACK


def test_mujoco_disagrees_with_another_spring(elastic: Solution) -> None:
    said = reference(elastic)
    stiffer = Robot(replace(said.drives, stiffness=1.05 * said.motion.stiffness))
    assert not agrees(replay(stiffer, said), elastic.energy)


@pytest.mark.long
def test_all_setups_of_the_paper() -> None:
    for row in reproduce(starts=2):
        found = replayed(reference(row.solution))
        assert agrees(found, row.solution.energy), (row.table, row.setup, found)
