"""The laws of the elements around a mechanism, each once, as CasADi expressions.

Numbers of a drive go by the names of its record (`pkmsea.actuation.drive.Drive`): `numbers["inertia"]` and so on, one
expression each. A law of springs is a class here, and a name in `pkmsea.actuation.kinds.KINDS`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from pkmsea.mechanism import Mechanism

Numbers = Mapping[str, ca.SX]

# of a drive, which laws and costs read; robots hand them over as r, each for all drives, one after the other
NUMBERS = ("inertia", "friction", "coulomb", "coulomb_width", "cubic", "damping", "copper_loss")


class Spring(ABC):
    """A series spring: its force over its deflection e = q_M - q_A, and the inverse; c is the stiffness."""

    @abstractmethod
    def force(self, c: ca.SX, numbers: Numbers, e: ca.SX) -> ca.SX:
        """u [N m, N] at a deflection e [rad, m]."""

    @abstractmethod
    def deflection(self, c: ca.SX, numbers: Numbers, u: ca.SX) -> ca.SX:
        """e [rad, m] under a force u [N m, N]."""


@dataclass(frozen=True)
class Linear(Spring):
    """u = c e."""

    def force(self, c: ca.SX, numbers: Numbers, e: ca.SX) -> ca.SX:
        return c * e

    def deflection(self, c: ca.SX, numbers: Numbers, u: ca.SX) -> ca.SX:
        return u / c


@dataclass(frozen=True)
class Cubic(Spring):
    """u = c e + c_3 e^3, a hardening spring; e = 2 s sinh(asinh(3 u / (2 c s)) / 3) with s^2 = c / (3 c_3), the only
    real root."""

    def force(self, c: ca.SX, numbers: Numbers, e: ca.SX) -> ca.SX:
        return c * e + numbers["cubic"] * e**3

    def deflection(self, c: ca.SX, numbers: Numbers, u: ca.SX) -> ca.SX:
        s = ca.sqrt(c / (3 * numbers["cubic"]))
        return 2 * s * ca.sinh(ca.asinh(3 * u / (2 * c * s)) / 3)


def parallel_spring(k: ca.SX, rest: ca.SX, q: ca.SX) -> ca.SX:
    """u_P = k (rest - q): force on the joint [N m, N]."""
    return k * (rest - q)


def damper(numbers: Numbers, rate: ca.SX) -> ca.SX:
    """d_s de/dt: force of a spring's losses [N m, N] at a rate of deflection [rad/s, m/s]."""
    return numbers["damping"] * rate


def friction(numbers: Numbers, v: ca.SX) -> ca.SX:
    """d_v v + F_C tanh(v / w): viscous and Coulomb friction of a rotor [N m, N] at a speed v [rad/s, m/s]."""
    return numbers["friction"] * v + numbers["coulomb"] * ca.tanh(v / numbers["coulomb_width"])


def rotor(numbers: Numbers, v: ca.SX, a: ca.SX) -> ca.SX:
    """M_M a + d_v v + F_C tanh(v / w): torque that moves a rotor [N m, N]; with u behind it, tau = rotor + u."""
    return numbers["inertia"] * a + friction(numbers, v)


def payload(mechanism: Mechanism, q: ca.SX, v: ca.SX, a: ca.SX, mass: ca.SX) -> ca.SX:
    """J^T mass (dv_E/dt - gravity) on the joints (n,), for a point mass [kg] at the end effector's origin."""
    return _point_mass(mechanism)(q, v, a, mass)


@lru_cache(maxsize=32)
def _point_mass(mechanism: Mechanism) -> ca.Function:
    """`payload` with symbols of its own, so that v and a may be expressions of q."""
    n = mechanism.model.nq
    q, v, a, mass = (ca.SX.sym(name, size) for name, size in (("q", n), ("v", n), ("a", n), ("mass", 1)))
    J = mechanism.tree.jacobian[mechanism.description.end_effector.frame](q)[:3, :]
    acceleration = ca.mtimes(J, a) + ca.jtimes(ca.mtimes(J, v), q, v) - ca.DM(mechanism.model.gravity.linear)
    return ca.Function("point_mass", [q, v, a, mass], [ca.mtimes(J.T, mass * acceleration)])
