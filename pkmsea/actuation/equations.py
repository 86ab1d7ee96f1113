"""The robot at one instant as equations with many small unknowns: cheap to differentiate twice.

Instead of one long expression for the drives' forces, the unknowns xi = (q, v, a, u_f, u_d, lambda) are fixed by

    Psi(q)                                   = [0; y]       loops closed, end effector at y
    dPsi/dt   = A(q) v                       = [0; y']
    d2Psi/dt2 = A(q) a + dA/dt v             = [0; y'']
    u_i - f_i(z_i - q_A,i)                   = 0            a free elastic drive with spring force f
    u_i + M_M,i a_A,i + d_v,i v_A,i + F_i - z_i = 0         a free rigid drive
    S_A^T (u + u_P) + G^T lambda - rnea(q, v, a) - J_E^T m_L (dv_E/dt - g) = 0    drives, closure forces, tree, payload

given w = (y, y', y'', z, p) with the parameters p: ln c of the series springs, ln k and rest position of the parallel
ones. What the cost and the limits need are the outputs s. Once the groups before it are known, each group of equations
is linear in its own unknowns, with A, A, A, 1 or L in front. So xi, D = dxi/dw and the adjoints follow group by group:
expressions give the right-hand sides, and the small systems are solved numerically (`pkmsea.kernels`), because symbolic
inverses grow with the fourth power of the number of joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise

import casadi as ca

from pkmsea.actuation import laws
from pkmsea.actuation.kinds import DriveAt
from pkmsea.actuation.structure import Structure, dependent_columns, joint_load, on_joints, stack
from pkmsea.kernels import named_function
from pkmsea.mechanism import pose


@dataclass(frozen=True, eq=False)
class StageFunctions:
    """Functions of one instant between which the systems with A and L are solved, group after group.

    Sizes: n joints, m drives, k = m - delta; xi has 4n + k entries. Inputs: xi; w_t = (y, y', y'', z), the part of w
    that changes from instant to instant; p; r, NUMBERS of all drives; load, the payload's mass [kg]; mu, weights
    of s_D; nu, adjoints of the equations; D_g, the columns of dxi_g/dw that are not zero, group by group.

    The outputs s are two of each drive, as its kind says: the first one of all drives, then the second one; s_D are
    these, and those of q, v, a of all joints that are `limited`.

    Attributes
    ----------
    matrices : q -> A, L. L (n, n) maps the dependent drives' and closure forces to the joints, and is singular where
        the drives lose the end effector.
    right : per group after the first, (xi, w_t, p, r, load) -> right-hand side of its unknowns.
    outputs : (xi, w_t, p, r, load) -> s_D.
    slope_right : per group, (xi, w_t, p, r, load, D of the groups before) -> right-hand sides of D_g.
    slope : (xi, w_t, p, r, load, D) -> S = ds_D/dw along the equations.
    adjoint_right : per group, (xi, w_t, p, r, load, mu, nu) -> right-hand side of nu_g, whose transposed systems are
        solved from the last group to the first.
    curvature : (xi, w_t, p, r, load, mu, nu, D) -> Hessian of mu^T s_D in w along the equations.
    groups : slice of xi, and of the equations, per group; its matrix is A, A, A, 1, L.
    """

    matrices: ca.Function
    right: tuple[ca.Function, ...]
    outputs: ca.Function
    slope_right: tuple[ca.Function, ...]
    slope: ca.Function
    adjoint_right: tuple[ca.Function, ...]
    curvature: ca.Function
    groups: tuple[slice, ...]


GROUP_MATRICES = ("A", "A", "A", "1", "L")


@dataclass(frozen=True)
class Stage:
    """The equations R(xi, w, r) = 0 and outputs s as expressions; every group's own matrix is A, A, A, 1 or L."""

    xi: ca.SX
    w: ca.SX
    given: tuple[ca.SX, ...]  # w_t, p, r, load
    R: ca.SX
    s: ca.SX
    A: ca.SX
    L: ca.SX
    groups: tuple[slice, ...]


def stage(structure: Structure) -> Stage:
    """The equations of one instant of a robot."""
    mechanism = structure.mechanism
    n, delta, m = mechanism.model.nq, mechanism.mobility, structure.m
    k = m - delta
    q, v, a = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("a", n)
    u_free, u_dependent, lam = ca.SX.sym("u_f", k), ca.SX.sym("u_d", delta), ca.SX.sym("lambda", n - delta)
    y, dy, ddy = ca.SX.sym("y", delta), ca.SX.sym("dy", delta), ca.SX.sym("ddy", delta)
    z, p = ca.SX.sym("z", k), ca.SX.sym("p", len(structure.parameters))
    r, mass = ca.SX.sym("r", len(laws.NUMBERS) * m), ca.SX.sym("load")
    drives, parallel = drives_at(structure, q, v, a, p, r)
    u = ca.SX(m, 1)
    u[list(structure.free)], u[structure.dependent] = u_free, u_dependent

    # common subexpressions are merged before each differentiation: derivatives are then half as long
    Psi = ca.cse(pose.task_system(mechanism)(q)[0])
    dPsi = ca.cse(ca.jtimes(Psi, q, v))
    ddPsi = ca.cse(ca.jtimes(dPsi, ca.vertcat(q, v), ca.vertcat(v, a)))
    zero = ca.SX(n - delta, 1)
    force = [structure.kinds[i].force(drives[i], z[j]) for j, i in enumerate(structure.free)]
    closure_forces = ca.jtimes(Psi, q, ca.vertcat(lam, ca.SX.zeros(delta)), True)  # G^T lambda
    R = ca.vertcat(
        Psi - ca.vertcat(zero, y),
        dPsi - ca.vertcat(zero, dy),
        ddPsi - ca.vertcat(zero, ddy),
        u_free - stack(force),
        ca.cse(on_joints(u + parallel, mechanism.actuated, n) + closure_forces - joint_load(structure, q, v, a, mass)),
    )
    free = {i: z[j] for j, i in enumerate(structure.free)}
    first, second = zip(
        *(kind.outputs(drives[i], u[i], free.get(i)) for i, kind in enumerate(structure.kinds)), strict=True
    )
    s = ca.vertcat(*first, *second, q, v, a)
    A = ca.cse(ca.densify(ca.jacobian(Psi, q)))
    L = ca.horzcat(ca.SX(dependent_columns(structure)), A[: n - delta, :].T)
    edges = (0, n, 2 * n, 3 * n, 3 * n + k, 4 * n + k)
    groups = tuple(slice(start, stop) for start, stop in pairwise(edges))
    xi, w_t = ca.vertcat(q, v, a, u_free, u_dependent, lam), ca.vertcat(y, dy, ddy, z)
    return Stage(xi, ca.vertcat(w_t, p), (w_t, p, r, mass), R, s, A, L, groups)


@lru_cache(maxsize=32)
def stage_functions(structure: Structure, limited: tuple[int, ...] = ()) -> StageFunctions:
    """Build the Functions of one instant for a robot; `limited` are indices of s beside the drives'."""
    e = stage(structure)
    s_D = ca.cse(ca.vertcat(e.s[: 2 * structure.m], *[e.s[i] for i in limited]))
    given = {"xi": e.xi, **dict(zip(("w", "p", "r", "load"), e.given, strict=True))}
    R_xi, R_w = ca.jacobian(e.R, e.xi), ca.jacobian(e.R, e.w)
    s_xi, s_w = ca.jacobian(s_D, e.xi), ca.jacobian(s_D, e.w)

    right = []
    for at in e.groups[1:]:
        without_own = ca.vertcat(e.xi[: at.start], ca.SX.zeros(e.xi.numel() - at.start))
        right.append(named_function("right", given, {"b": -ca.substitute(e.R[at], e.xi, without_own)}))

    D, columns, slope_right = ca.SX(0, e.w.numel()), dict(given), []
    for g, at in enumerate(e.groups):
        b = -(R_w[at, :] + ca.mtimes(R_xi[at, : at.start], D))
        filled = sorted({int(c) for c in b.sparsity().get_triplet()[1]})
        slope_right.append(named_function("slope_right", columns, {"b": b[:, filled]}))
        columns[f"D_{g}"] = ca.SX.sym(f"D_{g}", at.stop - at.start, len(filled))
        D_g = ca.SX(at.stop - at.start, e.w.numel())
        D_g[:, filled] = columns[f"D_{g}"]
        D = ca.vertcat(D, D_g)
    slope = s_w + ca.mtimes(s_xi, D)

    mu, nu = ca.SX.sym("mu", s_D.numel()), ca.SX.sym("nu", e.R.numel())
    adjoint = given | {"mu": mu, "nu": nu}
    adjoint_right = []
    for at in e.groups:
        later = ca.cse(ca.dot(mu, s_D) + ca.dot(nu[at.stop :], e.R[at.stop :]))
        adjoint_right.append(named_function("adjoint_right", adjoint, {"b": -ca.gradient(later, e.xi[at])}))
    Hessian = ca.hessian(ca.cse(ca.dot(mu, s_D) + ca.dot(nu, e.R)), ca.vertcat(e.xi, e.w))[0]
    direction = ca.vertcat(D, ca.SX.eye(e.w.numel()))
    curvature = ca.triu2symm(ca.triu(ca.mtimes(direction.T, ca.mtimes(Hessian, direction))))
    return StageFunctions(
        named_function("matrices", {"q": e.xi[e.groups[0]]}, {"A": e.A, "L": e.L}),
        tuple(right),
        named_function("outputs", given, {"s": s_D}),
        tuple(slope_right),
        named_function("slope", columns, {"S": slope}),
        tuple(adjoint_right),
        named_function("curvature", adjoint | columns, {"W": curvature}),
        e.groups,
    )


def drives_at(structure: Structure, q: ca.SX, v: ca.SX, a: ca.SX, p: ca.SX, r: ca.SX) -> tuple[list[DriveAt], ca.SX]:
    """The drives at an instant of all joints (n,), and the forces u_P of the springs in parallel (m,)."""
    values = dict(zip(structure.parameters, ca.vertsplit(p), strict=True))
    at = structure.mechanism.actuated
    drives = [
        DriveAt(q[at[i]], v[at[i]], a[at[i]], ca.exp(values["c", i]) if ("c", i) in values else ca.SX(0), numbers)
        for i, numbers in enumerate(structure.numbers(r))
    ]
    parallel = ca.SX(structure.m, 1)
    for i in structure.parallel:
        parallel[i] = laws.parallel_spring(ca.exp(values["k", i]), values["rest", i], q[at[i]])
    return drives, parallel


@lru_cache(maxsize=32)
def free_coordinates(structure: Structure) -> ca.Function:
    """(q, v, a, u, p, r) -> z (m - delta,): the free drives' coordinates at which the drives' forces are u (m,)."""
    n, m = structure.mechanism.model.nq, structure.m
    sizes = {"q": n, "v": n, "a": n, "u": m, "p": len(structure.parameters), "r": len(laws.NUMBERS) * m}
    given = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    drives, _ = drives_at(structure, *(given[name] for name in ("q", "v", "a", "p", "r")))
    z = [structure.kinds[i].free_coordinate(drives[i], given["u"][i]) for i in structure.free]
    return named_function("free_coordinates", given, {"z": stack(z)})
