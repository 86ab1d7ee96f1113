"""The robot at one instant as equations with many small unknowns: cheap to differentiate twice.

Instead of one long expression for the drives' forces, the unknowns xi = (q, v, a, u, lambda) are fixed by

    Psi(q)                                   = [0; y]       loops closed, end effector at y
    A(q) v                                   = [0; y']
    A(q) a + dA/dt v                         = [0; y'']
    rnea(q, v, a) - S_A^T u - G^T lambda     = 0            the tree with its drives and closure forces
    u_i - c_i (z_i - q_A,i)                  = 0            a free elastic drive
    u_i + M_M,i a_A,i + d_v,i v_A,i - z_i    = 0            a free rigid drive

given w = (y, y', y'', z, theta) with theta = ln c. What the cost and the limits need are the outputs s.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from pkmsea.actuation.actuation import Actuation, dependent_columns, on_joints, stack
from pkmsea.mechanism import pose


@dataclass(frozen=True)
class StageFunctions:
    """Functions of one instant. Sizes: n joints, delta, m drives, k = m - delta; xi has 4n + k entries, w 3delta+k+m.

    `numbers` r = (M_M, d_v), (2m,), are parameters.

    Attributes
    ----------
    closed_pose : (q) -> Psi, A; what Newton's method needs for q.
    unknowns : (q, w, r) -> xi, L; all of xi by linear solves, once q is known; L (n, n) maps the dependent drives'
        and closure forces to the joints and is singular where the drives lose the end effector.
    outputs : (xi, w, r) -> s; per drive (q_M, u) if elastic, (tau, v_A) if rigid; then q, v, a of all joints.
    first : (xi, w, r) -> R_xi, R_w, s_xi, s_w; Jacobians of the residual R and of s.
    second : (xi, w, r, mu, nu) -> Hessian of mu^T s + nu^T R in (xi, w).
    """

    closed_pose: ca.Function
    unknowns: ca.Function
    outputs: ca.Function
    first: ca.Function
    second: ca.Function


def stage_functions(actuation: Actuation) -> StageFunctions:
    """Build the Functions of one instant for a robot."""
    mechanism = actuation.mechanism
    n, delta, m = mechanism.model.nq, mechanism.mobility, actuation.m
    k = m - delta
    q, v, a = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("a", n)
    u, lam = ca.SX.sym("u", m), ca.SX.sym("lambda", n - delta)
    y, dy, ddy = ca.SX.sym("y", delta), ca.SX.sym("dy", delta), ca.SX.sym("ddy", delta)
    z, theta = ca.SX.sym("z", k), ca.SX.sym("theta", m)
    inertia, friction = ca.SX.sym("M_M", m), ca.SX.sym("d_v", m)
    xi, w = ca.vertcat(q, v, a, u, lam), ca.vertcat(y, dy, ddy, z, theta)
    r = ca.vertcat(inertia, friction)

    closed_pose = pose.task_system(mechanism)
    Psi, A = closed_pose(q)
    gamma = ca.jtimes(ca.mtimes(A, v), q, v)
    G = mechanism.functions["closure_jacobian"](q)
    load = mechanism.tree.inverse_dynamics(q, v, a)
    zero = ca.SX(n - delta, 1)
    at = mechanism.actuated
    force = [
        ca.exp(theta[i]) * (z[j] - q[at[i]])
        if actuation.drives[i].elastic
        else z[j] - inertia[i] * a[at[i]] - friction[i] * v[at[i]]
        for j, i in enumerate(actuation.free)
    ]
    R = ca.vertcat(
        Psi - ca.vertcat(zero, y),
        ca.mtimes(A, v) - ca.vertcat(zero, dy),
        ca.mtimes(A, a) + gamma - ca.vertcat(zero, ddy),
        load - on_joints(u, at, n) - ca.mtimes(G.T, lam),
        stack([u[i] for i in actuation.free]) - stack(force),
    )
    s = ca.vertcat(_drive_outputs(actuation, q, v, a, u, z, theta, inertia, friction), q, v, a)
    arguments, names = [xi, w, r], ["xi", "w", "r"]
    mu, nu = ca.SX.sym("mu", s.numel()), ca.SX.sym("nu", R.numel())
    both = ca.vertcat(xi, w)
    hessian = ca.hessian(ca.dot(mu, s) + ca.dot(nu, R), both)[0]
    first = [ca.densify(ca.jacobian(e, x)) for e in (R, s) for x in (xi, w)]

    # once q is known, every block of R is linear in the next unknown
    v_ = ca.solve(A, ca.vertcat(zero, dy))
    a_ = ca.solve(A, ca.vertcat(zero, ddy) - ca.substitute(gamma, v, v_))
    u_free = ca.substitute(stack(force), ca.vertcat(v, a), ca.vertcat(v_, a_))
    u_known = ca.SX(m, 1)
    u_known[actuation.free] = u_free
    rest = ca.substitute(load, ca.vertcat(v, a), ca.vertcat(v_, a_)) - on_joints(u_known, at, n)
    columns = ca.horzcat(ca.SX(dependent_columns(actuation)), G.T)
    u_dependent, lam_ = ca.vertsplit(ca.solve(columns, rest), [0, delta, n])
    u_known[actuation.dependent] = u_dependent
    unknowns = ca.vertcat(q, v_, a_, u_known, lam_)
    return StageFunctions(
        closed_pose,
        ca.Function(
            "unknowns", [q, w, r], ca.cse([ca.densify(unknowns), ca.densify(columns)]), ["q", "w", "r"], ["xi", "L"]
        ),
        ca.Function("outputs", arguments, [s], names, ["s"]),
        ca.Function("first", arguments, ca.cse(first), names, ["R_xi", "R_w", "s_xi", "s_w"]),
        ca.Function("second", [*arguments, mu, nu], [ca.densify(ca.cse(hessian))], [*names, "mu", "nu"], ["W"]),
    )


def _drive_outputs(
    actuation: Actuation,
    q: ca.SX,
    v: ca.SX,
    a: ca.SX,
    u: ca.SX,
    z: ca.SX,
    theta: ca.SX,
    inertia: ca.SX,
    friction: ca.SX,
) -> ca.SX:
    """(2m,): (q_M, u) of an elastic drive, (tau, v_A) of a rigid one."""
    rows: list[ca.SX] = []
    for i, drive in enumerate(actuation.drives):
        j = actuation.mechanism.actuated[i]
        if not drive.elastic:
            rows += [u[i] + inertia[i] * a[j] + friction[i] * v[j], v[j]]
        elif i in actuation.free:
            rows += [z[actuation.free.index(i)], u[i]]
        else:
            rows += [q[j] + u[i] * ca.exp(-theta[i]), u[i]]
    return stack(rows)
