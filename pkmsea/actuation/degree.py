"""The vector relative degree of the flat output, by Lie derivatives along the forward dynamics."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from pkmsea.actuation.drive import Drive
from pkmsea.actuation.kinds import DriveAt
from pkmsea.actuation.laws import NUMBERS
from pkmsea.actuation.structure import Structure, stack
from pkmsea.errors import MechanismError

MAX_DEGREE = 6
LEAST_INERTIA = 1e-12  # [kg m^2, kg]; a motor without inertia has no state otherwise


def relative_degree(structure: Structure, drives: Sequence[Drive]) -> tuple[int, ...]:
    """Smallest r_i such that d^r_i y_i / dt^r_i depends on tau; the decoupling matrix must have full rank.

    State (q, v_ind, q_M, v_M), input tau; equations of the paper, eq. (EOMAll) and (EOMRD), for any mixture of kinds: a
    damped spring passes the motor's speed on.
    """
    mechanism, m = structure.mechanism, structure.m
    n, delta = mechanism.model.nq, mechanism.mobility
    q, v_ind, tau = ca.SX.sym("q", n), ca.SX.sym("v_ind", delta), ca.SX.sym("tau", m)
    q_M, v_M = ca.SX.sym("q_M", m), ca.SX.sym("v_M", m)
    x, dx, u = _forward(structure, drives, q, v_ind, q_M, v_M, tau)
    r_E = mechanism.functions["end_effector"](q)
    series = {"q_M": q_M, "u": u, "tau": tau}
    outputs = [*ca.vertsplit(r_E), *(series[structure.kinds[i].coordinate][i] for i in structure.free)]
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
    structure: Structure, drives: Sequence[Drive], q: ca.SX, v_ind: ca.SX, q_M: ca.SX, v_M: ca.SX, tau: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """State x, its derivative, and the forces u on the joints (m,); motor states of rigid drives stay unused."""
    mechanism = structure.mechanism
    f = mechanism.functions
    M, g, H = f["mass_matrix"](q), f["bias"](q, v_ind), f["velocity_map"](q)
    H_A = f["actuation_jacobian"](q)
    v_A = ca.mtimes(H_A, v_ind)
    drift = ca.jtimes(v_A, q, ca.mtimes(H, v_ind))  # dH_A/dt v_ind
    at = mechanism.actuated
    found = []
    for i, (kind, drive) in enumerate(zip(structure.kinds, drives, strict=True)):
        numbers = {key: ca.SX(getattr(drive, key)) for key in NUMBERS}
        numbers["inertia"] = ca.fmax(numbers["inertia"], LEAST_INERTIA)
        c = ca.SX(drive.stiffness_range[0]) if kind.sprung else ca.SX(0)
        found.append(kind.forward(DriveAt(q[at[i]], v_A[i], drift[i], c, numbers), q_M[i], v_M[i], tau[i]))
    u, dv_M, inertia = (list(column) for column in zip(*found, strict=True))
    total = M + ca.mtimes([H_A.T, ca.diag(stack(inertia)), H_A])
    forces = stack(u)
    dv_ind = ca.solve(total, ca.mtimes(H_A.T, forces) - g)
    x = ca.vertcat(q, v_ind, q_M, v_M)
    return x, ca.vertcat(ca.mtimes(H, v_ind), dv_ind, v_M, stack(dv_M)), forces
