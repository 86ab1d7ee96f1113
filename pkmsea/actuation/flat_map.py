"""The flat map: the whole state and all motor torques from the flat output and its time derivatives, exactly."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from pkmsea.actuation import laws
from pkmsea.actuation.kinds import DriveAt
from pkmsea.actuation.structure import Structure, dependent_columns, joint_load, on_joints, stack
from pkmsea.mechanism import pose


@lru_cache(maxsize=16)
def flat_map(structure: Structure) -> ca.Function:
    """The Function `flat_map`: y, y', ... -> q_M, v_M, tau and what lies between, no derivative approximated.

    Inputs: q (n,), the closed pose at r_E (`Mechanism.configuration`); Y (delta, 5), r_E and four derivatives;
    Z (m - delta, 3), z and two derivatives; c (m,) stiffnesses (ignored where rigid); k (m,) and rest (m,) of the
    parallel springs (ignored where there is none); L (1, 3), the payload's mass and two derivatives; r, NUMBERS of all
    drives.
    Outputs: q_M, v_M (m,), joint position and velocity for a rigid drive; tau (m,); u (m,); v, a (n,).

    The deflection of a damped spring depends on the past of its force: its q_M, v_M and tau are here those without the
    damping, and `pkmsea.solution.audit` puts it in.

    The load equation gives q_M = f_M(y, y', y''); its two time derivatives and tau = f_tau(y, ..., y'''') follow by
    directional derivatives along the jet (paper, section 4.2).
    """
    mechanism = structure.mechanism
    n, delta, m = mechanism.model.nq, mechanism.mobility, structure.m
    k = m - delta
    q, Y, Z = ca.SX.sym("q", n), ca.SX.sym("Y", delta, 5), ca.SX.sym("Z", k, 3)
    c, k_P, rest, L = ca.SX.sym("c", m), ca.SX.sym("k", m), ca.SX.sym("rest", m), ca.SX.sym("L", 1, 3)
    r = ca.SX.sym("r", len(laws.NUMBERS) * m)
    at = mechanism.actuated

    _, A = pose.task_system(mechanism)(q)
    zero = ca.SX(n - delta, 1)
    v = ca.densify(ca.solve(A, ca.vertcat(zero, Y[:, 1])))
    jet = ca.vertcat(q, ca.vec(Y[:, :4]), ca.vec(Z[:, :2]), L[:, :2].T)
    jet_rate = ca.vertcat(v, ca.vec(Y[:, 1:]), ca.vec(Z[:, 1:]), L[:, 1:].T)

    def rate(expression: ca.SX) -> ca.SX:
        return ca.densify(ca.jtimes(expression, jet, jet_rate))

    a = rate(v)
    load = joint_load(structure, q, v, a, L[0])
    for i in structure.parallel:
        load[at[i]] -= laws.parallel_spring(k_P[i], rest[i], q[at[i]])
    numbers = structure.numbers(r)
    drives = [DriveAt(q[at[i]], v[at[i]], a[at[i]], c[i], numbers[i]) for i in range(m)]
    free = {i: Z[j, 0] for j, i in enumerate(structure.free)}
    u = _all_forces(structure, q, load, [structure.kinds[i].force(drives[i], z) for i, z in free.items()])
    q_M = stack([kind.position(drives[i], u[i], free.get(i)) for i, kind in enumerate(structure.kinds)])
    v_M = rate(q_M)
    a_M = rate(v_M)
    tau = stack([laws.rotor(numbers[i], v_M[i], a_M[i]) + u[i] for i in range(m)])
    outputs = ca.cse([q_M, v_M, ca.densify(tau), ca.densify(u), v, a])
    return ca.Function(
        "flat_map",
        [q, Y, Z, c, k_P, rest, L, r],
        outputs,
        ["q", "Y", "Z", "c", "k", "rest", "L", "r"],
        ["q_M", "v_M", "tau", "u", "v", "a"],
    )


def _all_forces(structure: Structure, q: ca.SX, load: ca.SX, u_free: list[ca.SX]) -> ca.SX:
    """u (m,): the free drives' forces, and those of the others from load = S_A^T u + G^T lambda."""
    u, n = ca.SX(structure.m, 1), q.numel()
    u[list(structure.free)] = stack(u_free)
    G = structure.mechanism.functions["closure_jacobian"](q)
    columns = ca.horzcat(ca.SX(dependent_columns(structure)), G.T)
    u[structure.dependent] = ca.solve(columns, load - on_joints(u, structure.mechanism.actuated, n))[
        : len(structure.dependent)
    ]
    return u


@lru_cache(maxsize=16)
def flat_map_of_columns(structure: Structure) -> ca.Function:
    """`flat_map` with Y, Z and L as columns, derivative after derivative, so that it can be mapped over instants."""
    exact = flat_map(structure)
    inputs = [ca.SX.sym(exact.name_in(i), exact.numel_in(i)) for i in range(exact.n_in())]
    shaped = [ca.reshape(x, *exact.size_in(i)) for i, x in enumerate(inputs)]
    return ca.Function("flat_map_of_columns", inputs, exact.call(shaped), exact.name_in(), exact.name_out())
