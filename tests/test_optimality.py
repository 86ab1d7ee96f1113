"""Conditions of a local minimum: small problems with known multipliers, solved cycles, and motions moved off them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np
import pytest
from conftest import ELASTIC, task

from pkmsea.motion import Motion
from pkmsea.problem import build_problem
from pkmsea.solution import Solution, solve
from pkmsea.solver import Optimality, Outcome, Start, optima, optimality
from pkmsea.solver.nlp import scaled
from pkmsea.solver.optimality import _derivatives, _gradient, _sides, fit
from pkmsea.transcription.nlp import Nlp, Variable
from pkmsea.verification import verify

EXACT = 1e-9  # of multipliers and residuals where the point is known to rounding
HEAVY = {"inertia": 4.4e-4, "friction": 4.79e-3}
P = np.ones(1)


def nlp(f: Any, g: Any, x: ca.MX, bounds: list[tuple[float, float]], **changes: Any) -> Nlp:
    """min f(x) subject to lower <= g(x) <= upper; `box` bounds the variables, `scale` is that of the variables."""
    n = x.numel()
    low, high = changes.get("box", (np.full(n, -np.inf), np.full(n, np.inf)))
    scale = np.array(changes.get("scale", np.ones(n)))
    oracle = ca.Function("nlp", [x, ca.MX.sym("p")], [f, g], ["x", "p"], ["f", "g"])
    lower, upper = np.array(bounds, float).reshape(-1, 2).T
    return Nlp((Variable("x", low, high, scale, np.zeros(n)),), lower, upper, oracle, 1, lambda step, x: P)


def multipliers(problem: Nlp, x: np.ndarray) -> dict[tuple[int, float], float]:
    """By constraint (behind them the variables) and side."""
    solved = scaled(problem)
    functions, z = _derivatives(solved), x / solved.scale
    sides = _sides(problem, solved, z, P, functions)[1]
    found = fit(_gradient(functions, z, P), sides)[0]
    return {(int(i), float(s)): float(m) for i, s, m in zip(sides.constraint, sides.sign, found, strict=True)}


def check(found: Optimality, kind: str, negative: int = 0) -> None:
    assert (found.kind, found.negative) == (kind, negative)
    assert found.error < EXACT
    assert bool(found.faults) == (kind == "saddle")


def test_quadratic_program_with_known_multipliers() -> None:
    """x and lambda are chosen first, the linear cost follows: grad f = -A^T lambda. One row is active without force."""
    rng = np.random.default_rng(0)
    Q, A = rng.normal(size=(5, 5)), rng.normal(size=(4, 5))
    Q, at, force = Q @ Q.T, rng.normal(size=5), np.array([2.0, 0.5, 0.0, 0.0])
    slack = np.array([0.0, 0.0, 0.0, 3.0])
    x, cost = ca.MX.sym("x", 5), -(Q @ at + A.T @ force)
    bounds = [(-np.inf, high) for high in A @ at + slack]
    problem = nlp(ca.bilin(Q, x, x) / 2 + ca.dot(cost, x), ca.mtimes(A, x), x, bounds, scale=[1, 10, 0.1, 1, 3])
    check(optimality(problem, at, P), "minimum")
    found = multipliers(problem, at)
    np.testing.assert_allclose([found.get((i, 1.0), 0.0) for i in range(4)], force, atol=EXACT)
    moved = optimality(problem, at + 1e-3, P)
    assert not moved.stationary
    assert "not stationary" in moved.faults[0]


def test_hock_schittkowski_71() -> None:
    """Known optimum and multipliers, beside those that IPOPT ends with."""
    x = ca.MX.sym("x", 4)
    f = x[0] * x[3] * (x[0] + x[1] + x[2]) + x[2]
    g = ca.vertcat(x[0] * x[1] * x[2] * x[3], ca.sumsqr(x))
    box = np.ones(4), np.full(4, 5.0)
    options = {"print_time": False, "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-11, "bound_relax_factor": 0.0}}
    solver = ca.nlpsol("hs071", "ipopt", {"x": x, "f": f, "g": g}, options)
    solved = solver(x0=[1, 5, 5, 1], lbx=box[0], ubx=box[1], lbg=[25, 40], ubg=[np.inf, 40])
    at = np.array(solved["x"]).ravel()
    np.testing.assert_allclose(at, [1, 4.7429994, 3.8211503, 1.3794082], atol=1e-7)
    problem = nlp(f, g, x, [(25, np.inf), (40, 40)], box=box)
    found = optimality(problem, at, P)
    assert found.error < 1e-7 and found.kind == "minimum"
    forces, ipopt = multipliers(problem, at), np.array(solved["lam_g"]).ravel()
    assert forces[0, -1.0] == pytest.approx(-ipopt[0], rel=1e-5)
    assert forces[1, 1.0] - forces[1, -1.0] == pytest.approx(ipopt[1], rel=1e-5)
    assert forces[2, -1.0] == pytest.approx(1.0878712, rel=1e-5)


@pytest.mark.parametrize(
    ("cost", "bounds", "kind", "negative"),
    [
        (lambda x, y: x**2 - y**2, (-np.inf, np.inf), "saddle", 1),
        (lambda x, y: -(x**2) - y**2, (-np.inf, np.inf), "saddle", 2),
        (lambda x, y: x**2 - y**2, (0.0, 0.0), "minimum", 0),  # y is held by an equation
        (lambda x, y: x**2 - y**2 + y, (0.0, np.inf), "minimum", 0),  # y is pressed against its bound
        (lambda x, y: x**2 - y**2, (0.0, np.inf), "undecided", 0),  # nothing presses y against its bound
        (lambda x, y: x**2 + y**4, (-np.inf, np.inf), "undecided", 0),
    ],
)
def test_second_order(cost: Any, bounds: tuple[float, float], kind: str, negative: int) -> None:
    """All stationary at the origin; the constraint is on y."""
    x = ca.MX.sym("x", 2)
    check(optimality(nlp(cost(x[0], x[1]), x[1], x, [bounds]), np.zeros(2), P), kind, negative)


def test_a_force_of_the_wrong_sign_is_not_stationary() -> None:
    x = ca.MX.sym("x", 1)
    assert not optimality(nlp(x, x, x, [(-np.inf, 0.0)]), np.zeros(1), P).stationary
    assert optimality(nlp(-x, x, x, [(-np.inf, 0.0)]), np.zeros(1), P).curvature is None


def test_the_active_constraint_bears_the_force() -> None:
    """Not the one beside it that points the same way."""
    x = ca.MX.sym("x", 1)
    found = optimality(nlp(-x, ca.vertcat(x, x), x, [(-np.inf, 5e-4), (-np.inf, 0.0)]), np.zeros(1), P)
    assert found.error < EXACT


@pytest.fixture(scope="module")
def solved() -> Solution:
    return solve(task("pkm_2rrr", ELASTIC | HEAVY, options={"starts": 3}), workers=1)


def test_a_solved_cycle_is_a_minimum(solved: Solution) -> None:
    found = solved.optimality()
    assert found is not None
    assert found.kind == "minimum" and not found.faults
    assert found.error < 1e-5  # measured 2e-8; IPOPT's own tolerance is 1e-6
    assert found.unit == solved.value


@pytest.mark.parametrize("what", ["stiffness", "detour"])
def test_a_motion_off_the_optimum_is_not_stationary(solved: Solution, what: str) -> None:
    motion, t = solved.motion, np.linspace(0, 1, 400, endpoint=False)
    coefficients, stiffness = motion.coefficients.copy(), motion.stiffness.copy()
    if what == "stiffness":
        stiffness *= [1.01, 1.0]
    else:
        coefficients += motion.basis.fit(t, 1e-4 * np.sin(4 * np.pi * t)[:, None])
    found = replace(solved, motion=Motion(motion.basis, coefficients, stiffness)).optimality()
    assert found is not None and not found.stationary
    assert found.saving > 1e-6


def test_verify_rejects_a_motion_off_the_optimum(solved: Solution) -> None:
    """True in every other respect: its series, its energy and its claim are its own."""
    softer = Motion(solved.motion.basis, solved.motion.coefficients.copy(), solved.motion.stiffness * [0.99, 1.0])
    moved = replace(solved, motion=softer)
    (fault,) = verify(replace(moved, claimed=moved.energy)).faults
    assert "not stationary" in fault


def test_limits_that_press_are_among_the_constraints(solved: Solution) -> None:
    torque = 0.95 * float(np.abs(solved.series.tau).max())
    bound = solve(task("pkm_2rrr", ELASTIC | HEAVY | {"torque": torque}), workers=1)
    assert bound.verified and np.abs(bound.series.tau).max() > 0.99 * torque
    found = bound.optimality()
    assert found is not None and found.kind == "minimum" and not found.faults


def test_not_available(solved: Solution) -> None:
    """The paper's transcription has no mesh to ask on; a stiffness outside its bounds none that it fits."""
    options = {"transcription": "paper", "trajectory": {"kind": "chain"}}
    papers = replace(solved, problem=build_problem(task("pkm_2rrr", ELASTIC | HEAVY, options=options)))
    hard = Motion(solved.motion.basis, solved.motion.coefficients.copy(), solved.motion.stiffness * 100)
    assert papers.optimality() is None
    outside = replace(solved, motion=hard)
    assert outside.optimality() is None and "a spring is outside its bounds" in outside.status


def start(index: int, energy: float, stiffness: float, **changes: Any) -> Start:
    return Start(index, Outcome.OPTIMAL, None, energy, (stiffness,), 10, 0.1, **changes)


def test_optima_are_counted() -> None:
    """Two starts repeat the best as screened, one more comes to it when sharpened; one other was only screened."""
    starts = [
        start(0, 1.0, 0.1, finished=True),
        start(1, 1.03, 0.1, repeats=0),
        start(2, 1.0005, 0.102, finished=True),
        start(3, 1.03, 0.1, repeats=0),
        start(4, 1.2, 0.1, finished=True),
        start(5, 1.1, 0.3),
        start(6, 1.1, 0.3, repeats=5),
        start(7, np.inf, 0.1),
    ]
    found = [(optimum.claimed, optimum.count, optimum.finished) for optimum in optima(starts)]
    assert found == [(1.0, 4, True), (1.1, 2, False), (1.2, 1, True)]
    from_a_neighbour = start(0, 0.9, 0.1, finished=True)  # its index is one of the others'
    assert sum(optimum.count for optimum in optima([from_a_neighbour, *starts])) == len(starts)


def test_every_start_is_counted(solved: Solution) -> None:
    counted = sum(optimum.count for optimum in solved.optima)
    assert counted + sum(not s.usable for s in solved.starts) == len(solved.starts) == 3
    assert [o.claimed for o in solved.optima] == sorted(o.claimed for o in solved.optima)
