"""Drives, flat outputs and the flat map, against the forward dynamics and finite differences."""

import shutil
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from conftest import ELASTIC, FRICTION, PARALLEL, RIGID, SLIDER_ELASTIC, SLIDER_RIGID, task

from pkmsea.actuation import NUMBERS, Actuation, Drive, flat_map, laws
from pkmsea.actuation.equations import free_coordinates, stage
from pkmsea.actuation.flat_batch import FlatBatch
from pkmsea.errors import InputError, MechanismError
from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.motion import Motion
from pkmsea.motion.bases import SplineBasis
from pkmsea.motion.poses import Poses
from pkmsea.motion.series import series
from pkmsea.problem import build_problem
from pkmsea.task.payload import Payload
from pkmsea.transcription.guess import path
from pkmsea.transcription.instants import Instants

# every mixture that a robot of the paper allows
MIXTURES = [
    ("linear_axis_1", [SLIDER_RIGID]),
    ("linear_axis_1", [SLIDER_ELASTIC]),
    ("linear_axis_2", [SLIDER_RIGID] * 2),
    ("linear_axis_2", [SLIDER_ELASTIC] * 2),
    ("linear_axis_2", [SLIDER_RIGID, SLIDER_ELASTIC]),
    ("pkm_2rrr", [ELASTIC | FRICTION | PARALLEL | {"cubic": 0.5}, RIGID | FRICTION | PARALLEL]),
    ("pkm_3rrr", [ELASTIC | FRICTION | {"cubic": 0.5}, RIGID | FRICTION, ELASTIC | PARALLEL]),
    ("pkm_2rrr", [RIGID] * 2),
    ("pkm_2rrr", [ELASTIC] * 2),
    ("pkm_2rrr", [RIGID, ELASTIC]),
    ("pkm_3rrr", [RIGID] * 3),
    ("pkm_3rrr", [ELASTIC] * 3),
    ("pkm_3rrr", [RIGID, ELASTIC, ELASTIC]),
]
VISCOUS = 4.8e-3
RESIDUAL = 1e-8  # of equations of motion, relative to their largest term; rounding of second derivatives


def actuation(mechanism: Mechanism, drives: list[dict]) -> Actuation:
    return Actuation(mechanism, tuple(Drive.model_validate(drive) for drive in drives))


@pytest.mark.parametrize(
    ("name", "drives", "degree"),
    [
        ("linear_axis_1", [SLIDER_RIGID], (2,)),
        ("linear_axis_1", [SLIDER_ELASTIC], (4,)),
        ("linear_axis_2", [SLIDER_ELASTIC] * 2, (4, 2)),
        ("linear_axis_2", [SLIDER_RIGID] * 2, (2, 0)),
        ("pkm_2rrr", [RIGID] * 2, (2, 2)),
        ("pkm_2rrr", [ELASTIC] * 2, (4, 4)),
        ("pkm_3rrr", [ELASTIC] * 3, (4, 4, 2)),
        ("pkm_3rrr", [RIGID] * 3, (2, 2, 0)),
        ("linear_axis_1", [SLIDER_ELASTIC | {"damping": 1.0}], (3,)),  # the spring passes the motor's speed on
        ("linear_axis_2", [SLIDER_ELASTIC | {"damping": 1.0}] * 2, (3, 1)),
        ("pkm_3rrr", [ELASTIC | {"damping": 1e-3}] * 3, (3, 3, 1)),
    ],
)
def test_relative_degree(mechanisms: dict[str, Mechanism], name: str, drives: list, degree: tuple) -> None:
    assert actuation(mechanisms[name], drives).relative_degree() == degree


def test_mixed_drives_have_no_relative_degree(mechanisms: dict[str, Mechanism]) -> None:
    with pytest.raises(MechanismError, match="decoupling matrix is singular"):
        actuation(mechanisms["pkm_2rrr"], [RIGID, ELASTIC]).relative_degree()


@pytest.mark.parametrize(("name", "drives"), MIXTURES)
def test_flat_map_satisfies_the_equations_of_motion(mechanisms: dict[str, Mechanism], name: str, drives: list) -> None:
    """Paper, eq. (EOMAll) and (EOMRD), with M, g, H_A from the mechanism and the derivatives of a known motion."""
    drives = [drive | {"friction": drive.get("friction", VISCOUS)} for drive in drives]
    problem = build_problem(task(name, drives))
    robot = problem.actuation
    basis = SplineBasis(problem.cycle.period, 24, 7)
    free = 0.1 * np.random.default_rng(0).normal(size=(basis.size, len(robot.free)))
    coefficients = np.hstack([path(problem, basis, None), free])
    middle = np.array([np.mean(parameter.bounds) for parameter in robot.parameters])
    motion = Motion.of(robot, basis, coefficients, middle)
    s = series(problem, motion, points=1200)
    h = s.t[1]
    a_M = (
        (-np.roll(s.v_M, -2, 0) + 8 * np.roll(s.v_M, -1, 0) - 8 * np.roll(s.v_M, 1, 0) + np.roll(s.v_M, 2, 0)) / 12 / h
    )
    inertia, mechanism = robot.numbers("inertia"), robot.mechanism
    at, ind = mechanism.actuated, mechanism.independent
    worst_load = worst_motor = 0.0
    for k in range(0, s.t.size, 50):
        H_A = mechanism.actuation_jacobian(s.q[k])
        load = mechanism.mass_matrix(s.q[k]) @ s.a[k, ind] + mechanism.bias(s.q[k], s.v[k, ind])
        parallel = motion.parallel[:, 0] * (motion.parallel[:, 1] - s.q[k, at])
        forces = H_A.T @ (s.u[k] + np.nan_to_num(parallel))
        worst_load = max(worst_load, np.abs(load - forces).max() / max(np.abs(forces).max(), 1e-3))
        for i, drive in enumerate(robot.drives):
            if drive.elastic:
                deflection = s.q_M[k, i] - s.q[k, at[i]]
                spring = motion.stiffness[i] * deflection + drive.cubic * deflection**3
                assert spring == pytest.approx(s.u[k, i], rel=1e-9, abs=1e-9)
                motor = inertia[i] * a_M[k, i] + spring
            else:
                motor = inertia[i] * s.a[k, at[i]] + s.u[k, i]
            motor += drive.friction * s.v_M[k, i] + drive.coulomb * np.tanh(s.v_M[k, i] / drive.coulomb_width)
            worst_motor = max(worst_motor, abs(motor - s.tau[k, i]) / max(np.abs(s.tau[:, i]).max(), 1e-9))
    assert worst_load < RESIDUAL
    assert worst_motor < 2e-3  # a_M by differences of order 4 over a step of 1/1200 period


@pytest.mark.parametrize(("name", "drives"), MIXTURES)
def test_stage_equations_agree_with_the_flat_map(mechanisms: dict[str, Mechanism], name: str, drives: list) -> None:
    robot = actuation(mechanisms[name], drives)
    delta, m = robot.mechanism.mobility, robot.m
    rng = np.random.default_rng(1)
    q = robot.mechanism.seed
    Y, Z = rng.normal(size=(delta, 5)), rng.normal(size=(m - delta, 3))
    Y[:, 0] = robot.mechanism.end_effector(q)
    c = np.where([d.elastic for d in robot.drives], 0.3, 1.0)
    p = np.array([np.mean(parameter.bounds) for parameter in robot.parameters])
    p[: len(robot.elastic)] = np.log(c[robot.elastic])
    k, rest = np.nan_to_num(Motion.of(robot, SplineBasis(1.0, 24, 7), np.zeros((24, m)), p).parallel).T
    instants = Instants(robot.structure, tuple(range(2 * m, 2 * m + 3 * q.size)), robot.r, np.zeros(1))
    instants.xi[: q.size, 0], instants.w[:, 0], instants.p[:] = q, np.concatenate([Y[:, :3].T.ravel(), Z[:, 0]]), p
    instants.solve()
    s = instants.s[:, 0]
    exact = flat_map(robot.structure)(q, Y, Z, c, k, rest, np.zeros((1, 3)), robot.r)
    columns = [x[None] for x in (q, Y.T.ravel(), Z.T.ravel(), c, k, rest, np.zeros(3), robot.r)]
    for found, expected in zip(FlatBatch(robot.structure, 1)(*columns), exact, strict=True):
        np.testing.assert_allclose(found.ravel(), np.array(expected).ravel(), rtol=1e-9, atol=1e-11)
    q_M, _, tau, u, v, a = (np.array(x).ravel() for x in exact)
    for i, drive in enumerate(robot.drives):
        expected = (q_M[i], u[i]) if drive.elastic else (tau[i], v[robot.mechanism.actuated[i]])
        np.testing.assert_allclose(s[[i, m + i]], expected, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(s[2 * m :], np.concatenate([q, v, a]), rtol=1e-10, atol=1e-10)


def test_the_equations_hold_and_their_derivatives_are_exact(mechanisms: dict[str, Mechanism]) -> None:
    """The residual at the solved unknowns, and total derivatives against central differences along the equations."""
    robot = actuation(mechanisms["pkm_3rrr"], [ELASTIC] * 3)
    n, m, delta = robot.mechanism.model.nq, robot.m, robot.mechanism.mobility
    equations = stage(robot.structure)
    residual = ca.Function("R", [equations.xi, *equations.given], [equations.R])
    rng = np.random.default_rng(2)
    w = rng.normal(size=equations.w.numel())
    w[:2], w[-3:] = robot.mechanism.end_effector(robot.mechanism.seed), np.log(0.2)
    r, load, mu = rng.uniform(0.1, 1.0, len(NUMBERS) * m), rng.uniform(size=1), rng.normal(size=2 * m + 1)
    poses = Poses(robot.mechanism, 1)

    def solved(at: np.ndarray) -> Instants:
        instants = Instants(robot.structure, (2 * m + n,), r, load)
        q = poses.close(robot.mechanism.seed[:, None], at[:delta, None])
        assert q is not None
        instants.xi[:n], instants.w[:, 0], instants.p[:], instants.mu[:, 0] = q, at[:-3], at[-3:], mu
        instants.solve()
        instants.differentiate()
        instants.bend()
        return instants

    def slope(at: np.ndarray) -> np.ndarray:
        return solved(at).S.reshape(w.size, 2 * m + 1).T

    assert np.abs(np.array(residual(solved(w).xi, w[:-3], w[-3:], r, load))).max() < 1e-9
    direction, h = rng.normal(size=w.size), 1e-5

    def central(function) -> np.ndarray:
        return (function(w + h * direction) - function(w - h * direction)) / (2 * h)

    change = central(lambda at: solved(at).s[:, 0])
    np.testing.assert_allclose(slope(w) @ direction, change, rtol=0, atol=1e-6 * np.abs(change).max())
    change = central(lambda at: mu @ slope(at))
    W = solved(w).C.reshape(w.size, w.size)
    np.testing.assert_allclose(W @ direction, change, rtol=0, atol=1e-6 * np.abs(change).max())


@pytest.mark.parametrize("spring", [laws.Linear(), laws.Cubic()])
def test_deflection_is_the_inverse_of_the_force(spring: laws.Spring) -> None:
    u, numbers = np.linspace(-3.0, 3.0, 13), {"cubic": ca.DM(0.7)}
    again = spring.force(ca.DM(0.4), numbers, spring.deflection(ca.DM(0.4), numbers, ca.DM(u)))
    np.testing.assert_allclose(np.array(again).ravel(), u, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("name", "drives"), [m for m in MIXTURES if m[0] == "pkm_3rrr"])
def test_free_coordinates_give_the_forces_back(mechanisms: dict[str, Mechanism], name: str, drives: list) -> None:
    """Forces of a motion -> the free drives' coordinates -> the same forces by the stage equations."""
    robot = actuation(mechanisms[name], drives)
    q, n, m, delta = robot.mechanism.seed, robot.mechanism.model.nq, robot.m, robot.mechanism.mobility
    rng = np.random.default_rng(4)
    w = np.concatenate([robot.mechanism.end_effector(q), rng.normal(size=2 * delta + m - delta)])
    p = np.array([np.mean(parameter.bounds) for parameter in robot.parameters])
    instants = Instants(robot.structure, (), robot.r, np.zeros(1))
    instants.xi[:n, 0], instants.w[:, 0], instants.p[:] = q, w, p
    instants.solve()
    v, a, forces = np.split(instants.xi[n:, 0], [n, 2 * n])
    u = np.empty(m)
    u[[*robot.free, *robot.structure.dependent]] = forces[:m]
    z = free_coordinates(robot.structure)(q, v, a, u, p, robot.r)
    np.testing.assert_allclose(np.array(z).ravel(), w[3 * delta :], rtol=1e-10, atol=1e-12)


def test_flat_map_with_the_numbers_in_place(mechanisms: dict[str, Mechanism]) -> None:
    """Keywords may be left out; the pose equation vanishes at a pose of the end effector."""
    robot = actuation(mechanisms["pkm_2rrr"], [ELASTIC | FRICTION] * 2)
    y = robot.mechanism.end_effector(robot.mechanism.seed) + 0.01
    q = robot.mechanism.configuration(y)
    assert np.abs(np.array(robot.pose_equation()(q, y))).max() < 1e-9
    Y = np.column_stack([y, np.random.default_rng(5).normal(size=(2, 4))])
    bound = robot.flat_map()(q=q, Y=Y, c=[0.2, 0.3])
    exact = flat_map(robot.structure)(q=q, Y=Y, c=[0.2, 0.3], r=robot.r)
    np.testing.assert_allclose(np.array(bound["tau"]), np.array(exact["tau"]), rtol=1e-12)


def test_free_drive_leaves_a_well_conditioned_rest(mechanisms: dict[str, Mechanism]) -> None:
    """B and C alone are singular at the second operating point, so A, the paper's choice, is not the free drive."""
    problem = build_problem(task("pkm_3rrr", ELASTIC))
    assert problem.actuation.free != [0]
    assert actuation(mechanisms["linear_axis_2"], [SLIDER_ELASTIC] * 2).free == [0]


def test_wrong_number_of_drives(mechanisms: dict[str, Mechanism]) -> None:
    with pytest.raises(InputError, match=r"2 drives are given.*3 actuated joints"):
        actuation(mechanisms["pkm_3rrr"], [RIGID] * 2)


def test_values_at_the_motor_are_seen_through_the_gear() -> None:
    """A gear keeps power and losses: P = tau v + kappa tau^2 is the same on both sides."""
    motor = Drive.model_validate(ELASTIC | FRICTION | {"gear_ratio": 50.0, "torque": 0.1, "speed": 300.0})
    seen = motor.at_output()
    assert seen.gear_ratio is None and seen.at_output() == seen
    torque, speed, acceleration = 0.03, 20.0, 7.0
    assert seen.copper_loss * (50 * torque) ** 2 == pytest.approx(motor.copper_loss * torque**2)
    assert (seen.torque, seen.speed) == pytest.approx((5.0, 6.0))
    assert seen.inertia * acceleration / 50 == pytest.approx(50 * motor.inertia * acceleration)
    own = motor.coulomb * np.tanh(speed / motor.coulomb_width)
    assert seen.coulomb * np.tanh(speed / 50 / seen.coulomb_width) == pytest.approx(50 * own)


def test_payload_is_handed_over_during_the_rests() -> None:
    cycle = task("pkm_2rrr", ELASTIC).cycle
    mass = Payload(mass=0.4, pick=1, place=2).mass_over(cycle)
    t = np.linspace(-1.0, 2.0, 3001)
    np.testing.assert_allclose(mass(t + cycle.period, 0), mass(t, 0), atol=1e-12)
    np.testing.assert_allclose(mass(np.array([0.06, 0.25, 0.44]), 0), 0.4)
    np.testing.assert_allclose(mass(np.array([0.56, 0.75, 0.94]), 0), 0.0, atol=1e-12)
    for order in (1, 2):
        slope = np.gradient(mass(t, order - 1), t)
        assert np.abs(slope - mass(t, order))[2:-2].max() < 1e-2 * np.abs(mass(t, order)).max()


def test_payload_all_the_time_is_a_heavier_slider(tmp_path: Path) -> None:
    """The same torques whether the mass is the task's payload or the URDF's."""
    folder = tmp_path / "heavier"
    shutil.copytree(load_mechanism("linear_axis_1").folder, folder)
    (tree,) = folder.glob("*.urdf")
    tree.write_text(tree.read_text().replace('mass value="2"', 'mass value="3.5"'))
    loaded = build_problem(task("linear_axis_1", SLIDER_ELASTIC, payload={"mass": 1.5}))
    setup = {"name": "setup", "mechanism": str(folder), "drives": SLIDER_ELASTIC}
    heavier = build_problem(task("linear_axis_1", SLIDER_ELASTIC, setups=[setup]))
    basis = SplineBasis(loaded.cycle.period, 24, 7)
    motion = Motion(basis, path(loaded, basis, None), np.array([80.0]))
    np.testing.assert_allclose(series(loaded, motion).tau, series(heavier, motion).tau, rtol=1e-9, atol=1e-9)
