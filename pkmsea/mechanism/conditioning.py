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

    def of_point(self, q: np.ndarray, frame: str, axes: Sequence[int]) -> np.ndarray:
        """Of the velocity of a frame's origin along world axes, at poses q (k, n): (k,)."""
        return self.least(self.loops(q), self.point(q, frame, axes))

    def of_joints(self, q: np.ndarray, joints: Sequence[int]) -> np.ndarray:
        """Of the rates of some joints, at poses q (k, n): (k,)."""
        return self.least(self.loops(q), self.rates(joints))

    def point(self, q: np.ndarray, frame: str, axes: Sequence[int]) -> np.ndarray:
        """R of the velocity of a frame's origin along world axes, (k, axes, n)."""
        return self._at(q, [frame])[0][:, 0, list(axes)] / self.length

    def rates(self, joints: Sequence[int]) -> np.ndarray:
        """R of the rates of some joints, (joints, n)."""
        return np.eye(self.model.nq)[list(joints)]

    def least(self, K: np.ndarray, R: np.ndarray) -> np.ndarray:
        """The measure from K (k, rows, n + c) and R ([k,] rates, n): (k,)."""
        count, rows, columns = K.shape
        if rows + R.shape[-2] < columns:
            return np.zeros(count)
        matrix = np.zeros((count, rows + R.shape[-2], columns))
        matrix[:, :rows], matrix[:, rows:, : R.shape[-1]] = K / OPENING, R
        return np.minimum(np.linalg.svd(matrix, compute_uv=False)[:, -1], 1.0)

    def loops(self, q: np.ndarray) -> np.ndarray:
        """K at poses q (k, n), (k, rows, n + c), dependent rows included."""
        names = [name for closure in self.description.closures for name in closure.frames]
        J, R = self._at(q, names)
        parts = [
            self._closure(closure, J[:, 2 * i + 1] - J[:, 2 * i], R[:, 2 * i])
            for i, closure in enumerate(self.description.closures)
        ]
        free = np.cumsum([self.model.nq, *(turns.shape[-1] for _, turns in parts)])
        K = np.zeros((len(q), 6 * len(parts) + len(self.description.couplings), free[-1]))
        for i, (on_joints, turns) in enumerate(parts):
            rows = slice(6 * i, 6 * i + 6)
            K[:, rows, : self.model.nq], K[:, rows, free[i] : free[i + 1]] = on_joints, turns
        for row, coupling in enumerate(self.description.couplings, 6 * len(parts)):
            i, j = (self.joints.index(name) for name in (coupling.joint, coupling.of))
            pair = np.array([self.units[i], -coupling.ratio * self.units[j]])
            K[:, row, [i, j]] = pair / np.linalg.norm(pair)
        return K

    def _at(self, q: np.ndarray, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
        """Velocities of frames for unitless rates (k, frames, 6, n), and their orientations (k, frames, 3, 3)."""
        frames = [frame_id(self.model, name) for name in names]
        J = np.zeros((len(q), len(frames), 6, self.model.nq))
        R = np.zeros((len(q), len(frames), 3, 3))
        for k, pose in enumerate(q if frames else ()):
            pin.computeJointJacobians(self.model, self.data, pose)
            pin.updateFramePlacements(self.model, self.data)
            for f, frame in enumerate(frames):
                J[k, f] = pin.getFrameJacobian(self.model, self.data, frame, WORLD).reshape(6, -1)
                R[k, f] = self.data.oMf[frame].rotation
        return J * self.units, R

    def _closure(self, closure: Closure, J: np.ndarray, R1: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Rows of the joints (k, 6, n), and of the turns that are left free at the opening (k, 6, turns)."""
        J[:, :3] /= self.length
        axis = R1 @ (np.asarray(closure.axis) / np.linalg.norm(closure.axis))
        free = {
            "point": np.broadcast_to(np.eye(3), (len(J), 3, 3)),
            "revolute": axis[:, :, None],
            "frame": np.zeros((len(J), 3, 0)),
        }[closure.type]
        if self.description.plane is not None:
            normal = np.asarray(self.description.plane.normal)[:, None] / np.linalg.norm(self.description.plane.normal)
            J[:, :3] -= normal @ (normal.T @ J[:, :3])
            free = free[..., :0] if closure.type == "frame" else np.broadcast_to(normal, (len(J), 3, 1))
        return J, np.concatenate([np.zeros_like(free), -free], axis=1)
