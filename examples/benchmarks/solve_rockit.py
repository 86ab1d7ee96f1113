"""Solving the rockit baseline, and checking that its model is pkmsea's."""

from __future__ import annotations

import time
from typing import Any

import casadi as ca
import numpy as np
import ours
from baseline_rockit import DEPTH, Baseline, stage_functions

AGREEMENT = (
    1e-9  # both maps are exact; the audit's poses are closed to about 1e-12 rad, which springs and rotors magnify
)
OUTCOMES = {
    "Solve_Succeeded": "optimal",
    "Solved_To_Acceptable_Level": "optimal",
    "Maximum_Iterations_Exceeded": "iteration limit",
    "Maximum_WallTime_Exceeded": "time limit",
}


def solve(baseline: Baseline, expand: bool, ipopt: dict[str, Any]) -> tuple[dict[str, Any], ours.Motion]:
    """Solve; a record, and the motion through the samples.

    `build_seconds` is what the call takes beside IPOPT: rockit's transcription and CasADi's derivatives.
    """
    ocp, begin = baseline.ocp, time.perf_counter()
    ocp.solver("ipopt", {"expand": expand, "print_time": False, "record_time": True, "ipopt": ipopt})
    try:
        found = ocp.solve()
    except RuntimeError:  # rockit's word for 'not converged'
        found = ocp.non_converged_solution
    stats, seconds = found.stats, time.perf_counter() - begin
    spent = stats["t_wall_total"]
    power = found.sample(baseline.P, grid="control")[1][:-1]
    r_E = found.sample(baseline.y[0], grid="control")[1][:-1]
    record = {
        "outcome": OUTCOMES.get(stats["return_status"], stats["return_status"]),
        "iterations": stats["iter_count"],
        "seconds": spent,
        "solver_seconds": spent,
        "evaluation_seconds": sum(t for key, t in stats.items() if key.startswith("t_wall_nlp_")),
        "build_seconds": seconds - spent,
        "claimed": float(np.maximum(power, 0).mean() * baseline.T),
    }
    return record, ours.through(baseline.posed, r_E, np.array(found.value(baseline.c)).ravel())


def disagreement(posed: ours.Problem, motion: ours.Motion) -> float:
    """Largest difference of both formulations to the audit along a motion, relative to the largest torque or power.

    The lifted one is given the audit's motor motion: what remains to be checked is its load equation.

    Raises
    ------
    RuntimeError : the model is not the audit's (AGREEMENT).
    """
    torque, load = stage_functions(posed)
    s = ours.series(posed, motion)
    jets = np.hstack([motion.flat_output(s.t, d) for d in range(DEPTH)]).T
    tau, power = torque(jets, ca.repmat(ca.DM(motion.stiffness), 1, s.t.size))
    q_A, u = load(jets[:6])
    spring = motion.stiffness[:, None] * (s.q_M.T - np.array(q_A))
    worst = max(
        float(np.abs(np.array(tau) - s.tau.T).max() / np.abs(s.tau).max()),
        float(np.abs(np.array(power).ravel() - s.power).max() / np.abs(s.power).max()),
        float(np.abs(np.array(u) - spring).max() / np.abs(s.u).max()),
    )
    if not worst <= AGREEMENT:
        raise RuntimeError(f"the rockit model is {worst:.1e} off the audit")
    return worst
