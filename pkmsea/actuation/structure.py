"""What a robot's Functions are built for, and what they have in common."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from pkmsea.actuation.drive import ParameterKind
from pkmsea.actuation.kinds import Kind
from pkmsea.actuation.laws import NUMBERS, payload
from pkmsea.mechanism import Mechanism


@dataclass(frozen=True)
class Structure:
    """What a robot's Functions are built for; all its numbers are inputs of theirs, so that robots can share them.

    `kinds` are those of the drives, `free` the drives whose coordinate belongs to the flat output, `parallel` those
    with a spring beside them; `payload`: whether the end effector carries one.
    """

    mechanism: Mechanism
    kinds: tuple[Kind, ...]
    free: tuple[int, ...]
    parallel: tuple[int, ...] = ()
    payload: bool = False

    @property
    def m(self) -> int:
        """Number of drives."""
        return len(self.kinds)

    @property
    def dependent(self) -> list[int]:
        """The delta drives whose forces follow from the load equation."""
        return [i for i in range(self.m) if i not in self.free]

    @property
    def parameters(self) -> tuple[tuple[ParameterKind, int], ...]:
        """Kind and drive of the entries of p, see `Parameter`: stiffnesses in series, then parallel springs."""
        series: list[tuple[ParameterKind, int]] = [("c", i) for i, kind in enumerate(self.kinds) if kind.sprung]
        beside: tuple[ParameterKind, ...] = ("k", "rest")
        return (*series, *((name, i) for i in self.parallel for name in beside))

    def numbers(self, r: ca.SX) -> list[dict[str, ca.SX]]:
        """The numbers of each drive from r, which holds each of NUMBERS for all drives."""
        columns = dict(zip(NUMBERS, ca.vertsplit(r, self.m), strict=True))
        return [{key: column[i] for key, column in columns.items()} for i in range(self.m)]


def stack(expressions: list[ca.SX]) -> ca.SX:
    """Vertical stack that stays a column when it is empty."""
    return ca.densify(ca.vertcat(*expressions)) if expressions else ca.SX(0, 1)


def joint_load(structure: Structure, q: ca.SX, v: ca.SX, a: ca.SX, mass: ca.SX) -> ca.SX:
    """rnea(q, v, a) + J_E^T m_L (dv_E/dt - g): what drives and closures carry on the joints, (n,)."""
    load = structure.mechanism.tree.inverse_dynamics(q, v, a)
    return load + payload(structure.mechanism, q, v, a, mass) if structure.payload else load


def on_joints(u: ca.SX, at: list[int], n: int) -> ca.SX:
    """S_A^T u: the drives' forces on the joints (n,)."""
    result = ca.SX(n, 1)
    for i, joint in enumerate(at):
        result[joint] += u[i]
    return result


def dependent_columns(structure: Structure) -> ca.DM:
    """Columns of S_A^T that belong to the dependent drives, (n, delta)."""
    S = ca.DM(structure.mechanism.model.nq, len(structure.dependent))
    for column, i in enumerate(structure.dependent):
        S[structure.mechanism.actuated[i], column] = 1
    return S
