"""Costs: exact values, derivatives, and what a task that names one gets."""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np
import pytest
from conftest import ELASTIC, RIGID, task

from pkmsea.actuation.cost import COSTS, ENERGY, Cost, RmsTorque, positive
from pkmsea.errors import InputError
from pkmsea.problem import build_problem, task_of
from pkmsea.solution import solve
from pkmsea.solution.store import load
from pkmsea.task import Spline
from pkmsea.transcription import transcribe
from pkmsea.transcription.default import FlatTranscription
from pkmsea.verification import verify
from pkmsea.views import records

COARSE = {"starts": 2, "trajectory": {"kind": "spline", "knots": 24}, "meshes": 2}


def test_the_exact_positive_part_is_exact() -> None:
    x = np.concatenate(
        [[0.0, -0.0], np.random.default_rng(0).normal(size=1000) * 10.0 ** np.arange(-50, 50).repeat(10)]
    )
    np.testing.assert_array_equal(positive(x), np.maximum(x, 0.0))


@pytest.mark.parametrize("cost", COSTS.values(), ids=str)
def test_exact_derivatives(cost: Cost) -> None:
    problem = replace(build_problem(task("pkm_2rrr", [ELASTIC, RIGID])), cost=cost)
    flat = FlatTranscription(problem, Spline(kind="spline", knots=24), 96)
    x = flat.start(np.random.default_rng(3))
    nlp = flat.nlp(x)
    p = nlp.parameter(0, x)
    f, slope = (lambda at: float(nlp.oracle(at, p)[0])), nlp.derivatives["grad_f"]
    h = 1e-6
    direction = np.random.default_rng(4).normal(size=x.size) * 1e-2 * nlp.stacked("scale")
    change = (f(x + h * direction) - f(x - h * direction)) / (2 * h)
    assert float(ca.dot(slope(x, p)[1], direction)) == pytest.approx(change, rel=1e-4)


@pytest.mark.parametrize("name", ["rms_torque", "peak_power"])
def test_each_cost_is_least_where_it_is_minimised(name: str, tmp_path) -> None:
    """Stored, loaded, and told in its own words and unit."""
    cost, energies = COSTS[name], {}
    for minimised in ("energy", name):
        problem = build_problem(task("pkm_2rrr", RIGID, cost=minimised, options=COARSE))
        assert build_problem(task_of(problem)).cost == problem.cost
        solution = solve(problem, workers=1)
        s, numbers = solution.series, problem.actuation.each
        energies[minimised] = [each.value(each.exact(s.tau.T, s.v_M.T, numbers), s.t[1]) for each in (ENERGY, cost)]
    assert energies["energy"][0] < energies[name][0] and energies[name][1] < energies["energy"][1]
    assert solution.value == energies[name][1]
    assert solution.cost.show(solution.value) in repr(solution) and cost.unit in repr(solution.audit())
    assert load(solution.save(tmp_path / "result.nc")).value == solution.value
    (record,) = records.solutions([solution], solution, {})
    assert record[name] == solution.value and record["energy"] == solution.energy > 0
    assert verify(solution).gap < 1e-2


@dataclass(frozen=True)
class CopperLoss(Cost):
    """What heats the windings: the integral of kappa tau^2."""

    name, label, symbol, unit = "copper", "copper-loss", "E_Cu", "J"

    def rate(self, tau, v, numbers, eps):
        return sum(each["copper_loss"] * t**2 for t, each in zip(tau, numbers, strict=True))

    def value(self, rates, dt):
        return float((rates * dt).sum())


def test_a_cost_of_ones_own() -> None:
    """Proportional to the square of the RMS torque where all drives are alike: the same optimum."""
    problem = build_problem(task("pkm_2rrr", RIGID, options=COARSE))
    own, rms = (solve(replace(problem, cost=cost), workers=1).value for cost in (CopperLoss(), RmsTorque()))
    assert own == pytest.approx(problem.kappa[0] * rms**2 * problem.cycle.period, rel=1e-6)


def test_unknown_costs_are_refused() -> None:
    with pytest.raises(ValueError, match="there is no such cost"):
        task("pkm_2rrr", RIGID, cost="noise")
    paper = {"transcription": "paper", "samples": 40}
    with pytest.raises(InputError, match="no cost"):
        transcribe(build_problem(task("pkm_2rrr", RIGID, cost="rms_torque", options=paper)))
