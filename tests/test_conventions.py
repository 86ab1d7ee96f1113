"""One five-bar, written in every convention: the same mechanism to rounding, and the same optimum."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import five_bar
import numpy as np
import pytest
import yaml
from conftest import ELASTIC, task

from pkmsea.description import skeleton, source
from pkmsea.errors import InputError, MechanismError
from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.solution import solve

EQUAL = 1e-8  # relative, asked for; conventions differ by rounding of poses only
POINTS = [(0.0, 0.0), (0.05, -0.04), (-0.07, -0.07), (0.07, 0.07)]
V_IND = np.array([1.3, -0.7])


def dynamics(mechanism: Mechanism) -> dict[str, np.ndarray]:
    """M, g and H_A at task-space points, which no convention turns or renames."""
    poses = [mechanism.configuration(point) for point in POINTS]
    return {
        "M": np.array([mechanism.mass_matrix(q) for q in poses]),
        "g": np.array([mechanism.bias(q, V_IND) for q in poses]),
        "H_A": np.array([mechanism.actuation_jacobian(q) for q in poses]),
    }


def assert_equal(mechanism: Mechanism, reference: Mechanism) -> None:
    ours, theirs = dynamics(mechanism), dynamics(reference)
    for key, value in theirs.items():
        np.testing.assert_allclose(ours[key], value, rtol=0, atol=EQUAL * np.abs(value).max(), err_msg=key)


@pytest.mark.parametrize("name", five_bar.CONVENTIONS)
def test_each_convention_is_the_same_mechanism(mechanisms: dict[str, Mechanism], name: str, tmp_path: Path) -> None:
    folder = five_bar.CONVENTIONS[name](tmp_path / "robot")
    mechanism = load_mechanism(folder)
    assert (mechanism.mobility, mechanism.description.actuated) == (2, ("A", "B"))
    assert_equal(mechanism, mechanisms["pkm_2rrr"])


@pytest.mark.parametrize("name", five_bar.CONVENTIONS)
def test_the_normalised_sidecar_is_the_same_mechanism(
    mechanisms: dict[str, Mechanism], name: str, tmp_path: Path
) -> None:
    """`check --write`: what was read in any convention, written in ours, and read again."""
    folder = five_bar.CONVENTIONS[name](tmp_path / "robot")
    mechanism = load_mechanism(folder, guess=True)
    for file in folder.glob("*.yaml"):
        file.unlink()
    (folder / "mechanism.yaml").write_text(skeleton.text(mechanism.description))
    again = load_mechanism(folder)
    assert again.description.closures == mechanism.description.closures
    assert_equal(again, mechanisms["pkm_2rrr"])


def test_conventions_have_the_same_optimum(tmp_path: Path) -> None:
    energies = {}
    for name in ("native", "urdfplus", "mjcf"):
        folder = five_bar.CONVENTIONS[name](tmp_path / name)
        drives = ELASTIC | {"friction": 4.8e-3}
        energies[name] = solve(task(str(folder), drives), workers=1).energy
    reference = energies["native"]
    assert {name: abs(e / reference - 1) < EQUAL for name, e in energies.items()} == dict.fromkeys(energies, True), (
        energies
    )


def test_xacro(mechanisms: dict[str, Mechanism], tmp_path: Path) -> None:
    pytest.importorskip("xacrodoc")
    assert_equal(load_mechanism(five_bar.xacro(tmp_path / "robot")), mechanisms["pkm_2rrr"])


def test_xacro_without_xacrodoc_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    with pytest.raises(MechanismError, match="pip install xacrodoc"):
        load_mechanism(five_bar.xacro(tmp_path / "robot"))


def test_a_convention_is_one_entry_of_the_table(
    mechanisms: dict[str, Mechanism], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A made-up mark, <pin a= b=/>, is read, named, and blamed for its faults once it stands in the table."""
    convention = SimpleNamespace(
        LABEL="<pin> elements",
        TAGS=("pin",),
        read=lambda root, file: {"closures": [{"frames": (pin.get("a"), pin.get("b"))} for pin in root.findall("pin")]},
    )
    monkeypatch.setattr(source, "MARKS", (*source.MARKS, convention))
    tree = five_bar.urdf(five_bar.Variant(), more='<pin a="tip_1" b="tip_2"/>')
    folder = five_bar.write(tmp_path / "robot", "robot.urdf", tree, five_bar.sidecar(five_bar.Variant()))
    mechanism = load_mechanism(folder)
    assert mechanism.description.origin.conventions == ("mechanism.yaml", "<pin> elements")
    assert_equal(mechanism, mechanisms["pkm_2rrr"])
    (folder / "robot.urdf").write_text(tree.replace('b="tip_2"', 'b="tip_3"'))
    with pytest.raises(InputError, match=r"robot\.urdf, closures\.0\.frames: There is no frame named 'tip_3'"):
        load_mechanism(folder)


def test_mechanism_yaml_goes_before_the_tree(tmp_path: Path) -> None:
    folder = five_bar.urdfplus(tmp_path / "robot")
    file = folder / "mechanism.yaml"
    file.write_text(yaml.safe_dump(yaml.safe_load(file.read_text()) | {"closures": []}))
    assert load_mechanism(folder, guess=True).description.closures == ()


def test_mimic_joints_are_couplings(mechanisms: dict[str, Mechanism], tmp_path: Path) -> None:
    """Arm B mimics the motion of arm A at the seed: one degree of freedom less, and H_A says the ratio."""
    text = five_bar.urdf(five_bar.Variant()).replace(
        'name="B" type="revolute" >', 'name="B" type="revolute"><mimic joint="A" multiplier="-0.5" offset="-0.7"/>'
    )
    keys = five_bar.sidecar(five_bar.Variant()) | {"closures": [{"frames": ["tip_1", "tip_2"]}]}
    keys |= {"end_effector": {"frame": "tool", "axes": ["x"]}}
    mechanism = load_mechanism(five_bar.write(tmp_path / "robot", "robot.urdf", text, keys))
    assert mechanism.mobility == 1
    ratio = mechanism.actuation_jacobian(mechanism.seed).ravel()
    assert ratio[1] / ratio[0] == pytest.approx(-0.5)
    q = dict(zip(mechanism.joints, mechanism.seed, strict=True))
    assert q["B"] == pytest.approx(-0.5 * q["A"] - 0.7)
