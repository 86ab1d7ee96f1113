"""A tree with its loops closed, in minimal coordinates: named CasADi Functions and numpy calls."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import casadi as ca
import numpy as np
import pinocchio as pin

from pkmsea.bridge import TreeFunctions
from pkmsea.description import CompleteDescription, JointLimits
from pkmsea.mechanism.conditioning import turning

TURN = 2 * np.pi  # [rad]

ActuationClass = Literal["fully actuated", "redundantly actuated", "underactuated"]


@dataclass(frozen=True, eq=False, repr=False)
class ClosedTree:
    """A mechanism without its drives: M(q) a_ind + g(q, v_ind) = H_A^T u (paper, section 4.1.1).

    All joint coordinates q have n entries, the minimal coordinates q_A,ind have delta, the drives' joints q_A have m.
    Revolute coordinates are in rad, prismatic ones in m; forces follow in N m and N.

    Attributes
    ----------
    description : the value that all of this follows from, complete.
    model : the open tree as Pinocchio has it.
    tree : Pinocchio's Functions of the open tree.
    functions : named casadi.Functions, see `pkmsea.mechanism.assemble`.
    seed : a closed pose on the declared assembly mode (n,).
    mobility : delta, from the rank of the closure Jacobian at closed, generic poses.
    length : its characteristic length [m], see `pkmsea.mechanism.conditioning`.
    """

    description: CompleteDescription
    model: pin.Model
    tree: TreeFunctions
    functions: dict[str, ca.Function]
    seed: np.ndarray
    mobility: int
    length: float

    @property
    def name(self) -> str:
        """Of the description."""
        return self.description.name

    @property
    def folder(self) -> Path:
        """Where its files lie."""
        return self.description.origin.folder

    @property
    def joints(self) -> list[str]:
        """Names of all joints, in the order of q (n)."""
        return list(self.model.names)[1:]

    @cached_property
    def actuated(self) -> list[int]:
        """Index into q of each drive's joint (m); one joint may carry several drives."""
        return [self.joints.index(name) for name in self.description.actuated]

    @cached_property
    def independent(self) -> list[int]:
        """Index into q of each minimal coordinate (delta)."""
        return [self.joints.index(name) for name in self.description.independent]

    @cached_property
    def revolute(self) -> list[bool]:
        """Whether each joint turns (n); the others slide."""
        return [bool(turns) for turns in turning(self.model)]

    @property
    def units(self) -> list[str]:
        """Of each joint's position (n)."""
        return ["rad" if turns else "m" for turns in self.revolute]

    @property
    def end_effector_units(self) -> list[str]:
        """Of each coordinate of r_E: m along axes, the joints' own where joints are followed."""
        units, follower = dict(zip(self.joints, self.units, strict=True)), self.description.end_effector
        return [units[name] for name in follower.joints] or ["m"] * len(follower.axes)

    @property
    def end_effector_unit(self) -> str:
        """That of all coordinates of r_E; 'rad, m' where they differ."""
        return ", ".join(dict.fromkeys(self.end_effector_units))

    @cached_property
    def turnable(self) -> list[bool]:
        """Whether a whole turn of each joint leaves the pose as it is (n): it turns, and is coupled to no other."""
        coupled = {name for c in self.description.couplings for name in (c.joint, c.of)}
        return [turns and name not in coupled for name, turns in zip(self.joints, self.revolute, strict=True)]

    def within(self, q: np.ndarray, ranges: np.ndarray) -> np.ndarray:
        """A path q (n, k), its joints turned by whole turns where that brings them nearer to their ranges (2, n)."""
        below, above = ranges[0] - q.min(axis=1), q.max(axis=1) - ranges[1]
        turns = np.where(above > 0, -np.ceil(above / TURN), np.where(below > 0, np.ceil(below / TURN), 0.0))
        turned = np.maximum(below - turns * TURN, above + turns * TURN)
        nearer = np.array(self.turnable) & (turned < np.maximum(below, above))
        return np.asarray(q + np.where(nearer, turns * TURN, 0.0)[:, None])

    @cached_property
    def limits(self) -> list[JointLimits]:
        """Of each joint (n)."""
        limits = self.description.limits
        return [limits[name] for name in self.joints]

    @property
    def actuation_class(self) -> ActuationClass:
        """Compares the number m of drives with the mobility delta (paper, definition 1)."""
        m = len(self.actuated)
        if m == self.mobility:
            return "fully actuated"
        return "redundantly actuated" if m > self.mobility else "underactuated"

    def end_effector(self, q: np.ndarray) -> np.ndarray:
        """r_E(q), along the declared axes [m], or of the declared joints [rad, m]."""
        return self._call("end_effector", q).ravel()

    def mass_matrix(self, q: np.ndarray) -> np.ndarray:
        """M(q) = H^T M_tree H, (delta, delta)."""
        return self._call("mass_matrix", q)

    def bias(self, q: np.ndarray, v_ind: np.ndarray) -> np.ndarray:
        """g(q, v_ind) = H^T rnea(q, H v_ind, dH/dt v_ind), (delta,): all forces but inertia's and the drives'."""
        return self._call("bias", q, v_ind).ravel()

    def velocity_map(self, q: np.ndarray) -> np.ndarray:
        """H(q), (n, delta), with v = H v_ind."""
        return self._call("velocity_map", q)

    def actuation_jacobian(self, q: np.ndarray) -> np.ndarray:
        """H_A(q), (m, delta), with v_A = H_A v_ind: the rows of H at the drives."""
        return self._call("actuation_jacobian", q)

    def closure_residual(self, q: np.ndarray) -> np.ndarray:
        """Phi(q), (n - delta,): zero where the loops are closed [m]."""
        return self._call("closure_residual", q).ravel()

    def _call(self, function: str, *arguments: np.ndarray) -> np.ndarray:
        return np.array(self.functions[function](*arguments))
