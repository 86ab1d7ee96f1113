"""Cycles in joint space, where no task-space point fixes the motion."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import ELASTIC, RIGID, task

from pkmsea.mechanism import load_mechanism
from pkmsea.motion import Motion
from pkmsea.motion.bases import SplineBasis
from pkmsea.motion.series import series
from pkmsea.problem import build_problem
from pkmsea.solution import solve


@pytest.fixture
def five_bar(tmp_path: Path) -> Path:
    """The two-arm robot with its shoulders as task coordinates."""
    folder = tmp_path / "five_bar"
    shutil.copytree(load_mechanism("pkm_2rrr").folder, folder)
    sidecar = folder / "mechanism.yaml"
    text = sidecar.read_text()
    assert "axes: [x, y]" in text
    sidecar.write_text(text.replace("axes: [x, y]", "joints: [A, B]"))
    return folder


def test_joints_as_task_coordinates_give_the_same_torques(five_bar: Path) -> None:
    """One motion, told by the end effector's path or by the shoulders' angles."""
    mechanism = load_mechanism("pkm_2rrr")
    cartesian = build_problem(task("pkm_2rrr", ELASTIC))
    t = np.arange(400) / 400
    circle = 0.03 * np.stack([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)], axis=1)
    stiffness = np.array([0.3, 0.2])
    basis = SplineBasis(1.0, 100, 7)
    there = series(cartesian, Motion(basis, basis.fit(t, circle), stiffness), points=400)
    points = [{"at": list(there.q[k, mechanism.actuated]), "window": 1e-2} for k in (0, 200)]
    setup = {"name": "setup", "mechanism": str(five_bar), "drives": ELASTIC}
    in_joints = build_problem(task("pkm_2rrr", ELASTIC, setups=[setup], cycle={"period": 1.0, "points": points}))
    same = Motion(basis, basis.fit(t, there.q[:, mechanism.actuated]), stiffness)
    here = series(in_joints, same, points=400)
    np.testing.assert_allclose(here.tau, there.tau, rtol=0, atol=1e-5 * np.abs(there.tau).max())
    assert here.r_E.shape == there.r_E.shape


def test_a_cycle_between_joint_positions_solves(five_bar: Path) -> None:
    mechanism = load_mechanism("pkm_2rrr")
    poses = [mechanism.configuration(point)[mechanism.actuated] for point in ([-0.06, -0.06], [0.06, 0.06])]
    points = [{"at": list(pose), "rest": 0.1, "window": 5e-3} for pose in poses]
    setups = [
        {"name": name, "mechanism": str(five_bar), "drives": drives | {"friction": 4.8e-3}}
        for name, drives in (("rigid", RIGID), ("elastic", ELASTIC))
    ]
    both = task("pkm_2rrr", RIGID, setups=setups, cycle={"period": 1.0, "points": points}, options={"starts": 2})
    rigid, elastic = (solve(both, name, workers=1) for name in ("rigid", "elastic"))
    assert rigid.verified and elastic.verified
    assert elastic.energy < rigid.energy
