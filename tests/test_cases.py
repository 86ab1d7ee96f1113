"""The cases of shared/cases by kind: small inputs that were once read wrongly, with the right value from elsewhere.

They lie beside the checkout, where there are any. Each right value is a test on an input of our own, too.
"""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from pkmsea.errors import InputError
from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.verification.loops import Loops
from pkmsea.views.tables import mechanism_record

CASES = Path(__file__).parents[2] / "shared" / "cases"
EXACT = 1e-12

MOBILITY = {  # what is read, and how many coordinates the closed mechanism has
    **{f"urdf_loop_elements_dropped/{name}.urdf": 1
       for name in ("constraint_loop", "drake_ball", "gazebo_loop", "loop_joint_isaac")},
    "onshape_link_origin/robot.urdf": 1,
    "urdf_sidecar_couplings_replace_mimic/mimicside": 1,
    "locked_mimic": 3,
    "plane_rounded_rpy": 2,
    "plane_rounded_rpy_min": 1,
    "plane_normal_digits": 1,
    "verify_layers": 1,
    "robot_delta_idle": 2,
    "urdf_capsule_and_noname/capsule.urdf": 2,
    "urdf_capsule_and_noname/robot_noname.urdf": 2,
    "urdf_quat_xyzw_locked/q11": 1,
}  # fmt: skip
NOTED = {
    "open_chain_no_hint/ax5.urdf": "'tip_a' and 'tip_b' are 2.8. mm apart",
    "plane_rounded_rpy": r"plane: made exact; .* \d\.\de-06 rad off",
    "plane_rounded_rpy_min": "3.7e-06 rad off",
    "plane_normal_digits": "its normal was 8.5e-06 rad off",
    "seed_outside_limits": "'panda_joint4' stands at 2, outside its limits of -3.07",
    "gravity_across/planar_leg_linkage.urdf": "gravity .* does no work in any motion",
    "locked_mimic": "'panda_finger_joint2': held at 0.02",
    "urdf_capsule_and_noname/capsule.urdf": "link 'arm': <capsule> is not drawn",
    "urdf_units_not_noticed/rpy_degrees.urdf": "joint 'b': rpy = 0 0 90 is more than a turn",
    "urdf_units_not_noticed/limit_degrees.urdf": "joint 'a': limits -90 to 90 are many turns",
    "urdf_units_not_noticed/grams_mass.urdf": "link 'arm': its radius of gyration is 0.0033 m, and it is 0.3 m long",
    "urdf_units_not_noticed/mm_lengths.urdf": "joint 'b': its origin is 300 m away",
}
REFUSED = {
    "gepetto_joint_type_remove_it": "joint_type.0 = 'SPHERICAL': The joint 'ball' .* another mechanism",
    "layers_no_plane": r"normal \[0, 1, 0\], and its ends lie 0.8 mm apart.*plane: \{normal: \[0, 1, 0\]\}",
    "urdf_axis_element_empty/axis_empty.urdf": "joint 'b': axis xyz",
    "urdf_zero_mass_message/mass_zero_inertia.urdf": "link 'fore': mass = 0.0: The mass is zero",
}


def case(name: str) -> Path:
    path = CASES / name
    if not path.exists():
        pytest.skip(f"{path} is not there")
    return path


def load(name: str) -> Mechanism:
    return load_mechanism(case(name), guess=True)


@pytest.mark.parametrize("name", MOBILITY)
def test_read(name: str) -> None:
    assert load(name).mobility == MOBILITY[name]


@pytest.mark.parametrize("name", NOTED)
def test_noted(name: str) -> None:
    try:
        notes = load(name).description.notes
    except InputError as error:
        notes = error.notes
    assert any(re.search(NOTED[name], note) for note in notes), notes


@pytest.mark.parametrize("name", REFUSED)
def test_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"(?s)" + REFUSED[name]):
        load(name)


def test_couplings_of_tree_and_sidecar() -> None:
    """b = -a and c = 2 a."""
    mechanism = load("urdf_sidecar_couplings_replace_mimic/mimicside")
    rates = mechanism.velocity_map(mechanism.seed).ravel()
    np.testing.assert_allclose(rates / rates[0], [1, -1, 2])


def test_a_locked_quaternion() -> None:
    """M of `pin.buildReducedModel`: 0.111, not the 0.110 of a joint that is not turned."""
    mechanism = load("urdf_quat_xyzw_locked/q11")
    assert mechanism.mass_matrix(mechanism.seed)[0, 0] == pytest.approx(0.111, rel=1e-9)


def test_layers_open_no_loop() -> None:
    """The rocker stands 20 mm beside the coupler."""
    mechanism = load("verify_layers")
    data = mechanism.model.createData()
    for x in (0.18, 0.2, 0.24):
        q = mechanism.configuration([x])
        assert np.abs(Loops(mechanism).at(data, q, 0 * q).Phi).max() < EXACT


def test_numbers_without_units() -> None:
    """A weld behind a pin has the numbers of a point; a mechanism of 4 cm is not singular for its size."""
    frame, point = load("singularity_scale/frame"), load("singularity_scale/point")
    ours, theirs = ([*m.singularity(m.seed), m.conditioning] for m in (frame, point))
    assert ours == pytest.approx(theirs, rel=1e-3)
    small = load("robot_delta_idle")
    assert min(*small.singularity(small.seed), small.conditioning) > 0.1


def test_a_seed_outside_limits_leaves_a_workspace() -> None:
    low, high = mechanism_record(load("seed_outside_limits"))["workspace"]["x"]
    assert high - low > 0.1


def test_angles_are_told_in_rad() -> None:
    case("units_of_angles")
    mechanism = load_mechanism("example-robot-data/xarm7.urdf", guess=True)
    assert mechanism_record(mechanism)["end_effector_units"] == ["rad"] * 7


def test_points_behind_the_base_are_reached() -> None:
    """A SCARA of two links of 0.2 m; straight lines from the seed to two of the points pass its base."""
    mechanism = load("walk_straight_line_refuses")
    for point in ([0.3, 0.0], [0.0, 0.3], [-0.3, 0.0], [0.0, -0.3]):
        np.testing.assert_allclose(mechanism.end_effector(mechanism.configuration(point)), point, atol=1e-9)
