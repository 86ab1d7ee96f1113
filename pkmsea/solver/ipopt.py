"""IPOPT: the one place that knows the solver. An NLP in, a typed outcome with the best point out."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import casadi as ca
import numpy as np

from pkmsea.bridge import _bridge
from pkmsea.solver.nlp import ScaledNlp, scaled
from pkmsea.task import Options
from pkmsea.transcription.nlp import Callback, Nlp

PUSH = 1e-6  # of a warm start away from its bounds; IPOPT's 1e-2 would throw the start away
WARM = {"warm_start_init_point": "yes"} | {
    f"warm_start_{what}": PUSH
    for what in ("bound_push", "bound_frac", "slack_bound_push", "slack_bound_frac", "mult_bound_push")
}
# for NLPs that are small, dense and scaled: a quarter of IPOPT's own time goes into scaling and refining for nothing
PLAIN = {"mumps_permuting_scaling": 0, "mumps_scaling": 0, "min_refinement_steps": 0}
STAGNANT = 5  # iterations in a row that change the cost by less than options.stagnation end a solve
ANY_ERROR = 1e20  # of optimality: only the cost decides
KEPT = 0.99  # share of a solver's time limit that must be left for it to serve again
FEASIBLE = 1e-6  # largest constraint violation of a usable point, in the constraints' units


class Outcome(StrEnum):
    """How a solve ended."""

    OPTIMAL = "optimal"
    ITERATIONS = "iteration limit"
    TIME = "time limit"
    INFEASIBLE = "infeasible"
    UNREACHABLE = "start unreachable"
    STALLED = "stalled"
    FAILED = "failed"


_OUTCOMES = {
    "Solve_Succeeded": Outcome.OPTIMAL,
    "Solved_To_Acceptable_Level": Outcome.OPTIMAL,
    "Feasible_Point_Found": Outcome.OPTIMAL,
    "Maximum_Iterations_Exceeded": Outcome.ITERATIONS,
    "Maximum_CpuTime_Exceeded": Outcome.TIME,
    "Maximum_WallTime_Exceeded": Outcome.TIME,
    "Infeasible_Problem_Detected": Outcome.INFEASIBLE,
    "Search_Direction_Becomes_Too_Small": Outcome.STALLED,
    "Restoration_Failed": Outcome.STALLED,
}


@dataclass(frozen=True)
class Point:
    """Where a solve ended.

    Attributes
    ----------
    x : variables in physical units.
    outcome : of the last step.
    violation : largest violation of bounds and constraints.
    iterations : per step.
    seconds, evaluation : wall time in IPOPT over all steps, and the part of it spent in the NLP's functions.
    """

    x: np.ndarray
    outcome: Outcome
    violation: float
    iterations: tuple[int, ...]
    seconds: float = 0.0
    evaluation: float = 0.0

    @property
    def usable(self) -> bool:
        """Whether the point satisfies all constraints, optimal or not."""
        return self.violation <= FEASIBLE and bool(np.all(np.isfinite(self.x)))


def solve_nlp(nlp: Nlp, options: Options, steps: range | None = None, warm: bool = False) -> Point:
    """Solve an NLP, step by step of its parameter; each step starts from the last point and its multipliers.

    `warm` says that the guess is nearly optimal and must not be pushed away from its bounds.
    """
    begin = time.perf_counter()
    x, lower, upper = (nlp.stacked(key) for key in ("guess", "lower", "upper"))
    problem = scaled(nlp)
    multipliers: dict[str, ca.DM] = {}
    solvers = _Solvers(problem, options)
    iterations: list[int] = []
    outcome, violation, seconds, evaluation = Outcome.FAILED, np.inf, 0.0, 0.0
    for step in range(nlp.steps) if steps is None else steps:
        left = (options.time_limit or np.inf) - (time.perf_counter() - begin)
        if left <= 0:
            outcome = Outcome.TIME
            break
        p = nlp.parameter(step, x)
        change = options.stagnation * min(abs(float(nlp.oracle(x, p)[0])), 1.0) if options.stagnation else 0.0
        solver = solvers.get(left, warm=warm or bool(multipliers), change=change)
        bounds = {"lbx": problem.lower, "ubx": problem.upper, "lbg": nlp.g_lower, "ubg": nlp.g_upper}
        with _muted():
            found = solver(x0=x / problem.scale, p=p, **bounds, **multipliers)
        Callback.stop_if()
        stats = solver.stats()
        outcome = _OUTCOMES.get(stats["return_status"], Outcome.FAILED)
        iterations.append(int(stats.get("iter_count", 0)))
        seconds += stats["t_wall_total"]
        evaluation += sum(part for key, part in stats.items() if key.startswith("t_wall_nlp_"))
        candidate = np.array(found["x"]).ravel() * problem.scale
        if not np.all(np.isfinite(candidate)):
            break
        x = candidate
        g = np.array(found["g"]).ravel()
        violation = float(max(excess(g, nlp.g_lower, nlp.g_upper), excess(x, lower, upper)))
        if outcome is Outcome.INFEASIBLE:
            break
        multipliers = {"lam_g0": found["lam_g"], "lam_x0": found["lam_x"]}
    return Point(x, outcome, violation, tuple(iterations), seconds, evaluation)


class _Solvers:
    """IPOPT on one NLP; a solver serves again as long as the time that is left has hardly changed."""

    def __init__(self, nlp: ScaledNlp, options: Options) -> None:
        self._nlp, self._options = nlp, options
        self._made: dict[tuple[bool, float], tuple[float, ca.Function]] = {}

    def get(self, seconds: float, *, warm: bool, change: float) -> ca.Function:
        """One that ends after so many seconds; see `solve_nlp` for `warm`, `STAGNANT` for `change`."""
        limit, solver = self._made.get((warm, change), (np.inf, None))
        if solver is None or seconds < KEPT * limit:
            solver = _solver(self._nlp, self._options, seconds, warm, change)
            self._made[warm, change] = seconds, solver
        return solver


def _solver(nlp: ScaledNlp, options: Options, seconds: float, warm: bool, change: float) -> ca.Function:
    ipopt = {
        "max_iter": options.iterations,
        "tol": options.tolerance,
        "acceptable_tol": options.tolerance * 10,
        "acceptable_iter": 10,
        "mu_strategy": "adaptive",
        "print_level": 0,
        "sb": "yes",
        "bound_relax_factor": 0.0,
        "honor_original_bounds": "yes",
    }
    if np.isfinite(seconds):
        ipopt["max_wall_time"] = seconds
    if warm:
        ipopt |= WARM
    if change:  # IPOPT divides changes by max(1, |f|)
        ipopt |= {
            "acceptable_tol": ANY_ERROR,
            "acceptable_iter": STAGNANT,
            "acceptable_obj_change_tol": change,
            "acceptable_constr_viol_tol": FEASIBLE,
            "acceptable_compl_inf_tol": ANY_ERROR,
        }
    settings = {
        "ipopt": ipopt,
        "print_time": False,
        "record_time": True,
        "error_on_fail": False,
        "calc_lam_p": False,
        "calc_lam_x": False,
    }
    if nlp.derivatives:
        ipopt |= PLAIN
        settings |= nlp.derivatives | {"no_nlp_grad": True}
    return ca.nlpsol("solver", "ipopt", nlp.oracle, settings)


def excess(values: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    return float(np.max(np.concatenate([lower - values, values - upper, [0.0]])))


@contextlib.contextmanager
def _muted() -> Iterator[None]:
    """CasADi warns of every step that IPOPT has to shorten, and of Ctrl-C; not in this thread."""
    _bridge.mute(True)
    try:
        yield
    finally:
        _bridge.mute(False)
