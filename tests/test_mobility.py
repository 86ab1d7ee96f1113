"""Mobility and independent coordinates by rank: planar and spatial loops, redundant closures, singular poses."""

from __future__ import annotations

from pathlib import Path

import five_bar
import numpy as np
import pytest
import spatial
import yaml

from pkmsea.errors import InputError, MechanismError
from pkmsea.mechanism import Mechanism, load_mechanism

STEP = 1e-6  # of central differences: error near 1e-9 for motions of order one
EQUAL = 1e-8


def variant_of(folder: Path, **changes: object) -> Path:
    """The five-bar with keys of its sidecar replaced; None removes one."""
    five_bar.native(folder)
    file = folder / "mechanism.yaml"
    data = yaml.safe_load(file.read_text()) | changes
    file.write_text(yaml.safe_dump({key: value for key, value in data.items() if value is not None}))
    return folder


def assert_H_A_is_the_derivative(mechanism: Mechanism, point: np.ndarray) -> None:
    q = mechanism.configuration(point)
    for direction in np.eye(point.size):
        ahead, behind = (mechanism.configuration(point + s * STEP * direction) for s in (1, -1))
        rate = (ahead - behind) / (2 * STEP)
        np.testing.assert_allclose(
            mechanism.actuation_jacobian(q) @ rate[mechanism.independent], rate[mechanism.actuated], atol=1e-6
        )


def test_spatial_loops(tmp_path: Path) -> None:
    """Nine joints and two point closures of three rows."""
    mechanism = load_mechanism(spatial.delta(tmp_path / "delta"))
    assert (mechanism.mobility, mechanism.functions["closure_residual"].size1_out(0)) == (3, 6)
    assert mechanism.actuation_class == "fully actuated"
    assert_H_A_is_the_derivative(mechanism, mechanism.end_effector(mechanism.seed) + np.array([0.02, -0.03, 0.01]))


def test_redundant_rows_are_left_out_once(mechanisms: dict[str, Mechanism], tmp_path: Path) -> None:
    """A loop welded in six rows, of which three are dependent in a plane, is the same five-bar at all poses."""
    mechanism, reference = load_mechanism(spatial.welded(tmp_path / "robot")), mechanisms["pkm_2rrr"]
    assert (mechanism.mobility, mechanism.functions["closure_residual"].size1_out(0)) == (2, 3)
    for point in ([0.0, 0.0], [-0.07, -0.07], [0.08, 0.05]):
        q, p = mechanism.configuration(point), reference.configuration(point)
        names = [mechanism.joints.index(name) for name in ("A", "B")]
        np.testing.assert_allclose(q[names], p[[reference.joints.index(name) for name in ("A", "B")]], atol=EQUAL)
        M = [robot.velocity_map(pose)[robot.actuated] for robot, pose in ((mechanism, q), (reference, p))]
        ours, theirs = (
            np.linalg.inv(H).T @ robot.mass_matrix(pose) @ np.linalg.inv(H)
            for H, robot, pose in zip(M, (mechanism, reference), (q, p), strict=True)
        )
        np.testing.assert_allclose(ours, theirs, atol=EQUAL * np.abs(theirs).max())


@pytest.mark.parametrize("plane", [{"normal": [0, 0, 1]}, {"normal": [0, 0, -3]}, None])
@pytest.mark.parametrize("kind", ["point", "revolute"])
def test_a_planar_loop_may_be_closed_in_space(tmp_path: Path, plane: dict | None, kind: str) -> None:
    closures = [{"frames": ["tip_1", "tip_2"], "type": kind}]
    mechanism = load_mechanism(variant_of(tmp_path / "robot", plane=plane, closures=closures))
    assert mechanism.mobility == 2
    assert_H_A_is_the_derivative(mechanism, np.array([0.03, -0.02]))


def test_independent_joints_are_found_and_may_be_others(tmp_path: Path) -> None:
    """Minimal coordinates are a matter of numerics: any valid choice gives the same energy 1/2 v^T M v."""
    energies = []
    for i, independent in enumerate((None, ["A", "B"], ["elbow_A", "elbow_B"])):
        mechanism = load_mechanism(variant_of(tmp_path / f"{i}", independent=independent))
        q = mechanism.configuration([0.04, 0.03])
        ahead = mechanism.configuration([0.04 + STEP, 0.03])
        v_ind = ((ahead - q) / STEP)[mechanism.independent]
        energies.append(v_ind @ mechanism.mass_matrix(q) @ v_ind)
        assert 0 < mechanism.conditioning < 1
    np.testing.assert_allclose(energies, energies[0], rtol=1e-4)  # one-sided difference


def test_a_seed_is_proposed_away_from_the_singular_neutral_pose(tmp_path: Path) -> None:
    """A parallelogram is singular where it is flat, which is its neutral pose."""
    links = {"a": (0.5, "base", "0 0 0"), "b": (1.0, "a", "0.5 0 0"), "c": (0.5, "base", "1 0 0")}
    tree = ['<robot name="parallelogram"><link name="base"/>']
    for name, (length, parent, at) in links.items():
        tree.append(
            f'<link name="{name}"><inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" '
            f'iyz="0"/></inertial></link><joint name="j_{name}" type="continuous"><parent link="{parent}"/>'
            f'<child link="{name}"/><origin xyz="{at}"/><axis xyz="0 0 1"/></joint><link name="end_{name}"/>'
            f'<joint name="m_{name}" type="fixed"><parent link="{name}"/><child link="end_{name}"/>'
            f'<origin xyz="{length} 0 0"/></joint>'
        )
    keys = {
        "closures": [{"frames": ["end_b", "end_c"]}], "actuated": ["j_a"],
        "end_effector": {"frame": "end_b", "axes": ["y"]},
    }  # fmt: skip
    folder = five_bar.write(tmp_path / "robot", "robot.urdf", "\n".join([*tree, "</robot>"]), keys)
    with pytest.raises(MechanismError, match=r"seed: No seed is declared, and the neutral pose is singular.*proposes"):
        load_mechanism(folder)
    mechanism = load_mechanism(folder, guess=True)
    assert mechanism.mobility == 1 and "seed" in mechanism.description.origin.proposed
    assert min(mechanism.singularity(mechanism.seed)) > 0.05


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"independent": ["A"]}, "independent .*1 independent coordinates.* mobility .* 2.*leave the key out"),
        ({"independent": ["A", "elbow_C"]}, "independent: There is no moving joint named 'elbow_C'"),
        ({"plane": {"normal": [0, 1, 0]}}, "plane.normal.*'A' does not move in the declared plane"),
        ({"closures": [{"frames": ["tip_1", "tool"]}]}, "closures.0.frames.*on the same link"),
        ({"closures": [{"frames": [tip, "base"]} for tip in ("tip_1", "tip_2")]}, "closures: .* cannot move"),
        ({"frames": {"far": {"link": "base", "xyz": [9, 0, 0]}}, "closures": [{"frames": ["tip_1", "far"]}]},
         "seed: The loops do not close"),
        ({"actuated": None}, "actuated: This key is missing.*check .* proposes"),
        ({"locked": {"A": 0.0, "B": 0.0}, "actuated": ["elbow_A"]}, "closures: The closed mechanism cannot move|seed"),
        ({"couplings": [{"joint": "A", "of": "A"}]}, "couplings.0.*coupled to itself"),
        ({"couplings": [{"joint": "A", "of": "C"}]}, "couplings.0.of: There is no moving joint named 'C'"),
        ({"frames": {"tip_1": {"link": "base"}}}, "frames.tip_1: The tree has a frame of this name"),
    ],
)  # fmt: skip
def test_faults_name_the_key(tmp_path: Path, changes: dict, message: str) -> None:
    with pytest.raises(InputError, match="(?s)mechanism.yaml, " + message):
        load_mechanism(variant_of(tmp_path / "robot", **changes))
