"""The forward simulation: its own laws, results that it confirms, and wrong ones that it catches."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import five_bar
import numpy as np
import pytest
import spatial
import xarray as xr
from conftest import ELASTIC, FRICTION, PARALLEL, RIGID, SLIDER_ELASTIC, SLIDER_RIGID, task
from scipy.integrate import solve_ivp
from test_cli import copy_mechanism, expect, run

from pkmsea.actuation import Actuation, Drive
from pkmsea.errors import InputError
from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.paper import reproduce
from pkmsea.solution import Solution, solve
from pkmsea.verification import Verification, verify
from pkmsea.verification.drives import Drives
from pkmsea.verification.dynamics import Robot
from pkmsea.verification.loops import Loops

HEAVY = {"inertia": 4.67e-4, "friction": 4.79e-3}  # the paper's rotors of its third case
FOURIER = {"trajectory": {"kind": "fourier", "order": 10}, "starts": 1}
LIMITED = ELASTIC | HEAVY | {"torque": 0.3, "speed": 20}
SETUPS = {
    "slider": ("linear_axis_2", SLIDER_ELASTIC, {"options": FOURIER}),
    "rigid slider": ("linear_axis_1", SLIDER_RIGID, {"options": FOURIER}),
    "two elastic arms": ("pkm_2rrr", LIMITED, {"limits": {"joints": {"acceleration": 200}}}),
    "three elastic arms": ("pkm_3rrr", ELASTIC | HEAVY, {}),
    "all elements": (
        "pkm_2rrr",
        [ELASTIC | HEAVY | FRICTION | {"cubic": 0.5}, RIGID | HEAVY | FRICTION | PARALLEL],
        {"payload": {"mass": 0.1, "pick": 1, "place": 2}},
    ),
    "mixed, damped": ("pkm_3rrr", [RIGID | HEAVY, ELASTIC | HEAVY | {"damping": 2e-3}, RIGID | HEAVY], {}),
}
ENERGY = 5e-3  # asked for; the simulation agrees to 1e-5, which the trapezoidal rule at the kinks of max(P, 0) leaves
END_EFFECTOR = {"linear": 1e-4, "pkm": 1e-5}  # asked for [m]
EXACT = 1e-8  # what an integration with a relative tolerance of 1e-10 can keep of motions of order one


@pytest.fixture(scope="module")
def solved() -> Callable[[str], Solution]:
    found: dict[str, Solution] = {}

    def of(name: str) -> Solution:
        if name not in found:
            mechanism, drives, changes = SETUPS[name]
            found[name] = solve(task(mechanism, drives, **changes), workers=1)
        return found[name]

    return of


def robot(mechanism: Mechanism, drive: dict) -> Robot:
    m = len(mechanism.actuated)
    actuation = Actuation(mechanism, (Drive.model_validate(drive),) * m)
    return Robot(Drives(actuation, np.full(m, 0.1), np.full((m, 2), np.nan)))


def coupled(folder: Path) -> Path:
    """The five-bar with both bases geared to each other: mobility 1."""
    keys = five_bar.sidecar(five_bar.Variant()) | {"closures": [{"frames": ["tip_1", "tip_2"]}], "actuated": ["A"]}
    q, keys["end_effector"] = keys["seed"], {"frame": "tool", "axes": ["x"]}
    keys["couplings"] = [{"joint": "B", "of": "A", "ratio": -0.5, "offset": q["B"] + 0.5 * q["A"]}]
    return five_bar.write(folder, "robot.urdf", five_bar.urdf(five_bar.Variant()), keys)


def close(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    """The nearest closed pose, by Newton steps of least norm."""
    for _ in range(20):
        q = q - np.linalg.pinv(np.array(mechanism.functions["closure_jacobian"](q))) @ mechanism.closure_residual(q)
    return q


def check(found: Verification, kind: str) -> None:
    assert found.verified, found.status
    assert found.gap < ENERGY
    assert found.end_effector < END_EFFECTOR[kind]
    assert found.feedback < 1e-5
    assert found.optimality is not None and found.optimality.kind == "minimum"


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=pytest.mark.long) if name == "three elastic arms" else name for name in SETUPS]
)
def test_solutions_are_confirmed(solved: Callable[[str], Solution], name: str) -> None:
    found = verify(solved(name))
    check(found, SETUPS[name][0].split("_")[0])
    assert found.closure < EXACT
    assert found.window < 0
    assert all(excess < 0 for excess in found.limits.values())


def test_joints_as_task_coordinates(tmp_path: Path) -> None:
    folder = copy_mechanism(tmp_path, sidecar=("axes: [x, y]", "joints: [A, B]"))
    mechanism = load_mechanism("pkm_2rrr")
    poses = [mechanism.configuration(point)[mechanism.actuated] for point in ([-0.06, -0.06], [0.06, 0.06])]
    points = [{"at": list(pose), "rest": 0.1, "window": 5e-3} for pose in poses]
    found = verify(solve(task(str(folder), RIGID, cycle={"period": 1.0, "points": points}), workers=1))
    assert found.verified, found.status


@pytest.mark.parametrize("name", ["pkm_2rrr", "pkm_3rrr"])
def test_acceleration_equals_the_minimal_coordinates(mechanisms: dict[str, Mechanism], name: str) -> None:
    """M a_ind + g = H_A^T u with the optimiser's own M, g and H_A."""
    mechanism, rng = mechanisms[name], np.random.default_rng(0)
    simulated = robot(mechanism, ELASTIC)
    for point in rng.uniform(-0.05, 0.05, (20, 2)):
        q, v_ind, u = mechanism.configuration(point), rng.normal(size=2), rng.normal(size=len(mechanism.actuated))
        H_A = mechanism.actuation_jacobian(q)
        expected = np.linalg.solve(mechanism.mass_matrix(q), H_A.T @ u - mechanism.bias(q, v_ind))
        a = simulated.acceleration(0.0, q, mechanism.velocity_map(q) @ v_ind, u)
        np.testing.assert_allclose(a[mechanism.independent], expected, rtol=EXACT, atol=EXACT * np.abs(expected).max())


@pytest.mark.parametrize("build", [five_bar.urdfplus, spatial.welded, spatial.delta, coupled])
def test_loops_equal_the_minimal_coordinates(build: Callable[[Path], Path], tmp_path: Path) -> None:
    """Closures by points, axes and frames, and a coupling: G H = 0, and the same accelerations keep them closed."""
    mechanism, rng = load_mechanism(build(tmp_path / "robot")), np.random.default_rng(0)
    loops, data, f = Loops(mechanism), mechanism.model.createData(), mechanism.functions
    for _ in range(10):
        q = close(mechanism, mechanism.seed + rng.uniform(-0.1, 0.1, mechanism.model.nq))
        H = mechanism.velocity_map(q)
        v = H @ rng.normal(size=mechanism.mobility)
        G, gamma = np.array(f["closure_jacobian"](q)), np.array(f["closure_bias"](q, v)).ravel()
        a = H @ rng.normal(size=mechanism.mobility) - np.linalg.pinv(G) @ gamma
        found = loops.at(data, q, v)
        np.testing.assert_allclose(found.Phi, 0, atol=EXACT)
        np.testing.assert_allclose(found.G @ H, 0, atol=EXACT)
        np.testing.assert_allclose(found.G @ a + found.bias, 0, atol=EXACT)
        assert np.linalg.matrix_rank(found.G, tol=1e-6) == mechanism.model.nq - mechanism.mobility


@pytest.mark.parametrize("closure", ["point", "frame"])
def test_free_motion_keeps_its_energy(tmp_path: Path, closure: str) -> None:
    """With gravity, without torque and friction; a pinned tip moves, a welded one moves as one body of mobility 1."""
    down = ("gravity: [0, 0, 0]", "gravity: [0, -9.81, 0]")
    mechanism = load_mechanism(copy_mechanism(tmp_path, sidecar=down))
    closed = mechanism.description.closures[0].model_copy(update={"type": closure})
    mechanism = replace(mechanism, description=mechanism.description.model_copy(update={"closures": (closed,)}))
    free, q = robot(mechanism, ELASTIC | {"inertia": 4e-4}), mechanism.seed
    x = np.concatenate([q, np.zeros(4), q[mechanism.actuated] + [0.3, -0.2], np.zeros(2)])
    end = solve_ivp(lambda t, x: free.rate(t, x, np.zeros(2)), (0, 0.1), x, "DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
    moved = np.abs(end[:4] - q).max()
    assert moved > 1e-3
    assert free.energy(end) == pytest.approx(free.energy(x), abs=EXACT)
    start, later = (free.loops.at(free.data, *free.split(state)[:2]).Phi for state in (x, end))
    np.testing.assert_allclose(later[:3], start[:3], rtol=0, atol=EXACT)


def edit(source: Path, target: Path, change: Callable[[xr.Dataset], None]) -> Path:
    with xr.open_dataset(source, engine="h5netcdf") as dataset:
        change(dataset)
        dataset.to_netcdf(target, engine="h5netcdf")
    return target


def scaled(name: str, factor: float) -> Callable[[xr.Dataset], None]:
    def change(dataset: xr.Dataset) -> None:
        dataset[name] *= factor

    return change


def shifted(name: str, at: tuple[int, ...], by: float) -> Callable[[xr.Dataset], None]:
    def change(dataset: xr.Dataset) -> None:
        values = dataset[name].values.copy()
        values[at] += by
        dataset[name].values = values

    return change


def energy_scaled(factor: float) -> Callable[[xr.Dataset], None]:
    return lambda dataset: dataset.attrs.update(energy=dataset.attrs["energy"] * factor)


def drives_changed(**numbers: float) -> Callable[[xr.Dataset], None]:
    def change(dataset: xr.Dataset) -> None:
        record = json.loads(dataset.attrs["task"])
        for drive in record["setups"][0]["drives"]:
            drive.update(numbers)
        dataset.attrs["task"] = json.dumps(record)

    return change


WRONG = {
    "stiffness": (scaled("stiffness", 1.05), "do not follow from its torque"),
    "torque": (scaled("tau", 1.02), "the result prints"),
    "knot": (shifted("flat_output", (20, 0), 1e-3), "flat_output"),
    "position": (shifted("r_E", (300, 0), 1e-3), "the end effector deviates by 1.0e-03 m"),
    "energy": (energy_scaled(0.99), "the result prints"),
    "one torque": (shifted("tau", (300, 0), 0.5), "do not follow from its torque"),
    "motor speed": (shifted("v_M", (310, 1), 0.1), "v_M"),
    "rotor": (drives_changed(inertia=5.25), "do not follow from its torque"),
    "copper": (drives_changed(copper_loss=1.51e-3), "the result prints"),
    "limit": (drives_changed(torque=5.0), "the limit of tau slide 1 is overstepped"),
}


@pytest.mark.parametrize("wrong", WRONG)
def test_a_wrong_file_is_caught(solved: Callable[[str], Solution], tmp_path: Path, wrong: str) -> None:
    change, words = WRONG[wrong]
    path = solved("slider").save(tmp_path / "result.nc")
    found = verify(edit(path, tmp_path / "wrong.nc", change))
    assert not found.verified
    assert words in found.status, found.status


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (scaled("stiffness", -1.0), "not positive"),
        (shifted("tau", (3, 0), np.nan), "missing"),
        (energy_scaled(np.nan), "not finite"),
        (drives_changed(inertia=0.0), "A motor without inertia"),
    ],
)
def test_a_damaged_file_is_named(
    solved: Callable[[str], Solution], tmp_path: Path, change: Callable[[xr.Dataset], None], words: str
) -> None:
    path = solved("slider").save(tmp_path / "result.nc")
    with pytest.raises(InputError, match=words):
        verify(edit(path, tmp_path / "damaged.nc", change))


def test_command(solved: Callable[[str], Solution], tmp_path: Path) -> None:
    good = solved("rigid slider").save(tmp_path / "good.nc")
    bad = edit(good, tmp_path / "bad.nc", energy_scaled(1.01))
    process = run("verify", good, "--json")
    assert process.returncode == 0, process.stderr
    (record,) = json.loads(process.stdout)
    assert record["verified"] and record["gap"] < ENERGY
    process = run("verify", good, bad)
    assert process.returncode == 1
    assert "bad.nc: not verified: the result prints" in process.stdout
    expect(run("verify", tmp_path / "none.nc"), 2, "no such result file")


@pytest.mark.long
def test_all_setups_of_the_paper() -> None:
    for row in reproduce(starts=2):
        check(verify(row.solution), "linear" if row.table == 1 else "pkm")
