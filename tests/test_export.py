"""Feed-forward files: every number is the flat map's, the numbers alone move the robot, and bad input is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import ELASTIC, RIGID, SLIDER_ELASTIC, task
from scipy.integrate import solve_ivp
from scipy.interpolate import make_interp_spline
from test_cli import expect, run

import pkmsea
from pkmsea.errors import InputError, PkmseaError, Unverified
from pkmsea.motion.periodic import derivative
from pkmsea.motion.series import series
from pkmsea.solution import Solution, solve
from pkmsea.solution.feedforward import LARGEST, Sampling
from pkmsea.verification.drives import Drives
from pkmsea.verification.dynamics import Robot

HEAVY = {"inertia": 4.6e-4, "friction": 1e-3}
ORDER_10 = {"trajectory": {"kind": "fourier", "order": 10}, "starts": 1}
RATES = (1000.0, 1234.56)
SAME = 1e-12  # of numbers of order one to 100
SMOOTH = 1e-10  # spectral derivatives of a motion that is analytic in time
DRIVEN = 1e-7  # what an integration with a relative tolerance of 1e-10 keeps over one cycle [rad, m]
ENERGY = 2e-6  # the trapezoidal rule at the kinks of max(P, 0) with 1000 samples


@pytest.fixture(scope="module")
def elastic() -> Solution:
    return solve(task("pkm_2rrr", ELASTIC | HEAVY, options=ORDER_10), workers=1)


def read(path: Path) -> dict[str, np.ndarray]:
    """Columns of a CSV file by their names without units."""
    table = pd.read_csv(path, comment="#")
    return {name.split(" [")[0]: table[name].to_numpy() for name in table.columns}


@pytest.mark.parametrize("rate", RATES)
def test_samples_are_the_flat_maps_own(elastic: Solution, rate: float, tmp_path: Path) -> None:
    """All columns in both formats, evaluated at their own instants; the period's end is not repeated."""
    sampling = pkmsea.export(elastic, tmp_path / "a.csv", rate)
    pkmsea.export(elastic, tmp_path / "a.nc", rate)
    period = elastic.problem.cycle.period
    assert sampling.samples == np.ceil(rate * period) and sampling.rate >= rate
    s, mechanism = series(elastic.problem, elastic.motion, sampling.samples), elastic.problem.actuation.mechanism
    expected = {"time": np.arange(sampling.samples) * sampling.time, "x_E": s.r_E[:, 0], "y_E": s.r_E[:, 1]}
    for i, (joint, name) in enumerate(zip(mechanism.actuated, "AB", strict=True)):
        drive = {"q_M": s.q_M, "v_M": s.v_M, "tau": s.tau, "u": s.u}
        expected |= {f"{key}_{name}": values[:, i] for key, values in drive.items()}
        expected |= {f"{key}_A_{name}": getattr(s, key)[:, joint] for key in "qva"}
    expected["power"] = s.power
    columns = read(tmp_path / "a.csv")
    assert set(columns) == set(expected)
    with xr.open_dataset(tmp_path / "a.nc", engine="h5netcdf") as data:
        for name, values in expected.items():
            np.testing.assert_allclose(columns[name], values, rtol=SAME, atol=SAME, err_msg=name)
            np.testing.assert_array_equal(columns[name], data[name].values, err_msg=name)
        assert data["tau_A"].attrs["units"] == "N m" and data.attrs["sample_time_s"] == sampling.time
    assert columns["time"][0] == 0 and columns["time"][-1] + sampling.time == pytest.approx(period, rel=SAME)
    assert np.maximum(columns["power"], 0).mean() * period == pytest.approx(elastic.energy, rel=ENERGY)


@pytest.mark.parametrize("rate", RATES)
def test_drives_balance_in_exported_numbers(elastic: Solution, rate: float, tmp_path: Path) -> None:
    """M_M a_M + d_v v_M + u = tau and u = c (q_M - q_A) from the file alone, with spectral derivatives."""
    period = pkmsea.export(elastic, tmp_path / "a.csv", rate).period
    x = read(tmp_path / "a.csv")
    for c, name in zip(elastic.stiffness, "AB", strict=True):
        q_M, v_M, tau, u, q_A, v_A, a_A = (
            x[f"{key}_{name}"] for key in ("q_M", "v_M", "tau", "u", "q_A", "v_A", "a_A")
        )
        speed, acceleration = (derivative(q_M[:, None], period, order)[:, 0] for order in (1, 2))
        balance = HEAVY["inertia"] * acceleration + HEAVY["friction"] * v_M + u - tau
        np.testing.assert_allclose(balance, 0, atol=SMOOTH * np.abs(tau).max())
        np.testing.assert_allclose(speed, v_M, atol=SMOOTH * np.abs(v_M).max())
        np.testing.assert_allclose(derivative(v_A[:, None], period, 1)[:, 0], a_A, atol=SMOOTH * np.abs(a_A).max())
        np.testing.assert_allclose(c * (q_M - q_A), u, atol=SMOOTH)


@pytest.mark.parametrize("rate", RATES)
def test_exported_torque_drives_the_robot(elastic: Solution, rate: float, tmp_path: Path) -> None:
    """One cycle of the independent forward dynamics under the file's torques ends where it began, and passes through
    the file's motor positions and end-effector points."""
    sampling = pkmsea.export(elastic, tmp_path / "a.csv", rate)
    x, actuation, start = read(tmp_path / "a.csv"), elastic.problem.actuation, elastic.series
    robot = Robot(Drives(actuation, elastic.motion.stiffness, elastic.motion.parallel))
    rows = np.column_stack([x["tau_A"], x["tau_B"]])
    closed = np.append(x["time"], sampling.period)
    tau = make_interp_spline(closed, np.vstack([rows, rows[:1]]), k=5, bc_type="periodic")
    state = np.concatenate([start.q[0], start.v[0], start.q_M[0], start.v_M[0]])
    found = solve_ivp(
        lambda t, y: robot.rate(t, y, tau(t)), (0, sampling.period), state, "DOP853", closed, rtol=1e-10, atol=1e-12
    )
    q, _, q_M, _ = robot.split(found.y.T)
    for column, name in enumerate("AB"):
        np.testing.assert_allclose(q_M[:-1, column], x[f"q_M_{name}"], atol=DRIVEN)
    r_E = np.array([actuation.mechanism.end_effector(each) for each in q[:-1]])
    np.testing.assert_allclose(r_E, np.column_stack([x["x_E"], x["y_E"]]), atol=DRIVEN)
    np.testing.assert_allclose(found.y[:, -1], state, atol=100 * DRIVEN)


def test_csv_is_plain(elastic: Solution, tmp_path: Path) -> None:
    """NumPy and pandas read the same numbers; the head says what they are."""
    path = tmp_path / "ä b.csv"
    sampling = pkmsea.export(elastic, path, 300)
    numbers = np.loadtxt(path, delimiter=",", comments=("#", "time"))
    np.testing.assert_array_equal(numbers, pd.read_csv(path, comment="#").to_numpy())
    lines = path.read_text(encoding="utf-8").splitlines()
    head = dict(line[2:].split(": ", 1) for line in lines if line.startswith("# "))
    assert float(head["sample_time_s"]) == sampling.time
    assert (head["status"], head["setup"]) == ("verified", "setup")
    assert float(head["energy_per_cycle_J"]) == elastic.energy
    assert [float(part.split()[1]) for part in head["stiffness"].split("; ")] == elastic.stiffness.tolist()
    assert all(" [" in name for name in lines[len(head)].split(",")) and len(lines) == len(head) + 1 + 300


def test_geared_drives_have_columns_at_their_shafts(tmp_path: Path) -> None:
    """A gear of ratio i turns the same motion i times as far with an i-th of the torque."""
    ratio = 50.0
    geared = RIGID | {"inertia": 4.6e-4 / ratio**2, "copper_loss": 63.4 * ratio**2, "gear_ratio": ratio}
    drives = [geared, ELASTIC | HEAVY]
    solution = solve(task("pkm_2rrr", drives, options=ORDER_10), workers=1)
    pkmsea.export(solution, tmp_path / "a.csv")
    x = read(tmp_path / "a.csv")
    np.testing.assert_allclose(x["q_shaft_A"], ratio * x["q_M_A"], rtol=SAME)
    np.testing.assert_allclose(x["tau_shaft_A"] * x["v_shaft_A"], x["tau_A"] * x["v_M_A"], rtol=SAME, atol=SAME)
    np.testing.assert_allclose(x["q_M_A"], x["q_A_A"], rtol=SAME)
    assert "tau_shaft_B" not in x
    text = (tmp_path / "a.csv").read_text()
    assert "# gear_ratio: A 50.0 rad/rad\n" in text and "tau_shaft_A [N m]" in text
    kappa = np.array([geared["copper_loss"], 63.2])
    tau, v = np.column_stack([x["tau_shaft_A"], x["tau_B"]]), np.column_stack([x["v_shaft_A"], x["v_M_B"]])
    np.testing.assert_allclose((tau * v + kappa * tau**2).sum(axis=1), x["power"], rtol=SAME, atol=SAME)


def test_sliding_and_damped_drives(tmp_path: Path) -> None:
    """Metres and newtons for sliders; two drives on one joint; damped springs follow from the whole period."""
    drives = SLIDER_ELASTIC | {"damping": 1.0}
    solution = solve(task("linear_axis_2", drives, options=ORDER_10), workers=1)
    sampling = pkmsea.export(solution, tmp_path / "a.csv", 50, unverified=True)
    header = next(line for line in (tmp_path / "a.csv").read_text().splitlines() if line.startswith("time"))
    assert "[rad" not in header and "[N]" in header
    x, labels = read(tmp_path / "a.csv"), solution.problem.actuation.labels
    for c, label in zip(solution.stiffness, labels, strict=True):
        name = label.replace(" ", "_")
        wound = x[f"q_M_{name}"] - x[f"q_A_{name}"]
        force = c * wound + drives["damping"] * derivative(wound[:, None], sampling.period, 1)[:, 0]
        np.testing.assert_allclose(force, x[f"u_{name}"], atol=SMOOTH * np.abs(force).max())


@pytest.mark.parametrize("rate", [0.0, -1.0, np.nan, np.inf, 1e12, "fast"])
def test_bad_rates(elastic: Solution, rate: object, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"rate = .*(positive number|at most 100000 Hz)"):
        pkmsea.export(elastic, tmp_path / "a.csv", rate)  # type: ignore[arg-type]
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "rate, period, samples", [(1000, 0.7, 700), (1000, 1 / 3, 334), (3, 0.1, 1), (10, 10000, LARGEST)]
)
def test_whole_numbers_of_samples(rate: float, period: float, samples: int) -> None:
    sampling = Sampling.at_least(rate, period)
    assert sampling.samples == samples
    assert sampling.rate >= rate * (1 - SAME) and sampling.time * samples == pytest.approx(period, rel=SAME)


def test_unverified_results_say_so(elastic: Solution, tmp_path: Path) -> None:
    wrong = replace(elastic, claimed=elastic.claimed * 0.9)
    with pytest.raises(Unverified, match=r"not verified.*--unverified"):
        pkmsea.export(wrong, tmp_path / "a.csv")
    assert list(tmp_path.iterdir()) == []
    pkmsea.export(wrong, tmp_path / "a.csv", unverified=True)
    assert "# status: not verified: " in (tmp_path / "a.csv").read_text()


def test_files_that_cannot_be_written(elastic: Solution, tmp_path: Path) -> None:
    result = elastic.save(tmp_path / "a.nc")
    before = result.read_bytes()
    for path, text in [(result, "overwrite"), (tmp_path / "a.txt", r"\.csv or \.nc"), (result / "b.csv", "written")]:
        with pytest.raises(PkmseaError, match=text):
            pkmsea.export(result, path)
    assert result.read_bytes() == before and list(tmp_path.iterdir()) == [result]


def test_export_command(elastic: Solution, tmp_path: Path) -> None:
    result = elastic.save(tmp_path / "a.nc")
    done = run("export", result, "--rate", "1234.5")
    assert done.returncode == 0, done.stderr
    assert "1235 samples per cycle" in done.stdout and repr(1 / 1235) in done.stdout
    assert read(tmp_path / "a.csv")["tau_A"].size == 1235
    expect(run("export", result, "--rate", "nan"), 2, "rate = nan", "positive number")
    expect(run("export", tmp_path / "none.nc"), 2, "no such result file")
    wrong = replace(elastic, claimed=elastic.claimed * 0.9).save(tmp_path / "wrong.nc")
    expect(run("export", wrong), 1, "wrong.nc", "not verified", "--unverified")
    assert run("export", wrong, "--unverified").returncode == 0
