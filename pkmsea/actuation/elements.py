"""Force laws of the elements around a mechanism: payload, series spring, Coulomb friction, as CasADi expressions."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from pkmsea.actuation.actuation import Shape


def payload_load(shape: Shape, q: ca.SX, v: ca.SX, a: ca.SX, mass: ca.SX) -> ca.SX:
    """J^T mass (dv_E/dt - gravity) on the joints (n,), for a point mass at the end effector's origin; zero if none."""
    if not shape.payload:
        return ca.SX(q.numel(), 1)
    return _point_mass(shape)(q, v, a, mass)


@lru_cache(maxsize=32)
def _point_mass(shape: Shape) -> ca.Function:
    """`payload_load` with symbols of its own, so that v and a may be expressions of q."""
    n, mechanism = shape.mechanism.model.nq, shape.mechanism
    q, v, a, mass = (ca.SX.sym(name, size) for name, size in (("q", n), ("v", n), ("a", n), ("mass", 1)))
    J = mechanism.tree.jacobian[mechanism.description.end_effector.frame](q)[:3, :]
    acceleration = ca.mtimes(J, a) + ca.jtimes(ca.mtimes(J, v), q, v) - ca.DM(mechanism.model.gravity.linear)
    return ca.Function("point_mass", [q, v, a, mass], [ca.mtimes(J.T, mass * acceleration)])


def spring_force(shape: Shape, i: int, c: ca.SX, cubic: ca.SX, deflection: ca.SX) -> ca.SX:
    """Force of the series spring of drive i."""
    return c * deflection + (cubic * deflection**3 if i in shape.cubic else 0)


def spring_deflection(shape: Shape, i: int, c: ca.SX, cubic: ca.SX, force: ca.SX) -> ca.SX:
    """Its inverse; for the cubic one the only real root, 2 s sinh(asinh(3 force / (2 c s)) / 3), s^2 = c / (3 c_3)."""
    if i not in shape.cubic:
        return force / c
    s = ca.sqrt(c / (3 * cubic))
    return 2 * s * ca.sinh(ca.asinh(3 * force / (2 * c * s)) / 3)


def coulomb(torque: ca.SX, width: ca.SX, speed: ca.SX) -> ca.SX:
    """Coulomb friction F_C tanh(v / w)."""
    return torque * ca.tanh(speed / width)


def payload_power(shape: Shape) -> ca.Function:
    """(q, v, a, mass) -> P; power that the end effector gives to its payload [W]."""
    n = shape.mechanism.model.nq
    q, v, a, mass = (ca.SX.sym(name, size) for name, size in (("q", n), ("v", n), ("a", n), ("mass", 1)))
    P = ca.dot(v, payload_load(shape, q, v, a, mass))
    return ca.Function("payload_power", [q, v, a, mass], [P], ["q", "v", "a", "mass"], ["P"])
