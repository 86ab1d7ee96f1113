"""The robot at one instant as equations with many small unknowns: cheap to differentiate twice.

Instead of one long expression for the drives' forces, the unknowns xi = (q, v, a, u_f, u_d, lambda) are fixed by

    Psi(q)                                   = [0; y]       loops closed, end effector at y
    A(q) v                                   = [0; y']
    A(q) a + dA/dt v                         = [0; y'']
    u_i - f_i(z_i - q_A,i)                   = 0            a free elastic drive with spring force f
    u_i + M_M,i a_A,i + d_v,i v_A,i + F_i - z_i = 0         a free rigid drive
    rnea(q, v, a) + J_E^T m_L (dv_E/dt - g) - S_A^T (u + u_P) - G^T lambda = 0    tree, payload, drives, closure forces

given w = (y, y', y'', z, p) with the parameters p: ln c of the series springs, ln k and rest position of the parallel
ones. What the cost and the limits need are the outputs s. Once the
groups before it are known, each group of equations is linear in its own unknowns, with A, 1 or L in front; so dxi/dw
and the adjoints follow group by group, as expressions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from pkmsea.actuation.actuation import NUMBERS, Shape, dependent_columns, on_joints, stack
from pkmsea.actuation.elements import coulomb, payload_load, spring_deflection, spring_force
from pkmsea.mechanism import pose


@dataclass(frozen=True)
class StageFunctions:
    """Functions of one instant. Sizes: n joints, m drives, k = m - delta; xi has 4n + k entries.

    r, (5m + 1,), is `Actuation.stage_numbers` at the instant. The outputs s are (q_M, u) of an elastic drive,
    (q_A, u) of a damped one, (tau, v_A) of a rigid one, drive by drive; then q, v, a of all joints. s_D are those that
    are differentiated: all of the drives, and the `limited` ones of the joints.

    Attributes
    ----------
    unknowns : (q, w, r) -> xi, s, A, L; once q is known. L (n, n) maps the dependent drives' and closure forces to the
        joints, and is singular where the drives lose the end effector.
    slope : (xi, w, r) -> S; ds_D/dw along the equations.
    curvature : (xi, w, r, mu) -> W; Hessian of mu^T s_D in w along the equations.
    """

    unknowns: ca.Function
    slope: ca.Function
    curvature: ca.Function


@dataclass(frozen=True)
class Stage:
    """The equations R(xi, w, r) = 0 and outputs s as expressions.

    `groups` are the solvable groups in their order: slice of R, slice of xi, inverse of the matrix between the two.
    """

    xi: ca.SX
    w: ca.SX
    r: ca.SX
    R: ca.SX
    s: ca.SX
    A: ca.SX
    L: ca.SX
    groups: tuple[tuple[slice, ca.SX], ...]

    def forward(self, right: ca.SX) -> ca.SX:
        """R_xi^-1 right, (xi, columns)."""
        R_xi = ca.jacobian(self.R, self.xi)
        solved = ca.SX(0, right.size2())
        for at, inverse in self.groups:
            solved = ca.vertcat(solved, ca.mtimes(inverse, right[at, :] - ca.mtimes(R_xi[at, : at.start], solved)))
        return solved

    def adjoint(self, right: ca.SX) -> ca.SX:
        """R_xi^-T right, (R, columns)."""
        R_xi = ca.jacobian(self.R, self.xi)
        solved = ca.SX(0, right.size2())
        for at, inverse in reversed(self.groups):
            below = ca.mtimes(R_xi[at.stop :, at].T, solved)
            solved = ca.vertcat(ca.mtimes(inverse.T, right[at, :] - below), solved)
        return solved


def stage(shape: Shape) -> Stage:
    """The equations of one instant of a robot."""
    mechanism = shape.mechanism
    n, delta, m = mechanism.model.nq, mechanism.mobility, shape.m
    k = m - delta
    q, v, a = ca.SX.sym("q", n), ca.SX.sym("v", n), ca.SX.sym("a", n)
    u_free, u_dependent, lam = ca.SX.sym("u_f", k), ca.SX.sym("u_d", delta), ca.SX.sym("lambda", n - delta)
    y, dy, ddy = ca.SX.sym("y", delta), ca.SX.sym("dy", delta), ca.SX.sym("ddy", delta)
    z, p = ca.SX.sym("z", k), ca.SX.sym("p", len(shape.elastic) + 2 * len(shape.parallel))
    r = ca.SX.sym("r", len(NUMBERS) * m + 1)
    drives = _drives(shape, q, v, a, p, r)
    u = ca.SX(m, 1)
    u[list(shape.free)], u[shape.dependent] = u_free, u_dependent

    Psi, A = pose.task_system(mechanism)(q)
    gamma = ca.jtimes(ca.mtimes(A, v), q, v)
    G = mechanism.functions["closure_jacobian"](q)
    zero = ca.SX(n - delta, 1)
    force = [drives[i].force(z[j]) for j, i in enumerate(shape.free)]
    forces = u + ca.vertcat(*[drive.parallel for drive in drives])
    load = mechanism.tree.inverse_dynamics(q, v, a) + payload_load(shape, q, v, a, r[-1])
    R = ca.vertcat(
        Psi - ca.vertcat(zero, y),
        ca.mtimes(A, v) - ca.vertcat(zero, dy),
        ca.mtimes(A, a) + gamma - ca.vertcat(zero, ddy),
        u_free - stack(force),
        load - on_joints(forces, mechanism.actuated, n) - ca.mtimes(G.T, lam),
    )
    free = {i: z[j] for j, i in enumerate(shape.free)}
    s = ca.vertcat(*[row for i in range(m) for row in drives[i].outputs(u[i], free.get(i))], q, v, a)
    L = ca.horzcat(ca.SX(dependent_columns(shape)), G.T)
    edges = (0, n, 2 * n, 3 * n, 3 * n + k, 4 * n + k)
    inverse_A = ca.inv(A)
    inverses = (inverse_A, inverse_A, inverse_A, ca.SX.eye(k), -ca.inv(L))
    groups = tuple(
        (slice(start, stop), inverse) for start, stop, inverse in zip(edges, edges[1:], inverses, strict=False)
    )
    xi, w = ca.vertcat(q, v, a, u_free, u_dependent, lam), ca.vertcat(y, dy, ddy, z, p)
    return Stage(xi, w, r, R, s, A, L, groups)


@lru_cache(maxsize=32)
def stage_functions(shape: Shape, limited: tuple[int, ...] = ()) -> StageFunctions:
    """Build the Functions of one instant for a robot; `limited` are indices of s beside the drives'."""
    e = stage(shape)
    q = e.xi[: shape.mechanism.model.nq]
    s_D = ca.vertcat(e.s[: 2 * shape.m], *[e.s[i] for i in limited])

    # every group is linear in its own unknowns: one Newton step from zero solves it
    xi = q
    for at, inverse in e.groups[1:]:
        guess = ca.vertcat(xi, ca.SX.zeros(e.xi.numel() - at.start))
        xi = ca.vertcat(xi, ca.densify(-ca.mtimes(inverse, ca.substitute(e.R[at], e.xi, guess))))

    mu, nu = ca.SX.sym("mu", s_D.numel()), ca.SX.sym("nu", e.R.numel())
    inner = e.forward(-ca.jacobian(e.R, e.w))
    s_xi = ca.jacobian(s_D, e.xi)
    slope = ca.jacobian(s_D, e.w) + ca.mtimes(s_xi, inner)
    Hessian = ca.hessian(ca.dot(mu, s_D) + ca.dot(nu, e.R), ca.vertcat(e.xi, e.w))[0]
    Hessian = ca.substitute(Hessian, nu, ca.densify(e.adjoint(-ca.mtimes(s_xi.T, mu))))
    direction = ca.vertcat(inner, ca.SX.eye(e.w.numel()))
    curvature = ca.mtimes(direction.T, ca.mtimes(Hessian, direction))
    given, names = [e.xi, e.w, e.r], ["xi", "w", "r"]
    return StageFunctions(
        _function(
            "unknowns", [q, e.w, e.r], [xi, ca.substitute(e.s, e.xi, ca.densify(xi)), e.A, e.L],
            ["q", "w", "r"], ["xi", "s", "A", "L"],
        ),
        _function("slope", given, [slope], names, ["S"]),
        _function("curvature", [*given, mu], [curvature], [*names, "mu"], ["W"]),
    )  # fmt: skip


def _function(
    name: str, inputs: list[ca.SX], outputs: list[ca.SX], names_in: list[str], names_out: list[str]
) -> ca.Function:
    return ca.Function(name, inputs, [ca.densify(x) for x in ca.cse(outputs)], names_in, names_out)


@dataclass(frozen=True)
class _DriveAt:
    """One drive at an instant: its joint's motion, and its numbers as symbols."""

    shape: Shape
    index: int
    q: ca.SX
    v: ca.SX
    a: ca.SX
    c: ca.SX
    numbers: dict[str, ca.SX]
    parallel: ca.SX  # u_P

    @property
    def losses(self) -> ca.SX:
        """Torque that moves a rigid drive's rotor."""
        r = self.numbers
        return r["inertia"] * self.a + r["friction"] * self.v + coulomb(r["coulomb"], r["coulomb_width"], self.v)

    def force(self, z: ca.SX) -> ca.SX:
        """u of a free drive whose coordinate is z."""
        if self.index in self.shape.damped:
            return z
        if self.index in self.shape.elastic:
            return spring_force(self.shape, self.index, self.c, self.numbers["cubic"], z - self.q)
        return z - self.losses

    def outputs(self, u: ca.SX, z: ca.SX | None) -> tuple[ca.SX, ca.SX]:
        """(q_M, u) of an elastic drive, (q_A, u) of a damped one, (tau, v_A) of a rigid one; z is None if dependent."""
        if self.index not in self.shape.elastic:
            return u + self.losses, self.v
        if self.index in self.shape.damped:
            return self.q, u
        if z is not None:
            return z, u
        return self.q + spring_deflection(self.shape, self.index, self.c, self.numbers["cubic"], u), u


def _drives(shape: Shape, q: ca.SX, v: ca.SX, a: ca.SX, p: ca.SX, r: ca.SX) -> list[_DriveAt]:
    m, first = shape.m, len(shape.elastic)
    result = []
    for i, joint in enumerate(shape.mechanism.actuated):
        numbers = {key: r[k * m + i] for k, key in enumerate(NUMBERS)}
        c, parallel = ca.SX(0), ca.SX(0)
        if i in shape.elastic:
            c = ca.exp(p[shape.elastic.index(i)])
        if i in shape.parallel:
            log_k, rest = ca.vertsplit(p[first + 2 * shape.parallel.index(i) :][:2])
            parallel = ca.exp(log_k) * (rest - q[joint])
        result.append(_DriveAt(shape, i, q[joint], v[joint], a[joint], c, numbers, parallel))
    return result
