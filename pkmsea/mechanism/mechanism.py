"""A mechanism: a tree with closed loops, in minimal coordinates, as named CasADi Functions and numpy calls."""

from __future__ import annotations

import pickle
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from pathlib import Path
from typing import Any, Literal
from weakref import WeakValueDictionary

import casadi as ca
import numpy as np
import pinocchio as pin

from pkmsea.bridge import TreeFunctions
from pkmsea.errors import one_line
from pkmsea.mechanism import pose
from pkmsea.mechanism.sidecar import Sidecar

ActuationClass = Literal["fully actuated", "redundantly actuated", "underactuated"]


@dataclass(frozen=True)
class Origin:
    """Where a mechanism comes from.

    Attributes
    ----------
    tree, file : the file of links and joints; the sidecar, None where there is none.
    conventions : in which it is written.
    proposed : keys of the sidecar that no file says, and that were guessed or found.
    notes : what was changed or left out in cleaning.
    conditioning : of the independent coordinates at generic closed poses, 0 (useless) to 1.
    """

    tree: Path
    file: Path | None
    conventions: tuple[str, ...]
    proposed: tuple[str, ...]
    notes: tuple[str, ...]
    conditioning: float


@dataclass(frozen=True, eq=False, repr=False)
class Mechanism:
    """A mechanism without its drives: M(q) a_ind + g(q, v_ind) = H_A^T u (paper, section 4.1.1).

    All joint coordinates q have n entries, the minimal coordinates q_A,ind have delta, the drives' joints q_A have m.
    Revolute coordinates are in rad, prismatic ones in m; forces follow in N m and N. Copies of one mechanism that come
    into a process are one object there, so that what is built for it, and kept by it, is built once.

    Attributes
    ----------
    name, folder, sidecar, model : where it comes from, and the tree as Pinocchio has it.
    urdf : the cleaned URDF text, for the views.
    functions : named casadi.Functions, see `pkmsea.mechanism.assemble`.
    tree : Pinocchio's Functions of the open tree.
    seed : a closed pose on the declared assembly mode (n,).
    mobility : delta, from the rank of the closure Jacobian at closed, generic poses.
    origin : its files, and what they left open.
    """

    name: str
    folder: Path
    sidecar: Sidecar
    model: pin.Model
    urdf: str
    tree: TreeFunctions
    functions: dict[str, ca.Function]
    seed: np.ndarray
    mobility: int
    origin: Origin

    def __reduce__(self) -> tuple[Any, ...]:
        return shared, (self._pickled,)

    @cached_property
    def _pickled(self) -> bytes:
        content = zlib.compress(pickle.dumps([getattr(self, field.name) for field in fields(self)]), 1)
        _known.setdefault(content, self)
        return content

    def __repr__(self) -> str:
        counts = f"{len(self.joints)} joints, mobility {self.mobility}, {len(self.actuated)} drives"
        return one_line(f"<Mechanism '{self.name}': {counts}, {self.actuation_class}>")

    @property
    def joints(self) -> list[str]:
        """Names of all joints, in the order of q (n)."""
        return list(self.model.names)[1:]

    @cached_property
    def actuated(self) -> list[int]:
        """Index into q of each drive's joint (m); one joint may carry several drives."""
        return [self.joints.index(name) for name in self.sidecar.actuated]

    @cached_property
    def independent(self) -> list[int]:
        """Index into q of each minimal coordinate (delta)."""
        return [self.joints.index(name) for name in self.sidecar.independent]

    @cached_property
    def revolute(self) -> list[bool]:
        """Whether each joint turns (n); the others slide."""
        return [not joint.shortname().startswith("JointModelP") for joint in list(self.model.joints)[1:]]

    @property
    def actuation_class(self) -> ActuationClass:
        """Compares the number m of drives with the mobility delta (paper, definition 1)."""
        m = len(self.actuated)
        if m == self.mobility:
            return "fully actuated"
        return "redundantly actuated" if m > self.mobility else "underactuated"

    def configuration(self, point: Sequence[float] | np.ndarray) -> np.ndarray:
        """All joints q (n,) with the end effector at a task-space point [m], on the declared assembly mode.

        The point is approached from the seed along a straight line, in steps that shrink where the pose turns
        quickly; the sign of det [G; J_E] may not change, so the branch never switches silently.

        Raises
        ------
        Unreachable : names the farthest point that was reached.
        """
        return pose.follow(self, np.atleast_1d(np.asarray(point, float)))

    def end_effector(self, q: np.ndarray) -> np.ndarray:
        """r_E(q) [m], along the declared axes."""
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

    def singularity(self, q: np.ndarray) -> tuple[float, float]:
        """Distance to singularities of both types, in [0, 1]; zero at one.

        Inverse-kinematic (type 1, at the workspace's border): reciprocal condition number of [G; J_E].
        Direct-kinematic (type 2, the drives lose the end effector): that of [G; S_A], where S_A picks the drives'
        joints. (Gosselin and Angeles, 1990)
        """
        inverse, direct = pose.singularity(self, q[None])
        return float(inverse[0]), float(direct[0])

    def _call(self, function: str, *arguments: np.ndarray) -> np.ndarray:
        return np.array(self.functions[function](*arguments))


_known: WeakValueDictionary[bytes, Mechanism] = WeakValueDictionary()  # by pickled content


def shared(content: bytes) -> Mechanism:
    """The mechanism of this pickled content: the one that this process has already, or a new one."""
    mechanism = _known.get(content)
    if mechanism is None:
        mechanism = Mechanism(*pickle.loads(zlib.decompress(content)))
        mechanism.__dict__["_pickled"] = content
        _known[content] = mechanism
    return mechanism
