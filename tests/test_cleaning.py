"""What CAD exporters write: handled and noted, or refused with link or joint and a remedy."""

from __future__ import annotations

from pathlib import Path

import five_bar
import numpy as np
import pytest

from pkmsea.description import meshes
from pkmsea.errors import InputError
from pkmsea.mechanism import Mechanism, load_mechanism

INERTIA = '<inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/>'
ROD = INERTIA.format(1.9872e-06, 0.000368, 0.000368)


def edited(folder: Path, *pairs: tuple[str, str]) -> Path:
    """The native five-bar with texts of its URDF replaced, each once."""
    five_bar.native(folder)
    file = folder / "robot.urdf"
    text = file.read_text()
    for old, new in pairs:
        assert old in text, old
        text = text.replace(old, new, 1)
    file.write_text(text)
    return folder


LIMIT = '<limit lower="-6.3" upper="6.3" effort="900" velocity="900"/>'


@pytest.mark.parametrize(
    "pairs",
    [
        (('name="elbow_A" type="revolute"', 'name="elbow_A" type="continuous"'),),
        (('name="elbow_A" type="revolute"', 'name="elbow_A" type="continuous"'), (LIMIT, "")),
        ((LIMIT, ""),),
        ((LIMIT, '<limit effort="900" velocity="900"/>'),),
        ((LIMIT, '<limit lower="0" upper="0" effort="900" velocity="900"/>'),),
        ((LIMIT, '<limit lower="-6.3" upper="6.3"/>'),),
        (("</robot>", '<gazebo/><transmission name="t"><joint name="A"/></transmission></robot>'),),
        (("</robot>", '<link name="extra"/><joint name="fix" type="fixed"><parent link="lower_A"/>'
          '<child link="extra"/></joint></robot>'),),
    ],
)  # fmt: skip
def test_harmless(mechanisms: dict[str, Mechanism], tmp_path: Path, pairs: tuple) -> None:
    """The same mass matrix, and room to move: limits that nobody set do not stop a joint."""
    mechanism = load_mechanism(edited(tmp_path / "robot", *pairs))
    point = [0.05, -0.03]
    q, p = mechanism.configuration(point), mechanisms["pkm_2rrr"].configuration(point)
    np.testing.assert_allclose(mechanism.mass_matrix(q), mechanisms["pkm_2rrr"].mass_matrix(p), rtol=1e-8)
    assert np.all(mechanism.model.upperPositionLimit >= 6)


@pytest.mark.parametrize(
    ("pairs", "note"),
    [
        ((("</joint>", '<dynamics damping="0.1" friction="0"/></joint>'),), "joint 'A': friction, damping"),
        (((ROD, INERTIA.format(1e-3, 1e-4, 1e-4)),), "link 'upper_A': no rigid body has this inertia"),
        (((f'<inertial><origin xyz="0.1 0.0 0.0"/><mass value="0.1104"/>{ROD}</inertial>', ""),), "'upper_A': moves"),
        (((ROD, ROD + '</inertial><visual><geometry><mesh filename="package://x/a.stl"/></geometry></visual><inertial>'),
          ("<inertial></inertial>", "")), "1 mesh file.*package://x/a.stl"),
    ],
)  # fmt: skip
def test_noted(tmp_path: Path, pairs: tuple, note: str) -> None:
    import re

    notes = load_mechanism(edited(tmp_path / "robot", *pairs)).description.notes
    assert any(re.search(note, line) for line in notes), notes


@pytest.mark.parametrize(
    ("pairs", "message"),
    [
        ((('name="A" type="revolute"', 'name="A" type="floating"'),), "joint 'A': type = 'floating'.*a chain"),
        (((LIMIT, LIMIT.replace("-6.3", "7")),), r"joint 'A': limit = \[7.0, 6.3\].*leave the joint no room.*locked"),
        ((('axis xyz="0 0 1"', 'axis xyz="0 0 0"'),), "joint 'A': axis: The axis is zero"),
        (((ROD, INERTIA.format(1e-6, -1e-4, 1e-4)),), "link 'upper_A': inertia.*negative"),
        (((ROD, INERTIA.format(5e5, 5e5, 5e5)),), "link 'upper_A': inertia.*times larger than the mechanism"),
        (((ROD, ROD.replace("0.000368", "nan", 1)),), "link 'upper_A': inertia iyy = 'nan'.*finite"),
        ((('mass value="0.1104"', 'mass value="1e9"'),), "link 'upper_A': mass value.*SI units"),
        ((('<child link="upper_B"/>', '<child link="upper_A"/>'),), "joint 'B': child: The link 'upper_A' has two"),
        ((('parent link="base"', 'parent link="lower_A"'),), "each other's parents|do not hang together"),
        ((('<link name="base"/>', '<link name="base"/><link name="base"/>'),), "link 2: name = 'base'.*Two links"),
        ((("<robot ", '<!DOCTYPE r [<!ENTITY a "aaaa"><!ENTITY b "&a;&a;">]><robot '),), "document type"),
        ((('<robot name="five_bar">', '<!DOCTYPE r SYSTEM "file:///etc/passwd"><robot>'),), "document type"),
    ],
)  # fmt: skip
def test_refused(tmp_path: Path, pairs: tuple, message: str) -> None:
    with pytest.raises(InputError, match=r"(?s)robot\.urdf.*" + message):
        load_mechanism(edited(tmp_path / "robot", *pairs))


def test_massless_motion_is_refused(tmp_path: Path) -> None:
    tree = (
        '<robot name="r"><link name="base"/><link name="arm"/><joint name="j" type="revolute"><parent link="base"/>'
        '<child link="arm"/></joint><link name="tip"/><joint name="f" type="fixed"><parent link="arm"/>'
        '<child link="tip"/><origin xyz="0 0.1 0"/></joint></robot>'
    )
    keys = {"actuated": ["j"], "end_effector": {"frame": "tip", "axes": ["z"]}, "seed": {}}
    with pytest.raises(InputError, match=r"robot\.urdf, link: inertial: .*without moving a mass"):
        load_mechanism(five_bar.write(tmp_path / "robot", "robot.urdf", tree, keys))


def test_locked_joints_are_rigid(mechanisms: dict[str, Mechanism], tmp_path: Path) -> None:
    """Arm A held in its seed pose: what is left moves as if q_A were constant."""
    five_bar.native(tmp_path / "robot")
    file = tmp_path / "robot" / "mechanism.yaml"
    seed = five_bar.Variant().seed
    text = file.read_text().replace("- A\n", "").replace("  A: ", "  # ").replace("- x\n", "")
    file.write_text(text + f"locked: {{A: {seed['A']!r}}}\n")
    mechanism, whole = load_mechanism(tmp_path / "robot"), mechanisms["pkm_2rrr"]
    assert (mechanism.mobility, mechanism.joints) == (1, ["elbow_A", "B", "elbow_B"])
    v = mechanism.velocity_map(mechanism.seed) / mechanism.velocity_map(mechanism.seed)[mechanism.joints.index("B")]
    H = whole.velocity_map(whole.seed)
    np.testing.assert_allclose(v.ravel(), H[[whole.joints.index(j) for j in mechanism.joints], 1], atol=1e-6)


def test_meshes_stay_in_their_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package, outside = tmp_path / "arm_description", tmp_path / "secret.stl"
    (package / "meshes").mkdir(parents=True)
    (package / "urdf").mkdir()
    for file in (package / "meshes" / "a.stl", package / "urdf" / "b.STL", package / "meshes" / "c.txt", outside):
        file.write_text("solid")
    (package / "urdf" / "link.stl").symlink_to(outside)
    folder = package / "urdf"
    assert meshes.resolve("package://arm_description/meshes/a.stl", folder) == package / "meshes" / "a.stl"
    assert meshes.resolve("package:///b.STL", folder) == meshes.resolve("b.STL", folder) == folder / "b.STL"
    for name in ("package://arm_description/../secret.stl", "../../secret.stl", str(outside), f"file://{outside}",
                 "link.stl", "package://arm_description/%2e%2e/secret.stl", "package://arm_description/meshes/c.txt",
                 "http://host/a.stl", "a\0.stl", "", "package://[/a.stl"):  # fmt: skip
        assert meshes.resolve(name, folder) is None, name
    monkeypatch.setenv(meshes.PATH, str(tmp_path))
    assert meshes.resolve("package://arm_description/meshes/a.stl", tmp_path) == package / "meshes" / "a.stl"
