"""The laws of a closed mechanism, against an independent closed form and finite differences."""

import numpy as np
import pytest
from closed_form import model
from conftest import SHIPPED

from pkmsea.errors import InputError, Unreachable
from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.mechanism.workspace import workspace
from pkmsea.paper.readings import assumed as assumed_values

EQUAL = 1e-9  # asked for by the model's specification; rounding leaves three digits to spare
POSES = 1000
STEP = 1e-6  # of central differences: error near 1e-9 for motions of order one


@pytest.mark.parametrize(("name", "arms"), [("pkm_2rrr", "AB"), ("pkm_3rrr", "ABC")])
def test_equals_the_closed_form_at_random_closed_poses(mechanisms: dict[str, Mechanism], name: str, arms: str) -> None:
    mechanism, rng = mechanisms[name], np.random.default_rng(0)
    worst = dict.fromkeys(("M", "g", "H", "H_A", "closure", "r_E"), 0.0)
    for _ in range(POSES):
        r = 0.075 * np.sqrt(rng.uniform()) * np.array([np.cos(a := rng.uniform(0, 2 * np.pi)), np.sin(a)])
        v_ind = rng.normal(size=2)
        oracle = model(arms, r, v_ind)
        q = oracle["q"]
        ours = {
            "M": mechanism.mass_matrix(q) - oracle["M"],
            "g": mechanism.bias(q, v_ind) - oracle["g"],
            "H": mechanism.velocity_map(q) - oracle["H"],
            "H_A": mechanism.actuation_jacobian(q) - oracle["H_A"],
            "closure": mechanism.closure_residual(q),
            "r_E": mechanism.end_effector(q) - r,
        }
        for key, difference in ours.items():
            size = max(1.0, float(np.abs(oracle[key]).max())) if key in oracle else 1.0
            worst[key] = max(worst[key], float(np.abs(difference).max()) / size)
    assert max(worst.values()) < EQUAL, worst


@pytest.mark.parametrize("name", ["pkm_2rrr", "pkm_3rrr"])
def test_H_A_is_the_derivative_of_the_motion(mechanisms: dict[str, Mechanism], name: str) -> None:
    mechanism = mechanisms[name]
    point = np.array([0.03, -0.02])
    q = mechanism.configuration(point)
    for direction in np.eye(2):
        ahead, behind = (mechanism.configuration(point + s * STEP * direction) for s in (1, -1))
        rate = (ahead - behind) / (2 * STEP)
        v_ind = rate[mechanism.independent]
        np.testing.assert_allclose(mechanism.velocity_map(q) @ v_ind, rate, rtol=0, atol=1e-6)
        np.testing.assert_allclose(mechanism.actuation_jacobian(q) @ v_ind, rate[mechanism.actuated], rtol=0, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "mobility", "kind"),
    [
        ("linear_axis_1", 1, "fully actuated"),
        ("linear_axis_2", 1, "redundantly actuated"),
        ("pkm_2rrr", 2, "fully actuated"),
        ("pkm_3rrr", 2, "redundantly actuated"),
    ],
)
def test_mobility_and_class(mechanisms: dict[str, Mechanism], name: str, mobility: int, kind: str) -> None:
    assert (mechanisms[name].mobility, mechanisms[name].actuation_class) == (mobility, kind)


def test_configuration_keeps_the_assembly_mode(mechanisms: dict[str, Mechanism]) -> None:
    mechanism = mechanisms["pkm_3rrr"]
    for angle in np.linspace(0, 2 * np.pi, 12, endpoint=False):
        r = 0.1 * np.array([np.cos(angle), np.sin(angle)])
        np.testing.assert_allclose(mechanism.configuration(r), model("ABC", r, np.zeros(2))["q"], atol=1e-9)


def test_unreachable_point_says_how_far_it_gets(mechanisms: dict[str, Mechanism]) -> None:
    with pytest.raises(Unreachable, match=r"cannot reach the point \[0\.5, 0\.5\] on.*gets as far as \[0\.12"):
        mechanisms["pkm_2rrr"].configuration([0.5, 0.5])
    with pytest.raises(InputError, match="2 finite coordinates"):
        mechanisms["pkm_2rrr"].configuration([0.1, float("nan")])


def test_singularity_measures_vanish_at_singularities(mechanisms: dict[str, Mechanism]) -> None:
    mechanism = mechanisms["pkm_2rrr"]
    inside, border = mechanism.configuration([0.0, 0.0]), mechanism.configuration([0.1215, 0.1215])
    assert mechanism.singularity(border)[0] < 0.3 * mechanism.singularity(inside)[0]
    space = workspace(mechanism)
    assert np.nanmin(space.direct) < 0 < np.nanmax(space.direct)  # the curve of type 2 crosses the workspace
    assert space.reachable.any() and not space.reachable.all()


@pytest.mark.parametrize("name", SHIPPED)
def test_mechanisms_are_frozen(mechanisms: dict[str, Mechanism], name: str) -> None:
    with pytest.raises(AttributeError):
        mechanisms[name].mobility = 3  # type: ignore[misc]


def test_shipped_geometry_is_the_assumed_one(mechanisms: dict[str, Mechanism]) -> None:
    assumed = assumed_values()["pkm"]
    signs = assumed_values()["readings"]["printed"]["elbow_signs"]["value"]
    placements = mechanisms["pkm_3rrr"].model.jointPlacements
    radius = assumed["base_triangle_side"]["value"] / np.sqrt(3)
    for name, joint in (("A", 1), ("B", 3), ("C", 5)):
        angle = np.radians(assumed["base_angles"]["value"][name])
        base = radius * np.array([np.cos(angle), np.sin(angle), 0])
        np.testing.assert_allclose(placements[joint].translation, base, atol=1e-9)
        elbow = mechanisms["pkm_3rrr"].seed[joint]
        assert np.sign(-elbow) == signs[name]


def test_packaged_mechanisms_load_by_name_and_path() -> None:
    assert load_mechanism("urdf/pkm_2rrr").joints == load_mechanism("pkm_2rrr").joints


def test_points_behind_the_base_are_reached_by_detours() -> None:
    """A two-link arm of 0.32 and 0.28 m that is almost stretched: straight ways past its base are too near to it."""
    arm = load_mechanism("example-robot-data/TwoDofs.urdf", guess=True)
    start = arm.end_effector(arm.seed)
    behind = -start
    q = arm.configuration(behind)
    np.testing.assert_allclose(arm.end_effector(q), behind, atol=1e-9)
    assert np.sign(q[1]) == np.sign(arm.seed[1])  # the elbow stays on its side
    with pytest.raises(Unreachable):
        arm.configuration(100 * start)
