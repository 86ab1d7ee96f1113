"""The transcription's derivatives, its order, and the truth of what it claims."""

import casadi as ca
import numpy as np
import pytest
from conftest import ELASTIC, FRICTION, PARALLEL, RIGID, SLIDER_ELASTIC, task

from pkmsea.motion import Basis
from pkmsea.motion.bases import FourierBasis, SplineBasis
from pkmsea.motion.periodic import derivative_weights
from pkmsea.paper import paper_task
from pkmsea.problem import Problem, build_problem
from pkmsea.solution import solve
from pkmsea.solver.ipopt import solve_nlp
from pkmsea.task import Spline
from pkmsea.transcription import TRANSCRIPTIONS, transcribe
from pkmsea.transcription.default import FlatTranscription
from pkmsea.transcription.flat import FlatNlp
from pkmsea.transcription.guess import start

SLOPE = 1e-6  # relative error of central differences of first derivatives
LIMITED = {"torque": 0.3, "speed": 60.0}
BASES = [FourierBasis(1.0, 6), SplineBasis(1.0, 24, 7)]


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize("derivative", [1, 2, 3, 4])
def test_basis_derivatives(basis: Basis, derivative: int) -> None:
    t, h = np.linspace(0.013, 0.93, 40), 1e-5
    slope = (basis.matrix(t + h, derivative - 1) - basis.matrix(t - h, derivative - 1)) / (2 * h)
    exact = basis.matrix(t, derivative)
    assert np.abs(slope - exact).max() < 1e-4 * np.abs(exact).max()
    np.testing.assert_allclose(basis.matrix(t + 1.0, derivative), exact, atol=1e-6 * np.abs(exact).max())


def test_splines_sum_to_one_and_reproduce_constants() -> None:
    basis = SplineBasis(2.0, 20, 7)
    np.testing.assert_allclose(basis.matrix(np.linspace(0, 2, 77)).sum(axis=1), 1.0, atol=1e-13)


@pytest.mark.parametrize("order", [1, 2])
def test_difference_weights_are_exact_for_polynomials(order: int) -> None:
    weights, offsets = derivative_weights(order, 4), np.arange(-4, 5)
    for power in range(9):
        expected = float(np.polyder(np.poly1d([1] + [0] * power), order)(0.0))
        assert weights @ offsets.astype(float) ** power == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("basis", BASES)
@pytest.mark.parametrize(
    ("mechanism", "drives"),
    [
        ("pkm_2rrr", ELASTIC | LIMITED),
        ("pkm_2rrr", RIGID | LIMITED),
        ("pkm_3rrr", ELASTIC | LIMITED),
        ("pkm_3rrr", [RIGID, ELASTIC, ELASTIC]),
        ("pkm_2rrr", [ELASTIC | FRICTION | PARALLEL | {"cubic": 0.5} | LIMITED, RIGID | FRICTION | PARALLEL]),
        ("pkm_3rrr", [ELASTIC | FRICTION | {"cubic": 0.5}, RIGID | FRICTION, ELASTIC | PARALLEL]),
        ("pkm_3rrr", [ELASTIC | FRICTION | {"damping": 5e-3}, ELASTIC | {"damping": 2e-3}, ELASTIC | {"damping": 0.1}]),
    ],
)
def test_exact_derivatives(basis: Basis, mechanism: str, drives: object) -> None:
    """Gradient, Jacobian and Hessian of the Lagrangian along a random direction, against central differences."""
    limits = {"joints": {"velocity": {"elbow_A": 40.0}, "acceleration": 900.0, "position": {"A": [-3, 3]}}}
    payload = {"mass": 0.2, "pick": 1, "place": 2}
    problem = build_problem(task(mechanism, drives, limits=limits, payload=payload))
    nlp = FlatNlp(problem, basis, 96, problem.bounds)
    rng = np.random.default_rng(3)
    x = start(problem, nlp.robot, rng)
    built = nlp.nlp(x)
    # short, so that the light rotors' large curvature does not spoil the differences
    direction, h, eps, factor = rng.normal(size=x.size) * 1e-2 * built.stacked("scale"), 5e-5, 0.3, 1.3
    multipliers = rng.normal(size=built.g_lower.size)
    pattern = nlp._pattern

    def jacobian(at: np.ndarray) -> np.ndarray:
        return np.array(ca.DM(pattern.jacobian, nlp.jacobian(at)))

    def lagrangian_slope(at: np.ndarray) -> np.ndarray:
        return factor * nlp.gradient(at, eps) + jacobian(at).T @ multipliers

    def central(function) -> np.ndarray:
        return (function(x + h * direction) - function(x - h * direction)) / (2 * h)

    assert central(lambda at: nlp.objective(at, eps)) == pytest.approx(nlp.gradient(x, eps) @ direction, rel=1e-4)
    change = central(nlp.constraints)
    np.testing.assert_allclose(jacobian(x) @ direction, change, rtol=0, atol=10 * SLOPE * np.abs(change).max())
    hessian = np.array(ca.triu2symm(ca.DM(pattern.hessian, nlp.hessian(x, eps, factor, multipliers))))
    change = central(lagrangian_slope)
    np.testing.assert_allclose(hessian @ direction, change, rtol=0, atol=100 * SLOPE * np.abs(change).max())


def test_cells_and_the_dense_way_agree() -> None:
    """A spline cut into cells gives the same gradient as the same spline as one cell."""
    problem = build_problem(task("pkm_2rrr", ELASTIC))
    cut = FlatNlp(problem, SplineBasis(1.0, 24, 7), 96, ())
    x = start(problem, cut.robot, np.random.default_rng(0))
    cut.robot.start(x)
    assert cut.robot.cells.samples.shape[0] == 24
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(SplineBasis, "cells", lambda *_: 1)
        whole = FlatNlp(problem, SplineBasis(1.0, 24, 7), 96, ())
    whole.robot.start(x)
    assert whole.robot.cells.samples.shape[0] == 1
    np.testing.assert_allclose(cut.gradient(x, 0.3), whole.gradient(x, 0.3), rtol=1e-9, atol=1e-12)


def test_observed_order_of_the_motor_coordinates() -> None:
    """Torques of a smooth motion converge with order 8 in the grid; order 7 or more must be seen."""
    problem = build_problem(task("pkm_2rrr", ELASTIC | {"inertia": 4.6e-4}))
    basis = FourierBasis(1.0, 3)
    errors = []
    finest = None
    for samples in (768, 48, 96):
        nlp = FlatNlp(problem, basis, samples, ())
        x = start(problem, nlp.robot, None)
        nlp.robot.start(x)
        nlp.robot.at(x)
        nlp._signals.evaluate()
        tau = nlp._signals.tau[:, :: samples // 48].copy()
        finest = tau if finest is None else finest
        errors.append(np.abs(tau - finest).max())
    assert np.log2(errors[1] / errors[2]) > 7.0


def test_observed_order_of_the_optimal_energy() -> None:
    """The least energy converges with order 2, that of the windows' margin; more than 1.7 must be seen."""
    problem = build_problem(paper_task(3, {"copper_loss": 63.2, "friction": 4.8e-3}), "PKM SEA")
    energies = []
    for knots in (25, 50, 100, 200):
        transcription = FlatTranscription(problem, Spline(kind="spline", knots=knots), 4 * knots)
        point = solve_nlp(transcription.nlp(transcription.start(None)), problem.options)
        energies.append(transcription.claimed(point.x))
    errors = np.array(energies[:-1]) - energies[-1]
    assert np.all(np.log2(errors[:-1] / errors[1:]) > 1.7)
    assert errors[1] < 3e-3 * energies[-1]  # the default size


def test_random_starts_are_reproducible_and_differ() -> None:
    transcription = transcribe(build_problem(task("pkm_3rrr", ELASTIC)))
    first, again, other = (transcription.start(np.random.default_rng([0, k])) for k in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-3


def test_paper_transcription_by_integrator_chains() -> None:
    """Its own NLP at a flat-consistent point: all equations hold but RK4's truncation of the chain."""
    options = {"transcription": "paper", "trajectory": {"kind": "chain"}, "samples": 40, "starts": 1}
    transcription = transcribe(build_problem(task("linear_axis_2", SLIDER_ELASTIC, options=options)))
    x = transcription.start(None)
    nlp = transcription.nlp(x)
    g = np.array(nlp.oracle(x, 0.0)[1]).ravel()
    equations = nlp.g_lower == nlp.g_upper
    assert np.abs(g[equations]).max() < 0.05
    np.testing.assert_allclose(transcription.motion(x).stiffness, np.sqrt(5 * 1000), rtol=1e-12)


class Halved(FlatTranscription):
    """One of a user's own: the flat one with a single start, half as many knots and no finer mesh."""

    @classmethod
    def of(cls, problem: Problem) -> "Halved":
        return cls(problem, Spline(kind="spline", knots=25), None)

    def refined(self) -> None:
        return None


def test_a_transcription_of_ones_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Solved as it is, or found by name."""
    problem = build_problem(task("pkm_2rrr", ELASTIC, options={"starts": 2}))
    solution = solve(Halved.of(problem), workers=2)
    assert [mesh.size for mesh in solution.meshes] == [25] and solution.audit().gap < 5e-3
    monkeypatch.setitem(TRANSCRIPTIONS, "flat", Halved)
    assert isinstance(transcribe(problem), Halved)
