"""The vector relative degree of the flat output, by Lie derivatives along the forward dynamics."""

from __future__ import annotations

import casadi as ca
import numpy as np

from pkmsea.actuation.actuation import Actuation, stack
from pkmsea.errors import MechanismError

MAX_DEGREE = 6


def relative_degree(actuation: Actuation) -> tuple[int, ...]:
    """Smallest r_i such that d^r_i y_i / dt^r_i depends on tau; the decoupling matrix must have full rank.

    State (q, v_ind, q_M, v_M), input tau; equations of the paper, eq. (EOMAll) and (EOMRD), for any mixture, with
    u = c e + c_3 e^3 + d_s de/dt of a spring wound by e = q_M - q_A: a damped one passes the motor's speed on.
    """
    mechanism, m = actuation.mechanism, actuation.m
    n, delta = mechanism.model.nq, mechanism.mobility
    q, v_ind, tau = ca.SX.sym("q", n), ca.SX.sym("v_ind", delta), ca.SX.sym("tau", m)
    q_M, v_M = ca.SX.sym("q_M", m), ca.SX.sym("v_M", m)
    x, dx, u = _forward(actuation, q, v_ind, q_M, v_M, tau)
    r_E = mechanism.functions["end_effector"](q)
    outputs = [r_E[i] for i in range(delta)]
    for i in actuation.free:
        outputs.append(u[i] if i in actuation.damped else q_M[i] if actuation.drives[i].elastic else tau[i])
    rng = np.random.default_rng(0)
    state = np.concatenate([mechanism.seed, rng.normal(size=delta), rng.normal(size=2 * m)])
    degrees, decoupling = [], []
    for y in outputs:
        degree, gain = _first_gain(y, x, dx, tau, state)
        degrees.append(degree)
        decoupling.append(gain)
    scaled = np.array(decoupling) / np.abs(decoupling).max(axis=1, keepdims=True)
    if np.linalg.matrix_rank(scaled, tol=1e-8) < m:
        raise MechanismError(
            "This flat output has no vector relative degree: its decoupling matrix is singular, because drives "
            "of several kinds (rigid, elastic, damped) act on the same motion.",
            "The flat map holds all the same; nothing needs to be done to solve such a task.",
        )
    return tuple(degrees)


def _first_gain(y: ca.SX, x: ca.SX, dx: ca.SX, tau: ca.SX, state: np.ndarray) -> tuple[int, np.ndarray]:
    """The first derivative of y that depends on tau, and its gain d(d^r y / dt^r)/dtau (m,) at a state."""
    for degree in range(MAX_DEGREE + 1):
        row = ca.Function("row", [x, tau], [ca.densify(ca.jacobian(y, tau))])
        gain = np.array(row(state, np.zeros(tau.numel()))).ravel()
        if gain.any():
            return degree, gain
        y = ca.jtimes(y, x, dx)
    raise MechanismError(
        f"No input occurs in the first {MAX_DEGREE} derivatives of an output.", "Check the drives of the mechanism."
    )


def _forward(
    actuation: Actuation, q: ca.SX, v_ind: ca.SX, q_M: ca.SX, v_M: ca.SX, tau: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """State x, its derivative, and the forces u on the joints (m,); motor states of rigid drives stay unused."""
    mechanism = actuation.mechanism
    f = mechanism.functions
    M, g, H = f["mass_matrix"](q), f["bias"](q, v_ind), f["velocity_map"](q)
    H_A = f["actuation_jacobian"](q)
    v_A = ca.mtimes(H_A, v_ind)
    drift = ca.jtimes(v_A, q, ca.mtimes(H, v_ind))  # dH_A/dt v_ind
    inertia = ca.DM([0.0 if d.elastic else d.inertia for d in actuation.drives])
    u, dv_M = [], []
    for i, drive in enumerate(actuation.drives):
        if drive.elastic:
            wound = q_M[i] - q[mechanism.actuated[i]]
            elastic = drive.stiffness_range[0] * wound + drive.cubic * wound**3
            u.append(elastic + drive.damping * (v_M[i] - v_A[i]))
            dv_M.append((tau[i] - drive.friction * v_M[i] - u[i]) / max(drive.inertia, 1e-12))
        else:
            u.append(tau[i] - drive.friction * v_A[i] - drive.inertia * drift[i])
            dv_M.append(ca.SX(0))
    total = M + ca.mtimes([H_A.T, ca.diag(inertia), H_A])
    forces = stack(u)
    dv_ind = ca.solve(total, ca.mtimes(H_A.T, forces) - g)
    x = ca.vertcat(q, v_ind, q_M, v_M)
    return x, ca.vertcat(ca.mtimes(H, v_ind), dv_ind, v_M, stack(dv_M)), forces
