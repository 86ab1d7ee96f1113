"""Three control laws for a solved cycle: its torque alone, with feedback of the motors, and flatness-based tracking."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from math import comb
from pathlib import Path

import casadi as ca
import numpy as np
import xarray as xr

import pkmsea

ORDER = 4  # of the error dynamics: the relative degree of r_E where all drives are elastic
POLES = 60.0  # all of them, [1/s]; the rotors on their springs swing with 16
HALVES = 2  # exported samples per control step: a torque that is held belongs to the middle of its step

State = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]  # q, v, q_M, v_M
Law = Callable[[int, State], np.ndarray]  # step within the cycle and measured state -> motor torques (m,)


@dataclass(frozen=True, eq=False)
class Reference:
    """The exported cycle at the control steps: tau (K, m) in their middles, q_M, v_M (K, m) at their beginnings."""

    tau: np.ndarray
    q_M: np.ndarray
    v_M: np.ndarray
    t: np.ndarray
    step: float

    @classmethod
    def of(cls, solution: pkmsea.Solution, rate: float, file: Path) -> Reference:
        """Export a solution at twice the control rate [Hz] and read the file back."""
        sampling = pkmsea.export(solution, file, HALVES * rate)
        labels = solution.problem.actuation.labels
        with xr.open_dataset(file, engine="h5netcdf") as data:
            tau, q_M, v_M = (np.stack([data[f"{x}_{y}"] for y in labels], axis=1) for x in ("tau", "q_M", "v_M"))
            t = data["time"].values
        return cls(tau[1::HALVES], q_M[::HALVES], v_M[::HALVES], t[::HALVES], HALVES * sampling.time)


def feedforward(solution: pkmsea.Solution, reference: Reference) -> Law:
    """tau = tau_d"""
    return lambda k, state: reference.tau[k]


def motor_feedback(solution: pkmsea.Solution, reference: Reference) -> Law:
    """tau = tau_d + K_p (q_M,d - q_M) + K_d (v_M,d - v_M), K_p = C / 2, K_d = (C M_M)^(1/2)"""
    c = solution.stiffness
    K_p, K_d = c / 2, np.sqrt(c * solution.problem.actuation.numbers("inertia"))

    def law(k: int, state: State) -> np.ndarray:
        _, _, q_M, v_M = state
        return reference.tau[k] + K_p * (reference.q_M[k] - q_M) + K_d * (reference.v_M[k] - v_M)

    return law


def flatness_based(solution: pkmsea.Solution, reference: Reference, poles: float = POLES) -> Law:
    """tau = f_tau(y, y', y'', y''', w),  w = y_d'''' + sum_i k_i (y_d^(i) - y^(i)),  y ... y''' from the state"""
    actuation, c = solution.problem.actuation, solution.stiffness
    chain, flat_map = flat_chain(actuation.mechanism, c), actuation.flat_map()
    planned = np.stack([solution.motion.flat_output(reference.t, i) for i in range(ORDER + 1)], axis=2)
    gains = np.array([comb(ORDER, i) * poles ** (ORDER - i) for i in range(ORDER)])  # of (s + poles)^4

    def law(k: int, state: State) -> np.ndarray:
        q, v, q_M, v_M = state
        Y = np.array(chain(q, v[actuation.mechanism.independent], q_M, v_M))
        w = planned[k, :, ORDER] + (planned[k, :, :ORDER] - Y) @ gains
        found = flat_map(q=q, Y=np.column_stack([Y, w]), c=c)
        return np.array(found["tau"]).ravel()

    return law


def flat_chain(mechanism: pkmsea.Mechanism, c: np.ndarray) -> ca.Function:
    """(q, v_ind, q_M, v_M) -> y, y', y'', y''' (delta, 4) by the model.

    M a_ind + g = H_A^T C (q_M - q_A) gives a_ind; each derivative is that of the one before along (v, a_ind, v_M).
    """
    f = mechanism.functions
    q, v_ind = ca.SX.sym("q", mechanism.model.nq), ca.SX.sym("v_ind", mechanism.mobility)
    q_M, v_M = (ca.SX.sym(name, c.size) for name in ("q_M", "v_M"))
    load = ca.mtimes(f["actuation_jacobian"](q).T, c * (q_M - q[mechanism.actuated])) - f["bias"](q, v_ind)
    state = ca.vertcat(q, v_ind, q_M)
    along = ca.vertcat(ca.mtimes(f["velocity_map"](q), v_ind), ca.solve(f["mass_matrix"](q), load), v_M)
    chain = [f["end_effector"](q)]
    while len(chain) < ORDER:
        chain.append(ca.jtimes(chain[-1], state, along))
    names = ["q", "v_ind", "q_M", "v_M"]
    return ca.Function("flat_chain", [q, v_ind, q_M, v_M], [ca.cse(ca.horzcat(*chain))], names, ["Y"])
