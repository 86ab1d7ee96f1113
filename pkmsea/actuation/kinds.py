"""Kinds of drives: what each of them is to the flat output, the equations, the signals and the forward dynamics.

Whoever builds Functions asks the kind of a drive, and never which one it is. `KINDS` names them all.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import casadi as ca

from pkmsea.actuation.drive import Drive
from pkmsea.actuation.laws import Cubic, Linear, Numbers, Spring, damper, rotor


@dataclass(frozen=True)
class DriveAt:
    """A drive at an instant: its joint's motion q, v, a, its stiffness c (zero without a spring), numbers."""

    q: ca.SX
    v: ca.SX
    a: ca.SX
    c: ca.SX
    numbers: Numbers


@dataclass(frozen=True)
class Kind(ABC):
    """A kind of drive.

    A drive that is free adds one entry to the flat output, its coordinate z. At every instant it has two outputs s, and
    the entries of z_s = (s_j, or its time derivatives), from which motor torque and speed follow, are its `rows`.

    Attributes
    ----------
    coordinate : name of z among the series of a motion: q_M, u or tau.
    rows : (output, order of its time derivative) of every entry of z_s.
    sprung : whether it has a stiffness c.
    remembers : whether its deflection depends on the past of its force, c e + d_s de/dt = u; q_M, v_M and tau are then
        those without the damping until `pkmsea.motion.damping` puts it in.
    reluctance : how many times better conditioned it must leave the other drives' forces, relative to a sprung one, to
        be free.
    """

    coordinate: ClassVar[str]
    rows: ClassVar[tuple[tuple[int, int], ...]]
    sprung: ClassVar[bool] = False
    remembers: ClassVar[bool] = False
    reluctance: ClassVar[float] = 1.0

    @abstractmethod
    def force(self, at: DriveAt, z: ca.SX) -> ca.SX:
        """u from z."""

    @abstractmethod
    def free_coordinate(self, at: DriveAt, u: ca.SX) -> ca.SX:
        """z from u, the inverse of `force`."""

    @abstractmethod
    def position(self, at: DriveAt, u: ca.SX, z: ca.SX | None) -> ca.SX:
        """q_M; z is None where the drive is not free."""

    @abstractmethod
    def outputs(self, at: DriveAt, u: ca.SX, z: ca.SX | None) -> tuple[ca.SX, ca.SX]:
        """The two outputs s."""

    @abstractmethod
    def signals(self, numbers: Numbers, z_s: list[ca.SX]) -> tuple[ca.SX, ca.SX]:
        """tau and v_M from z_s."""

    @abstractmethod
    def forward(self, at: DriveAt, q_M: ca.SX, v_M: ca.SX, tau: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """u, dv_M/dt, and the inertia that the joint carries, of the forward dynamics; `at.a` is the joint's
        acceleration less that by the independent joints' accelerations."""


@dataclass(frozen=True)
class Rigid(Kind):
    """Motor and joint are one: s = (tau, v_A), tau = M_M a_A + d_v v_A + F(v_A) + u, z = tau."""

    coordinate = "tau"
    rows = ((0, 0), (1, 0))
    reluctance = 10.0

    def force(self, at: DriveAt, z: ca.SX) -> ca.SX:
        return z - rotor(at.numbers, at.v, at.a)

    def free_coordinate(self, at: DriveAt, u: ca.SX) -> ca.SX:
        return u + rotor(at.numbers, at.v, at.a)

    def position(self, at: DriveAt, u: ca.SX, z: ca.SX | None) -> ca.SX:
        return at.q

    def outputs(self, at: DriveAt, u: ca.SX, z: ca.SX | None) -> tuple[ca.SX, ca.SX]:
        return self.free_coordinate(at, u), at.v

    def signals(self, numbers: Numbers, z_s: list[ca.SX]) -> tuple[ca.SX, ca.SX]:
        tau, v = z_s
        return tau, v

    def forward(self, at: DriveAt, q_M: ca.SX, v_M: ca.SX, tau: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        return tau - rotor(at.numbers, at.v, at.a), ca.SX(0), at.numbers["inertia"]


@dataclass(frozen=True)
class Elastic(Kind):
    """A rotor behind a spring: s = (q_M, u), u = f(q_M - q_A), tau = M_M a_M + d_v v_M + F(v_M) + u, z = q_M."""

    spring: Spring

    coordinate = "q_M"
    rows = ((1, 0), (0, 1), (0, 2))
    sprung = True

    def force(self, at: DriveAt, z: ca.SX) -> ca.SX:
        return self.spring.force(at.c, at.numbers, z - at.q)

    def free_coordinate(self, at: DriveAt, u: ca.SX) -> ca.SX:
        return at.q + self.spring.deflection(at.c, at.numbers, u)

    def position(self, at: DriveAt, u: ca.SX, z: ca.SX | None) -> ca.SX:
        return self.free_coordinate(at, u) if z is None else z

    def outputs(self, at: DriveAt, u: ca.SX, z: ca.SX | None) -> tuple[ca.SX, ca.SX]:
        return self.position(at, u, z), u

    def signals(self, numbers: Numbers, z_s: list[ca.SX]) -> tuple[ca.SX, ca.SX]:
        u, v_M, a_M = z_s
        return rotor(numbers, v_M, a_M) + u, v_M

    def forward(self, at: DriveAt, q_M: ca.SX, v_M: ca.SX, tau: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        u = self.spring.force(at.c, at.numbers, q_M - at.q) + damper(at.numbers, v_M - at.v)
        return u, (tau - rotor(at.numbers, v_M, ca.SX(0)) - u) / at.numbers["inertia"], ca.SX(0)


@dataclass(frozen=True)
class Damped(Elastic):
    """An elastic drive whose spring has losses, c e + d_s de/dt = u: s = (q_A, u), to which e is added, and z = u."""

    coordinate = "u"
    remembers = True

    def force(self, at: DriveAt, z: ca.SX) -> ca.SX:
        return z

    def free_coordinate(self, at: DriveAt, u: ca.SX) -> ca.SX:
        return u

    def position(self, at: DriveAt, u: ca.SX, z: ca.SX | None) -> ca.SX:
        return at.q + self.spring.deflection(at.c, at.numbers, u)

    def outputs(self, at: DriveAt, u: ca.SX, z: ca.SX | None) -> tuple[ca.SX, ca.SX]:
        return at.q, u


KINDS: dict[str, Callable[[Drive], Kind]] = {  # by `Drive.law`
    "rigid": lambda drive: Rigid(),
    "linear": lambda drive: Elastic(Linear()),
    "cubic": lambda drive: Elastic(Cubic()),
    "damped": lambda drive: Damped(Linear()),
}


def kind_of(drive: Drive) -> Kind:
    """The kind of a drive."""
    return KINDS[drive.law](drive)
