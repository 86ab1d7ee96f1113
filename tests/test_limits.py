"""Limits: read from a URDF, kept at every instant at no cost, told where they bind, contend or exclude a point."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import casadi as ca
import five_bar
import numpy as np
import pytest
from conftest import RIGID, SLIDER_RIGID, task
from lxml import etree

from pkmsea.description.limits import JointLimits, joint_limits
from pkmsea.errors import Infeasible, InputError
from pkmsea.new import new
from pkmsea.problem import Problem, build_problem
from pkmsea.solution import Solution, solve
from pkmsea.solution.contention import contention, least_widened, stretched
from pkmsea.task import Limits, TaskLimits, load_task
from pkmsea.transcription import transcribe
from pkmsea.transcription.between import beyond
from pkmsea.views.records import solution_record

FREE = 4.202  # [J] of the slider without limits, whose end effector moves from 0.699 to 1.101 m
FOURIER = {"trajectory": {"kind": "fourier", "order": 8}, "starts": 1}
ARM = (
    '<robot name="arm"><link name="base"/><link name="arm"><inertial><origin xyz="0.5 0 0"/><mass value="2"/>'
    '<inertia ixx="1e-6" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link><joint name="a" type="{}">'
    '<parent link="base"/><child link="arm"/><axis xyz="0 0 1"/><limit {}/></joint></robot>'
)
KEYS = {"actuated": ["a"], "end_effector": {"frame": "arm", "joints": ["a"]}, "gravity": [0, 0, 0]}
DRIVE = {"kind": "rigid", "inertia": 0.02, "copper_loss": 0.5}


def arm(folder: Path, limit: str, **keys: object) -> str:
    return str(five_bar.write(folder / "arm", "arm.urdf", ARM.format("revolute", limit), KEYS | keys))


def swing(mechanism: str, to: float = 0.3, drive: dict | None = None, **changes: object) -> Problem:
    points = [{"at": [at], "rest": 0.05, "window": 1e-3} for at in (-to, to)]
    return build_problem(task(mechanism, drive or DRIVE, cycle={"period": 1.0, "points": points}, **changes))


def slider(*ends: float, options: dict | None = None) -> Problem:
    limits = {"end_effector": {"position": {"x": ends}}} if ends else {}
    return build_problem(task("linear_axis_1", SLIDER_RIGID, limits=limits, options=options or FOURIER))


@pytest.mark.parametrize(
    ("kind", "limit", "expected"),
    [
        ("revolute", 'lower="-1" upper="2" velocity="3" effort="4"', JointLimits(-1, 2, 3, 4)),
        ("revolute", 'lower="0" upper="0" velocity="0" effort="0"', JointLimits()),
        ("revolute", 'lower="-1e16" upper="2" velocity="1000" effort="inf"', JointLimits(upper=2)),
        ("prismatic", 'upper="0.4"', JointLimits(0, 0.4)),
        ("prismatic", 'lower="-inf" upper="inf" effort=""', JointLimits()),
        ("continuous", 'lower="-1" upper="1" velocity="3"', JointLimits(velocity=3, continuous=True)),
    ],
)
def test_numbers_that_stand_for_none(kind: str, limit: str, expected: JointLimits) -> None:
    joint = etree.fromstring(ARM.format(kind, limit)).find("joint")
    assert joint_limits(joint, Path("arm.urdf")) == expected


@pytest.mark.parametrize("limit", ['velocity="-1"', 'effort="much"', 'lower="nan"', 'lower="1" upper="-1"'])
def test_limits_that_mean_nothing_are_refused(tmp_path: Path, limit: str) -> None:
    with pytest.raises(InputError, match="joint 'a': limit"):
        swing(arm(tmp_path, limit))


def test_placeholders_are_told(tmp_path: Path) -> None:
    problem = swing(arm(tmp_path, 'lower="-1000" upper="2" velocity="0" effort="5"'))
    (note,) = problem.mechanism.description.notes
    assert note.endswith("velocity 0 (a); lower -1000 (a)")
    assert [(b.label, b.lower, b.upper) for b in problem.bounds] == [("q a", -math.inf, 2), ("tau a", -5, 5)]


def test_limits_of_the_urdf_hold_unless_switched_off(tmp_path: Path) -> None:
    """Beside those of the task, the tighter one of both; a drive's own torque replaces the effort."""
    limits = {"joints": {"velocity": 3.0, "position": {"a": [-0.35, 1]}}}
    mechanism = arm(tmp_path, 'lower="-1" upper="0.4" velocity="2" effort="5"')
    both = swing(mechanism, drive=DRIVE | {"torque": 9}, limits=limits)
    assert {b.label: (b.lower, b.upper) for b in both.bounds} == {
        "q a": (-0.35, 0.4), "dq a": (-2, 2), "tau a": (-9, 9)
    }  # fmt: skip
    alone = replace(both, limits=TaskLimits(joints=Limits(velocity=3.0), urdf=False))
    assert {b.label: b.upper for b in alone.bounds} == {"dq a": 3, "tau a": 9}
    with pytest.raises(InputError, match=r"limits\.joints\.position\.a = .*no room beside <limit> of joint 'a'"):
        swing(mechanism, limits={"joints": {"position": {"a": [0.5, 1]}}})


def test_a_limit_that_excludes_a_point_is_told_before_any_solve(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"limits\.end_effector\.position\.x.*Operating point 2 is excluded.*1\.1 m"):
        slider(0.5, 1.0)
    mechanism = arm(tmp_path, 'lower="-0.3" upper="0.3"')
    with pytest.raises(InputError, match=r"cycle\.points\.0\.at.*'a' is at -0\.4 rad.*urdf: false"):
        swing(mechanism, to=0.4)
    swing(mechanism, to=0.4, limits={"urdf": False})
    swing(mechanism, to=0.3)


@pytest.fixture(scope="module")
def free() -> Solution:
    return solve(slider(), workers=1)


@pytest.mark.parametrize("ends", [(0.699, 1.101), (-10, 1.105), (0, 1.2)])
def test_a_limit_that_the_motion_keeps_costs_nothing(free: Solution, ends: tuple[float, float]) -> None:
    found = solve(slider(*ends), workers=1)
    assert free.energy == pytest.approx(FREE, abs=5e-4)
    assert found.verified and found.energy == pytest.approx(free.energy, rel=1e-4)
    assert bool(found.audit().binding) == (ends[0] == 0.699)


def test_a_far_off_other_limit_changes_nothing() -> None:
    energies = [solve(slider(low, 1.1002), workers=1).energy for low in (-1e4, -20)]
    assert energies[0] == energies[1] > 1.02 * FREE


@pytest.mark.parametrize("peaks", [3, 7])
def test_extrema_between_samples(peaks: int) -> None:
    t = np.arange(100) / 100
    values = np.sin(2 * np.pi * peaks * (t + 0.0037))
    found = values + beyond(values)
    assert found.max() == pytest.approx(1, abs=1e-6) and found.min() == pytest.approx(-1, abs=1e-6)
    assert values.max() < 1 - 1e-5


def test_limits_of_drives_and_joints_are_kept_and_told() -> None:
    """Torque and joint speed on their limits, where the torque rides along it, at every instant of the dense grid."""
    problem = build_problem(task("pkm_2rrr", RIGID | {"inertia": 4.6e-4}))
    loose = solve(problem, workers=1)
    torque, speed = 0.85 * np.abs(loose.series.tau).max(), 0.95 * np.abs(loose.series.v[:, 0]).max()
    drives = tuple(drive.model_copy(update={"torque": torque}) for drive in problem.drives)
    tight = replace(problem, drives=drives, limits=TaskLimits(joints=Limits(velocity={"A": speed})))
    found = solve(tight, workers=1)
    assert found.verified and found.energy > loose.energy
    assert np.abs(found.series.tau).max() <= torque and np.abs(found.series.v[:, 0]).max() <= speed
    told = solution_record(found, None)["binding"]
    assert any(side.startswith("tau ") for side in told) and any(side.startswith("dq A ") for side in told)


def test_what_contends_and_the_shortest_period() -> None:
    """A slider at its speed limit v needs 2 (d / v + rest) for the way d between its windows, and that of a smooth
    motion is little longer; 1 % more is enough, 2 % less is not."""
    v, d, rest = 0.5, 0.4 - 2 * 1e-3, 0.275
    problem = slider(options={"starts": 1, "meshes": 1})
    problem = replace(problem, limits=TaskLimits(end_effector=Limits(velocity=v)))
    problem = replace(problem, cycle=stretched(problem.cycle, 1.2))
    with pytest.raises(Infeasible, match=r"dr_E x <= 0\.5 needs .*limits\.end_effector\.velocity") as caught:
        solve(problem, workers=1)
    found = caught.value.contention
    least = d / (1.2 / 2 - rest)
    (told,) = found.widened
    assert least < float(told.split()[-1]) < 1.08 * least
    shortest = 2 * (d / v + rest)
    assert shortest < found.period < 1.08 * shortest
    solve(replace(problem, cycle=stretched(problem.cycle, 1.01 * found.period)), workers=1)
    short = least_widened(transcribe(replace(problem, cycle=stretched(problem.cycle, 0.98 * found.period))))
    assert short is not None and not short.kept


def test_no_period_helps_where_gravity_is_too_much(tmp_path: Path) -> None:
    """The arm of 2 kg at 0.5 m, level, takes 9.8 N m in any period."""
    problem = swing(arm(tmp_path, 'lower="-1" upper="1" effort="8"', gravity=[0, -9.81, 0]))
    found = least_widened(transcribe(problem))
    assert found is not None
    told = contention(problem, found)
    assert told.period is None and told.widened[0].startswith("tau a <= 8 needs") and "No longer period" in str(told)
    assert told.remedy.startswith("Widen <limit> of joint 'a' in arm.urdf")


def test_exact_derivatives_of_the_relaxed_nlp() -> None:
    limits = {"joints": {"velocity": {"elbow_A": 4.0}}, "end_effector": {"position": {"x": [-0.08, 0.08]}}}
    problem = build_problem(task("pkm_2rrr", RIGID | {"torque": 0.1}, limits=limits))
    transcription = transcribe(problem)
    x = transcription.start(None)
    relaxed = transcription.relaxed(x, [bound.label for bound in problem.bounds])
    assert relaxed is not None
    nlp, sides = relaxed
    rng, z, h = np.random.default_rng(1), nlp.stacked("guess"), 1e-6
    direction, p = rng.normal(size=z.size) * 1e-2 * nlp.stacked("scale"), nlp.parameter(0, z)
    multipliers = rng.normal(size=nlp.g_lower.size)
    (f_1, g_1), (f_0, g_0) = nlp.oracle(z + h * direction, p), nlp.oracle(z - h * direction, p)
    slope = np.array(nlp.derivatives["grad_f"](z, p)[1]).ravel()
    jacobian = ca.DM(nlp.derivatives["jac_g"](z, p)[1])
    change = np.array(g_1 - g_0).ravel() / (2 * h)
    assert float(f_1 - f_0) / (2 * h) == pytest.approx(slope @ direction, rel=1e-5)
    np.testing.assert_allclose(np.array(jacobian @ direction).ravel(), change, atol=1e-5 * np.abs(change).max())

    def lagrangian_slope(at: np.ndarray) -> np.ndarray:
        J, rise = (nlp.derivatives[key](at, p)[1] for key in ("jac_g", "grad_f"))
        return np.array(rise).ravel() + np.array(J.T @ multipliers).ravel()

    hessian = np.array(ca.triu2symm(ca.DM(nlp.derivatives["hess_lag"](z, p, 1.0, multipliers))))
    bent = (lagrangian_slope(z + h * direction) - lagrangian_slope(z - h * direction)) / (2 * h)
    np.testing.assert_allclose(hessian @ direction, bent, atol=1e-4 * np.abs(bent).max())
    assert {side.bound.quantity for side in sides} == {"r_E", "tau", "q", "dq"}


def test_new_writes_a_period_that_joints_allow(tmp_path: Path) -> None:
    folder = Path(arm(tmp_path, 'lower="-1" upper="1" velocity="0.5" effort="0.5"'))
    new(folder, None)
    assert load_task(folder / "task.yaml").cycle.period > 4
    assert solve(folder / "task.yaml", "rigid", workers=1).verified
