"""How well rates determine a motion, without units: lengths are divided by the mechanism's characteristic length."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
import pinocchio as pin

from pkmsea.bridge import frame_id
from pkmsea.description import Closure, Description

OPENING = 0.1  # of L: a loop that opens at this rate counts as much as a joint that turns at 1 rad/s
WORLD = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED


def characteristic_length(model: pin.Model, frames: Iterable[str]) -> float:
    """L [m], that of the longest link: the largest distance on one link between two of its joints and of `frames`.

    It depends neither on the pose nor on where loops are opened. 1 where all distances are zero.
    """
    points: dict[int, list[np.ndarray]] = {i: [np.zeros(3)] if i else [] for i in range(model.njoints)}
    for i in range(1, model.njoints):
        points[model.parents[i]].append(model.jointPlacements[i].translation)
    for name in frames:
        frame = model.frames[frame_id(model, name)]
        points[frame.parentJoint].append(frame.placement.translation)
    lengths = [float(np.linalg.norm(a - b)) for on in points.values() for a, b in combinations(on, 2)]
    return max(lengths, default=0.0) or 1.0


def turning(model: pin.Model) -> np.ndarray:
    """Whether each joint turns (n,); the others slide."""
    return np.array([not joint.shortname().startswith("JointModelP") for joint in list(model.joints)[1:]])


def reciprocal_condition(matrix: np.ndarray) -> float:
    """Smallest over largest singular value, (a, b) with a >= b or a <= b; zero for a zero matrix."""
    sigma = np.linalg.svd(matrix, compute_uv=False)
    return float(sigma[-1] / max(sigma[0], np.finfo(float).tiny))


@dataclass(frozen=True, eq=False)
class Conditioning:
    """How well rates follow the motion of a closed tree, from 0 (not at all) to 1; n joints, c opened ones.

    Of all rates x of the joints with |x| = 1, those at which loops are opened included, the least

        sqrt(|R x|^2 + |K(q) x|^2 / OPENING^2)

    where R x are the rates in question and K x those at which the loops open. Without units: rates of sliders count in
    L/s, velocities of points and openings in L/s, a coupling's row has length 1. So it is the same for a mechanism of
    any size, and wherever its loops are opened: a closure by points leaves three turns free (one about the normal of a
    declared plane), a revolute one its turn, a frame none. It is zero where a motion is possible in which R x vanishes.

    Attributes
    ----------
    length : L, the characteristic length [m].
    """

    model: pin.Model
    description: Description
    length: float

    @cached_property
    def data(self) -> pin.Data:
        return self.model.createData()

    @cached_property
    def units(self) -> np.ndarray:
        """What each joint's coordinate is divided by (n,): 1 rad, or L."""
        return np.where(turning(self.model), 1.0, self.length)

    @cached_property
    def joints(self) -> list[str]:
        return list(self.model.names)[1:]

    def loops(self, q: np.ndarray) -> np.ndarray:
        """K(q), (rows, n + c), dependent rows included."""
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        parts = [self._closure(closure) for closure in self.description.closures]
        free = [part.shape[1] for _, part in parts]
        rows = [np.hstack([J, *self._beside(free, k, turns)]) for k, (J, turns) in enumerate(parts)]
        coupled = np.zeros((len(self.description.couplings), self.model.nq + sum(free)))
        for row, coupling in zip(coupled, self.description.couplings, strict=True):
            i, j = (self.joints.index(name) for name in (coupling.joint, coupling.of))
            row[i], row[j] = self.units[i], -coupling.ratio * self.units[j]
            row /= np.linalg.norm(row)
        return np.vstack([*rows, coupled])

    def of_point(self, q: np.ndarray, frame: str, axes: Sequence[int]) -> float:
        """Of the velocity of a frame's origin along world axes."""
        K = self.loops(q)
        return self._least(K, self._jacobian(frame)[list(axes)] / self.length)

    def of_joints(self, q: np.ndarray, joints: Sequence[int]) -> float:
        """Of the rates of some joints."""
        return self._least(self.loops(q), np.eye(self.model.nq)[list(joints)])

    def _least(self, K: np.ndarray, R: np.ndarray) -> float:
        wide = np.hstack([R, np.zeros((len(R), K.shape[1] - R.shape[1]))])
        matrix = np.vstack([K / OPENING, wide])
        if len(matrix) < matrix.shape[1]:
            return 0.0
        return min(float(np.linalg.svd(matrix, compute_uv=False)[-1]), 1.0)

    def _jacobian(self, frame: str) -> np.ndarray:
        """Velocities of a frame for unitless rates, (6, n), at the pose of `data`."""
        J = pin.getFrameJacobian(self.model, self.data, frame_id(self.model, frame), WORLD)
        return J.reshape(6, -1) * self.units

    def _closure(self, closure: Closure) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the joints, and of the turns that are left free at the opening."""
        first, second = closure.frames
        J = self._jacobian(second) - self._jacobian(first)
        J[:3] /= self.length
        R1 = self.data.oMf[frame_id(self.model, first)].rotation
        axis = R1 @ np.asarray(closure.axis) / np.linalg.norm(closure.axis)
        free = {"point": np.eye(3), "revolute": axis[:, None], "frame": np.zeros((3, 0))}[closure.type]
        if self.description.plane is not None:
            normal = np.asarray(self.description.plane.normal)[:, None] / np.linalg.norm(self.description.plane.normal)
            J[:3] -= normal @ (normal.T @ J[:3])
            free = free[:, :0] if closure.type == "frame" else normal
        return J, np.vstack([np.zeros_like(free), -free])

    @staticmethod
    def _beside(free: list[int], k: int, turns: np.ndarray) -> list[np.ndarray]:
        return [turns if j == k else np.zeros((len(turns), count)) for j, count in enumerate(free)]
