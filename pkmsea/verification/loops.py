"""Loop closures and couplings in Pinocchio's doubles: residual, Jacobian and bias, redundant rows kept."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from pkmsea.bridge import frame_id
from pkmsea.description import Closure
from pkmsea.mechanism import Mechanism

WORLD = pin.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True, eq=False)
class Constraint:
    """At one state: residual Phi [m, rad], Jacobian G (rows, n) and bias dG/dt v (rows,)."""

    Phi: np.ndarray
    G: np.ndarray
    bias: np.ndarray


@dataclass(frozen=True, eq=False)
class Loops:
    """The constraints of a mechanism, as they stand in its sidecar:

        point      p_2 - p_1 = 0
        revolute   that, and no relative rotation across the common axis
        frame      that, and no relative rotation
        coupling   q_joint - ratio q_of - offset = 0

    Of a declared plane, only what is constant across it is used: links that lie in layers beside each other, and frames
    whose digits were rounded, do not open a loop. A `revolute` closure in a plane is a point. Rows across the plane are
    redundant and stay.
    """

    mechanism: Mechanism

    @cached_property
    def closures(self) -> list[tuple[Closure, int, int]]:
        """Each with its two frames."""
        model, closures = self.mechanism.model, self.mechanism.description.closures
        if self.mechanism.description.plane is not None:
            closures = tuple(c.model_copy(update={"type": "point"}) if c.type == "revolute" else c for c in closures)
        return [(c, frame_id(model, c.frames[0]), frame_id(model, c.frames[1])) for c in closures]

    @cached_property
    def layers(self) -> list[np.ndarray]:
        """Per closure, the part of its residual that lies across the declared plane at the seed, and does so always."""
        data, q = self.mechanism.model.createData(), self.mechanism.seed
        _update(self.mechanism.model, data, q, np.zeros(q.size))
        return [self._layer(data, *closure) for closure in self.closures]

    def _layer(self, data: pin.Data, closure: Closure, first: int, second: int) -> np.ndarray:
        Phi, plane = _closure(self.mechanism.model, data, closure, first, second).Phi, self.mechanism.description.plane
        if plane is None:
            return np.zeros_like(Phi)
        normal = np.asarray(plane.normal) / np.linalg.norm(plane.normal)
        around = data.oMf[first].rotation.T @ normal
        gap, turn = normal * (normal @ Phi[:3]), Phi[3:]
        return np.concatenate([gap, turn - around * (around @ turn)] if turn.size else [gap])

    @cached_property
    def coupled(self) -> Constraint:
        """The couplings; `Phi` holds the offsets: their residual is G q - Phi."""
        couplings, joints = self.mechanism.description.couplings, self.mechanism.joints
        G = np.zeros((len(couplings), len(joints)))
        for row, coupling in zip(G, couplings, strict=True):
            row[joints.index(coupling.joint)] = 1.0
            row[joints.index(coupling.of)] = -coupling.ratio
        return Constraint(np.array([c.offset for c in couplings]), G, np.zeros(len(couplings)))

    def at(self, data: pin.Data, q: np.ndarray, v: np.ndarray) -> Constraint:
        """All constraints at a state."""
        model, coupled = self.mechanism.model, self.coupled
        _update(model, data, q, v)
        parts = [Constraint(coupled.G @ q - coupled.Phi, coupled.G, coupled.bias)]
        parts += [_closure(model, data, *closure) for closure in self.closures]
        constant = [np.zeros_like(coupled.Phi), *self.layers]
        return Constraint(
            np.concatenate([part.Phi - layer for part, layer in zip(parts, constant, strict=True)]),
            np.vstack([part.G for part in parts]),
            np.concatenate([part.bias for part in parts]),
        )


def _update(model: pin.Model, data: pin.Data, q: np.ndarray, v: np.ndarray) -> None:
    pin.computeJointJacobians(model, data, q)
    pin.forwardKinematics(model, data, q, v, np.zeros(q.size))
    pin.updateFramePlacements(model, data)


def _closure(model: pin.Model, data: pin.Data, closure: Closure, first: int, second: int) -> Constraint:
    """One closure; Jacobian and bias of its rotations are those of the relative angular velocity w."""
    J = pin.getFrameJacobian(model, data, second, WORLD) - pin.getFrameJacobian(model, data, first, WORLD)
    drift = [pin.getFrameClassicalAcceleration(model, data, frame, WORLD).vector for frame in (first, second)]
    bias = drift[1] - drift[0]
    gap = data.oMf[second].translation - data.oMf[first].translation
    if closure.type == "point":
        return Constraint(gap, J[:3], bias[:3])
    R1, R2 = data.oMf[first].rotation, data.oMf[second].rotation
    if closure.type == "frame":
        return Constraint(np.concatenate([gap, pin.log3(R1.T @ R2)]), J, bias)
    axis = np.asarray(closure.axis) / np.linalg.norm(closure.axis)
    n, w_1 = R1 @ axis, pin.getFrameVelocity(model, data, first, WORLD).angular
    w = pin.getFrameVelocity(model, data, second, WORLD).angular - w_1
    across = np.eye(3) - np.outer(n, n)
    turning = across @ bias[3:] - (n @ w) * np.cross(w_1, n)  # d/dt of `across` turns with the first frame
    return Constraint(
        np.concatenate([gap, np.cross(n, R2 @ axis)]),
        np.vstack([J[:3], across @ J[3:]]),
        np.concatenate([bias[:3], turning]),
    )
