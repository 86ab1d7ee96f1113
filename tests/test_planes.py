"""Planes of rounded numbers are put right, with a word; layers of links open no loop; what cannot close is told."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from conftest import task
from linkage import four_bar, tree

from pkmsea.errors import InputError
from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.solution import solve
from pkmsea.solution.store import changed
from pkmsea.verification import verify
from pkmsea.verification.loops import Loops

FOURIER = {"kind": "fourier", "order": 8}
ROUNDED = 1e-4  # relative: what tilts of 1e-4 rad leave of masses and lengths


@pytest.fixture(scope="module")
def exact(tmp_path_factory: pytest.TempPathFactory) -> Mechanism:
    return load_mechanism(four_bar(tmp_path_factory.mktemp("plane") / "exact"))


@pytest.mark.parametrize(
    ("rounded", "keys", "tilt"),
    [
        ({"turn": "1.5708"}, {}, "its normal was 3.7e-06 rad off"),
        ({"axes": ("0 0 1", "0 1e-4 1", "0 0 1")}, {}, "the axis of joint 'j2' was 1.0e-04 rad off"),
        ({}, {"plane": {"normal": [2.955e-4, 1, 0]}}, "its normal was 3.0e-04 rad off"),
        ({"turn": "1.5708", "layer": 0.02}, {}, "its normal was 3.7e-06 rad off"),
    ],
)
def test_rounded_numbers_are_put_right(exact: Mechanism, tmp_path: Path, rounded: dict, keys: dict, tilt: str) -> None:
    mechanism = load_mechanism(four_bar(tmp_path / "robot", tree(**rounded), **keys))
    assert mechanism.mobility == 1
    (note,) = [note for note in mechanism.description.notes if note.startswith("plane: made exact")]
    assert tilt in note
    for x in (0.12, 0.2, 0.24):
        q, p = mechanism.configuration([x]), exact.configuration([x])
        np.testing.assert_allclose(mechanism.mass_matrix(q), exact.mass_matrix(p), rtol=ROUNDED)
        np.testing.assert_allclose(mechanism.bias(q, [1.0]), exact.bias(p, [1.0]), rtol=ROUNDED)
        assert np.abs(Loops(mechanism).at(mechanism.model.createData(), q, 0 * q).Phi).max() < 1e-12


def test_what_is_exact_has_no_note_and_stays(exact: Mechanism, tmp_path: Path) -> None:
    assert not any("plane" in note for note in exact.description.notes)
    assert exact.description.plane.normal == (0, 1, 0)
    digits = load_mechanism(four_bar(tmp_path / "robot", tree("1.57079632679")))
    assert digits.description.notes == exact.description.notes


@pytest.mark.parametrize("kind", ["revolute", "frame"])
def test_closures_with_an_orientation(exact: Mechanism, tmp_path: Path, kind: str) -> None:
    """Rounded frames in layers: of a pin the turn is free, of a weld it is the one row that is left."""
    pin = (
        '<link name="pin"><inertial><mass value="1e-9"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>'
        '</inertial></link><joint name="j4" type="continuous"><parent link="l3"/><child link="pin"/>'
        '<origin xyz="0.16 0 0" rpy="3e-4 0 0"/><axis xyz="0 0 1"/></joint>'
    )
    closure = {"frames": ["e2", "pin" if kind == "frame" else "e3"], "type": kind}
    text = tree("1.5708", layer=0.02, more=pin if kind == "frame" else "")
    mechanism = load_mechanism(four_bar(tmp_path / "robot", text, closures=[closure]))
    assert mechanism.mobility == 1
    q, p = mechanism.configuration([0.2]), exact.configuration([0.2])
    np.testing.assert_allclose(mechanism.mass_matrix(q), exact.mass_matrix(p), rtol=ROUNDED)
    loops, data = Loops(mechanism), mechanism.model.createData()
    v = mechanism.velocity_map(q) @ [1.0]
    found = loops.at(data, q, v)
    np.testing.assert_allclose([*found.Phi, *(found.G @ v)], 0, atol=1e-9)


@pytest.mark.parametrize(
    ("tilted", "keys", "message"),
    [
        ({"axes": ("0 0 1", "0 2e-3 1", "0 0 1")}, {}, "plane.normal.*'j2' does not.*0.002 rad off; 0.001 rad at most"),
        ({}, {"plane": {"normal": [1, 0, 0]}}, r"plane.normal.*'j1' does not move.* 1.6 rad off; 0.001 rad at most"),
        ({}, {"closures": [{"frames": ["e2", "e3"], "type": "revolute", "axis": [0, 0.01, 1]}]},
         r"closures.0.type.*'e2 = e3' does not stand in the declared plane: it is 0.01 rad off"),
    ],
)  # fmt: skip
def test_more_than_rounding_is_refused(tmp_path: Path, tilted: dict, keys: dict, message: str) -> None:
    with pytest.raises(InputError, match="(?s)mechanism.yaml, " + message):
        load_mechanism(four_bar(tmp_path / "robot", tree(**tilted), **keys))


def test_a_joint_that_turns_the_whole_plane_is_refused(tmp_path: Path) -> None:
    """The normal of a plane that is carried by a joint is not constant in the world."""
    text = tree().replace('name="four_bar"><link name="base"/>', (
        'name="four_bar"><link name="ground"/><link name="base"/><joint name="turntable" type="continuous">'
        '<parent link="ground"/><child link="base"/><axis xyz="0 0 1"/></joint>'
    ))  # fmt: skip
    with pytest.raises(InputError, match=r"plane.normal.*'turntable' does not move in the declared plane"):
        load_mechanism(four_bar(tmp_path / "robot", text))


@pytest.mark.parametrize("seed", [None, {"j1": 1.44, "j2": -1.131, "j3": 1.548}])
def test_layers_without_a_plane_name_direction_and_distance(tmp_path: Path, seed: dict | None) -> None:
    """0.8 mm across the plane; no seed can help."""
    folder = four_bar(tmp_path / "robot", tree(layer=8e-4), plane=None, seed=seed)
    message = r"closures.0.frames.*normal \[0, 1, 0\].* 0.8 mm apart.*add 'plane: \{normal: \[0, 1, 0\]\}'"
    with pytest.raises(InputError, match=message):
        load_mechanism(folder)
    assert load_mechanism(four_bar(tmp_path / "right", tree(layer=8e-4))).mobility == 1


def test_a_rounded_plane_that_is_not_declared_is_named(tmp_path: Path) -> None:
    """Three rows of a loop whose axes differ in the seventh digit leave the mobility in doubt."""
    text = tree(axes=("0 0 1", "0 1e-7 1", "1e-7 0 1"))
    with pytest.raises(InputError, match=r"almost dependent.*add 'plane: \{normal: \[0, 1, 0\]\}'"):
        load_mechanism(four_bar(tmp_path / "robot", text, plane=None))


def test_a_solution_of_layers_is_verified(tmp_path: Path) -> None:
    folder = four_bar(tmp_path / "robot", tree("1.5708", layer=0.02))
    points = [{"at": [x], "rest": 0.1, "window": 1e-3} for x in (0.18, 0.24)]
    drives = {"kind": "sea", "inertia": 0.01, "copper_loss": 1.0, "stiffness": 20}
    quick = {"cycle": {"period": 1.0, "points": points}, "options": {"trajectory": FOURIER, "starts": 1}}
    solution = solve(task(str(folder), drives, **quick), workers=1)
    found = verify(solution)
    assert found.verified and found.closure < 1e-9, found.status
    assert changed(solution.save(tmp_path / "result.nc")) == ""  # what was put right is no other mechanism
