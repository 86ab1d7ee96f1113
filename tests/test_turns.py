"""A cycle closes in the joints: they return, or turn without end where the URDF calls them continuous."""

from __future__ import annotations

from pathlib import Path

import five_bar
import numpy as np
import pytest
from conftest import task

from pkmsea.errors import Infeasible
from pkmsea.motion import turns
from pkmsea.problem import Problem, build_problem
from pkmsea.solution import Solution, solve
from pkmsea.solution.audit import audit
from pkmsea.solution.feedforward import Sampling, feedforward
from pkmsea.transcription import transcribe
from pkmsea.verification import verify
from pkmsea.views.records import solution_record

LINK = (
    '<link name="{0}"><inertial><origin xyz="0.1 0 0"/><mass value="{1}"/>'
    '<inertia ixx="1e-4" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><axis xyz="0 0 1"/>'
    '<origin xyz="{4} 0 0"/><limit lower="-4" upper="4" effort="900" velocity="900"/></joint>'
)
ROUND = [[0.3, 0.0], [0.0, 0.25], [-0.3, 0.0], [0.0, -0.34]]
RIGID = {"kind": "rigid", "inertia": 1e-3, "copper_loss": 1.0, "friction": 0.01}
SEA = RIGID | {"kind": "sea", "stiffness": 20.0}
ON_GRID = 2e-4  # relative; where the power changes its sign, energies on two grids differ by so much


def scara(folder: Path, kind: str = "continuous", drives: int = 1) -> str:
    tree = "".join([
        '<robot name="scara"><link name="base"/><link name="tip"/>', LINK.format("u", 0.3), LINK.format("l", 0.2),
        JOINT.format("A", kind, "base", "u", 0), JOINT.format("B", kind, "u", "l", 0.2),
        JOINT.format("T", "fixed", "l", "tip", 0.2), "</robot>",
    ])  # fmt: skip
    keys = {
        "gravity": [0, 0, 0], "actuated": ["A"] * drives + ["B"], "seed": {"A": -0.7, "B": 1.4},
        "end_effector": {"frame": "tip", "axes": ["x", "y"]}, "independent": ["A", "B"],
    }  # fmt: skip
    return str(five_bar.write(folder / kind, "scara.urdf", tree, keys))


def around(mechanism: str, drives: object, **changes: object) -> Problem:
    cycle = {"period": 2.0, "points": [{"at": at, "rest": 0, "window": 0.02} for at in ROUND]}
    options = {"starts": 1, "trajectory": {"kind": "fourier", "order": 4}}
    return build_problem(task(mechanism, drives, **({"cycle": cycle, "options": options} | changes)))


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Solution:
    return solve(around(scara(tmp_path_factory.mktemp("turns")), [SEA, RIGID | {"gear_ratio": 5}]), workers=1)


def test_a_turn_is_carried_through(solved: Solution) -> None:
    """Solved, audited, simulated for whole cycles, and said."""
    assert solved.verified and solved.turns == {"A": "'A' gains 1 turn"}
    assert solution_record(solved, None)["turns"] == {"A": 1.0}
    assert verify(solved).verified


def test_the_export_goes_on_without_a_jump(solved: Solution) -> None:
    """From the last sample to the first one of the next cycle, as from each sample to the next."""
    found = feedforward(solved, Sampling(2.0, 200))
    assert found.attrs["turns_per_cycle"] == "'A' gains 1 turn"
    for name in ("q_M_A", "q_A_A", "q_shaft_B"):
        values, text = found.arrays[name].values, found.arrays[name].attrs["long_name"]
        added = float(text.split("each cycle adds ")[1].split()[0]) if "adds" in text else 0.0
        steps = np.abs(np.diff(np.append(values, values[0] + added)))
        assert steps.max() < 3 * np.median(steps) + 0.1
        assert (added == pytest.approx(2 * np.pi)) == name.endswith("_A")


@pytest.mark.parametrize("drives", [[SEA, SEA], [SEA, SEA, RIGID], [RIGID, SEA | {"damping": 0.05}, SEA]])
def test_the_grid_knows_what_motors_gain(tmp_path: Path, drives: list[dict]) -> None:
    """Motors behind springs, free and damped ones too: the transcription's differences equal the exact flat map."""
    problem = around(scara(tmp_path, drives=len(drives) - 1), drives)
    transcription = transcribe(problem)
    x = transcription.start(None)
    found, s = audit(problem, transcription.motion(x), transcription.claimed(x))
    assert s.gain.tolist() == [turns.TURN, 0.0] and found.gap < ON_GRID
    end = s.q_M[-1] + s.v_M[-1] * (problem.cycle.period - s.t[-1])
    np.testing.assert_allclose(end - s.q_M[0], turns.of_motors(problem.actuation, s.gain), atol=1e-3)


def test_what_must_return_is_refused(tmp_path: Path) -> None:
    spring = {"parallel": {"stiffness": 1.0, "rest": 0.0}}
    limits = {"joints": {"position": {"A": [-9, 9]}}}
    endless, ending = scara(tmp_path), scara(tmp_path, "revolute")
    faults = {
        "does not call it continuous": around(ending, RIGID, limits={"urdf": False}),
        "its position is limited": around(endless, RIGID, limits=limits),
        "a spring is parallel": around(endless, [RIGID | spring, RIGID]),
    }
    for fault, problem in faults.items():
        with pytest.raises(Infeasible, match=rf"'A' gains 1 turn per cycle, .*{fault}"):
            solve(problem, workers=1)


def test_a_result_that_does_not_close_is_told(solved: Solution, tmp_path: Path) -> None:
    stays = around(scara(tmp_path, "revolute"), [SEA, RIGID], limits={"urdf": False})
    faults = audit(stays, solved.motion, solved.claimed)[0].faults
    assert any("'A' gains 1 turn per cycle" in fault for fault in faults)


def test_whole_turns_bring_joints_into_their_range(tmp_path: Path) -> None:
    """A point at 190 degrees lies at -170 where the joint is limited to 180."""
    mechanism = around(scara(tmp_path), RIGID).mechanism
    ranges = np.array([[-3.2, -np.inf], [3.2, np.inf]])
    q = np.array([[3.3, 3.4, 3.35], [0.1, 0.2, 0.1]])
    np.testing.assert_allclose(mechanism.within(q, ranges), q - [[turns.TURN], [0]])
    wide = np.array([[-3.0, 3.4], [0.1, 0.2]])
    np.testing.assert_array_equal(mechanism.within(wide, ranges), wide)
