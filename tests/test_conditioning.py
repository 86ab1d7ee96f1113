"""Distances to singularities and conditioning: numbers without units, zero where a motion escapes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import five_bar
import numpy as np
import pytest
from linkage import ends, four_bar, tree

from pkmsea.description import EndEffector
from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.mechanism.conditioning import OPENING, characteristic_length
from pkmsea.mechanism.workspace import reach
from pkmsea.views.figures import coordinates
from pkmsea.views.tables import mechanism_record

GALLERY = Path(__file__).parents[1] / "examples" / "gallery"
SAME = 1e-6  # relative; seeds are closed by other steps
PIN = (
    '<link name="pin"/><joint name="j4" type="continuous"><parent link="l3"/><child link="pin"/>'
    '<origin xyz="0.16 0 0"/><axis xyz="0 0 1"/></joint>'
)


def numbers(mechanism: Mechanism) -> list[float]:
    return [*mechanism.singularity(mechanism.seed), mechanism.conditioning]


def slider_crank(folder: Path, size: float, slide: float) -> Path:
    """Crank 0.1, rod 0.3, a slider along x, all times `size`."""
    inertia = f'ixx="{size**2}" iyy="{size**2}" izz="{size**2}" ixy="0" ixz="0" iyz="0"'
    link = f'<link name="{{}}"><inertial><mass value="1"/><inertia {inertia}/></inertial></link>'
    joint = (
        '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="{} 0 0"/><axis xyz="{}"/>'
        '<limit lower="-{}" upper="{}" effort="1" velocity="1"/></joint>'
    )
    far = max(10 * size, 7)
    text = "".join([
        '<robot name="slider_crank"><link name="base"/>', *(link.format(name) for name in ("crank", "rod", "block")),
        joint.format("A", "revolute", "base", "crank", 0, "0 0 1", far, far),
        joint.format("B", "revolute", "crank", "rod", 0.1 * size, "0 0 1", far, far),
        joint.format("S", "prismatic", "base", "block", 0, "1 0 0", far, far), "</robot>",
    ])  # fmt: skip
    keys = {
        "frames": {"end": {"link": "rod", "xyz": [0.3 * size, 0, 0]}}, "closures": [{"frames": ["end", "block"]}],
        "plane": {"normal": [0, 0, 1]}, "actuated": ["A"], "end_effector": {"frame": "block", "axes": ["x"]},
        "seed": {"A": 1.0, "B": -1.3, "S": slide},
    }  # fmt: skip
    return five_bar.write(folder, "slider_crank.urdf", text, keys)


def test_size_changes_no_number(tmp_path: Path) -> None:
    keys = {"frames": ends(100.0), "gravity": [0, 0, 0]}
    small = load_mechanism(four_bar(tmp_path / "small"))
    large = load_mechanism(four_bar(tmp_path / "large", tree(size=100.0), **keys))
    assert large.length == pytest.approx(100 * small.length)
    assert numbers(large) == pytest.approx(numbers(small), rel=SAME)


def test_size_changes_no_number_with_a_slider(tmp_path: Path) -> None:
    """Its seed is rough, so that the loop is closed over as many slider lengths."""
    small, large = (load_mechanism(slider_crank(tmp_path / f"{s:g}", s, 0.25 * s)) for s in (0.01, 100.0))
    assert large.seed[2] == pytest.approx(1e4 * small.seed[2], rel=SAME)
    assert numbers(large) == pytest.approx(numbers(small), rel=SAME)
    crank, rod = small.seed[0], small.seed[1]
    slide = 0.1 * np.cos(crank) + 0.3 * np.cos(crank + rod)
    assert small.seed[2] == pytest.approx(0.01 * slide)


@pytest.mark.parametrize("plane", [None, {"normal": [0, 1, 0]}])
def test_a_weld_behind_the_pin_changes_no_number(tmp_path: Path, plane: dict | None) -> None:
    """The loop closed by a point, and by a frame behind a fourth joint at the same place."""
    closed = load_mechanism(four_bar(tmp_path / "exact", plane=plane))
    seed = dict(zip(closed.joints, closed.seed.tolist(), strict=True))
    turned = {"j4": seed["j1"] + seed["j2"] - seed["j3"]}
    weld = [{"frames": ["e2", "pin"], "type": "frame"}]
    framed = four_bar(tmp_path / "frame", tree(more=PIN), plane=plane, closures=weld, seed=seed | turned)
    assert numbers(load_mechanism(framed)) == pytest.approx(numbers(closed), rel=SAME)


def test_the_measure_is_the_least_share_of_all_rates(tmp_path: Path) -> None:
    """One coordinate: of the rates of all four pins, by finite differences, the crank's share and the end's velocity;
    motions that open the loop a little lower it by about OPENING^2."""
    mechanism = load_mechanism(four_bar(tmp_path / "robot"))
    H = mechanism.velocity_map(mechanism.seed).ravel()
    rates = np.array([*H, H[0] + H[1] - H[2]])
    step = 1e-6
    x = mechanism.end_effector(mechanism.seed + step * H) - mechanism.end_effector(mechanism.seed - step * H)
    size = np.linalg.norm(rates)
    inverse, direct = mechanism.singularity(mechanism.seed)
    assert direct == pytest.approx(abs(H[0]) / size, rel=OPENING)
    assert inverse == pytest.approx(abs(x[0]) / (2 * step) / mechanism.length / size, rel=OPENING)
    assert characteristic_length(mechanism.model, ["e2", "e3"]) == pytest.approx(0.2)


def test_dead_points_and_change_points_are_singular(tmp_path: Path) -> None:
    """A rocker cannot drive a stretched crank; a flat parallelogram may fold either way."""
    angle = np.arccos((0.3**2 + 0.2**2 - 0.16**2) / (2 * 0.3 * 0.2))  # crank and coupler in line
    flat = {"j1": angle, "j2": 0.0, "j3": np.arctan2(0.3 * np.sin(angle), 0.3 * np.cos(angle) - 0.2)}
    rocker = load_mechanism(four_bar(tmp_path / "rocker", actuated=["j3"], independent=["j1"]))
    assert rocker.singularity(np.array(list(flat.values())))[1] < 1e-6 < rocker.singularity(rocker.seed)[1]
    distances = []
    for angle in (0.5, 0.01):
        frames = {"e2": {"link": "l2", "xyz": [0.2, 0, 0]}, "e3": {"link": "l3", "xyz": [0.1, 0, 0]}}
        seed = {"j1": angle, "j2": -angle, "j3": angle}
        keys = {"frames": frames, "seed": seed, "end_effector": {"frame": "e2", "axes": ["z"]}}
        folder = four_bar(tmp_path / f"{angle}", **keys)
        distances.append(load_mechanism(folder).singularity(np.array(list(seed.values())))[1])
    assert distances[1] < 0.1 * distances[0]


def test_serial_robots(tmp_path: Path) -> None:
    """Drives at all joints move in every motion; a stretched arm cannot follow."""
    arm = load_mechanism("example-robot-data/TwoDofs.urdf", guess=True)
    assert arm.singularity(arm.seed)[1] == 1.0 == arm.conditioning
    assert arm.singularity(np.zeros(2))[0] < 1e-9 < arm.singularity(arm.seed)[0]


def test_figures_name_the_true_axes(tmp_path: Path) -> None:
    def named(mechanism: Mechanism) -> list[str]:
        return coordinates(SimpleNamespace(problem=SimpleNamespace(mechanism=mechanism)))

    arm = load_mechanism("example-robot-data/TwoDofs.urdf", guess=True)
    follower = EndEffector(frame="tool", joints=tuple(arm.joints))
    turned = replace(arm, description=arm.description.model_copy(update={"end_effector": follower}))
    assert named(load_mechanism(GALLERY / "planar_delta")) == ["x_E [m]", "z_E [m]"]
    assert named(turned) == [f"{joint} [rad]" for joint in arm.joints]


def test_angles_are_told_in_rad(tmp_path: Path) -> None:
    """Where joints are followed, their own limits end the workspace, not a length of the robot."""
    mechanism = load_mechanism("example-robot-data/xarm7.urdf", guess=True)
    record = mechanism_record(mechanism)
    assert record["end_effector_units"] == ["rad"] * 7
    low, high = record["workspace"]["joint2"]
    assert (low, high) == pytest.approx((-2.059, 2.0944), abs=2e-3)
    assert reach(mechanism, np.eye(7)[0]) == pytest.approx(2 * np.pi, abs=1e-3)
