"""Energies do not depend on how a mechanism is written: axis signs, names, the opening of the loop, order of drives."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from conftest import ELASTIC, RIGID, task
from five_bar import LOOP, Variant, native
from hypothesis import given, settings
from hypothesis import strategies as st

from pkmsea.actuation import NUMBERS, Actuation, Drive, flat_map
from pkmsea.mechanism import load_mechanism
from pkmsea.solution import solve

EQUAL = 1e-6  # relative; asked for
INSTANTS = 40
JOINTS = [joint for _, joint, _ in LOOP]
PASSIVE = ("elbow_A", "tips", "elbow_B")  # the loop is not opened at a drive: its joint would have no coordinate
DRIVES = {  # per joint, so that an exchange shows
    "A": ELASTIC | {"inertia": 4.6e-4, "friction": 4.8e-3, "stiffness": 0.12},
    "B": RIGID | {"inertia": 2.3e-4, "friction": 1.1e-3},
}

variants = st.builds(
    Variant,
    open_at=st.sampled_from(PASSIVE),
    flipped=st.frozensets(st.sampled_from(JOINTS)),
    names=st.permutations(JOINTS).map(lambda names: dict(zip(JOINTS, names, strict=True)))
    | st.just({joint: f"Gelenk {i}/é" for i, joint in enumerate(JOINTS)}),
    drives=st.permutations(["A", "B"]).map(tuple),
)


def turnover(variant: Variant) -> np.ndarray:
    """Electrical energy of one fixed cycle, and the torques of drives A and B squared, by the exact flat map."""
    with tempfile.TemporaryDirectory() as folder:
        mechanism = load_mechanism(native(Path(folder) / "robot", variant))
    drives = [Drive.model_validate(DRIVES[joint]) for joint in variant.drives]
    actuation = Actuation(mechanism, tuple(drives))
    function, kappa = flat_map(actuation.structure), actuation.numbers("copper_loss")
    r, none = np.concatenate([actuation.numbers(key) for key in NUMBERS]), np.zeros(len(drives))
    c = [drive.stiffness_range[0] if drive.elastic else 1.0 for drive in drives]
    w, total = 2 * np.pi, np.zeros(3)
    for t in np.arange(INSTANTS) / INSTANTS:
        phases = w * t + np.arange(5) * np.pi / 2  # each derivative of a cosine is a quarter turn ahead
        Y = np.array([0.06 * np.cos(phases), 0.05 * np.cos(phases + 0.7)]) * w ** np.arange(5)
        out = function(mechanism.configuration(Y[:, 0]), Y, np.zeros((0, 3)), c, none, none, np.zeros((1, 3)), r)
        v_M, tau = (np.array(out[i]).ravel() for i in (1, 2))
        by_joint = {joint: tau[i] ** 2 for i, joint in enumerate(variant.drives)}
        power = float(tau @ v_M + kappa @ tau**2)
        total += np.array([max(power, 0.0), by_joint["A"], by_joint["B"]]) / INSTANTS
    return total


@pytest.fixture(scope="module")
def reference() -> np.ndarray:
    return turnover(Variant())


@settings(max_examples=25, deadline=None, derandomize=True)
@given(variant=variants)
def test_energy_of_a_motion(reference: np.ndarray, variant: Variant) -> None:
    np.testing.assert_allclose(turnover(variant), reference, rtol=EQUAL)


def test_optimal_energy(tmp_path: Path) -> None:
    renamed: Mapping[str, str] = dict(zip(JOINTS, reversed(JOINTS), strict=True))
    written = {
        "as it is": Variant(),
        "otherwise": Variant("elbow_B", frozenset({"A", "elbow_A", "tips"}), renamed, ("B", "A")),
    }
    energies = {}
    for name, variant in written.items():
        folder = native(tmp_path / name, variant)
        drives = [DRIVES[joint] for joint in variant.drives]
        energies[name] = solve(task(str(folder), drives), workers=1).energy
    assert energies["otherwise"] == pytest.approx(energies["as it is"], rel=EQUAL)
