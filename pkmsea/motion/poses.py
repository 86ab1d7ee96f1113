"""Poses of a closed mechanism at many instants at once: Newton's method, and continuation along a closed path."""

from __future__ import annotations

import numpy as np

from pkmsea.errors import Unreachable
from pkmsea.kernels import Pipeline, program
from pkmsea.mechanism import Mechanism, pose
from pkmsea.motion import turns

NEWTON_STEP = 0.5  # largest step of a joint [rad, m]; a longer one may leave the branch
NEWTON_NEAR = 1e-8  # [m]; one more step squares it, down to rounding
NEWTON_ITERATIONS = 12
FOLLOWED = (64, 512)  # points of the continuation along a path; more where they lie too far apart; at last, all


class Poses:
    """Solves Psi(q) = [0; y] at k instants at once, near given poses."""

    def __init__(self, mechanism: Mechanism, k: int) -> None:
        self.mechanism = mechanism
        n = mechanism.model.nq
        self._q, self._y = np.zeros((n, k)), np.zeros((mechanism.mobility, k))
        self._gap, self._step, matrix = np.zeros((n, k)), np.zeros((n, k)), np.zeros((n * n, k))
        self._pipeline = Pipeline(k)
        self._pipeline.call(program(pose.pose_gap(mechanism)), [self._q, self._y], [matrix, self._gap, self._step])
        self._pipeline.solve(self._pipeline.factor(matrix), self._step)

    def close(self, q: np.ndarray, y: np.ndarray) -> np.ndarray | None:
        """Poses (n, k) with the end effector at y (delta, k), from poses q near them; None where a step is too long."""
        self._q[...], self._y[...] = q, y
        found = self._pipeline.newton(
            self._q, self._step, self._gap, longest=NEWTON_STEP, near=NEWTON_NEAR, iterations=NEWTON_ITERATIONS
        )
        return self._q.copy() if found else None


def poses_along(poses: Poses, y: np.ndarray, ranges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses (n, k) along a closed path of the end effector, y (delta, k), and what the joints gain on it (n,).

    Continuation in strides, then Newton for all; joints are within their ranges (2, n) as far as whole turns do it.

    Raises
    ------
    FloatingPointError : the path leaves the workspace, or crosses a singularity.
    """
    try:
        q, gained = _follow(poses, y)
    except Unreachable as error:
        raise FloatingPointError("the path leaves the workspace") from error
    return poses.mechanism.within(q, ranges), gained


def _follow(poses: Poses, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    single, count, mechanism = Poses(poses.mechanism, 1), y.shape[1], poses.mechanism
    first = mechanism.configuration(y[:, 0])
    for stride in (*(max(count // points, 1) for points in FOLLOWED), 1):
        strided, done = [first], 1.0
        for target in (*y.T[stride::stride], y[:, 0]):
            following, q = single.close(strided[-1][:, None], target[:, None]), strided[-1]
            q, done = pose.walk(mechanism, q, target) if following is None else (following[:, 0], 1.0)
            if done < 1.0:
                break
            strided.append(q)
        found = poses.close(_between(np.array(strided), stride, count).T, y) if done == 1.0 else None
        if found is not None:
            return found, turns.gain(mechanism, first, strided[-1])
    raise FloatingPointError("the path leaves the workspace")


def _between(strided: np.ndarray, stride: int, count: int) -> np.ndarray:
    """Linear interpolation of every `stride`-th pose on a grid of `count` points, which the last pose closes."""
    last = count - (strided.shape[0] - 2) * stride  # grid steps from the last but one to the last
    share = np.arange(stride) / np.array([stride] * (strided.shape[0] - 2) + [last])[:, None]
    filled = strided[:-1, None] + share[:, :, None] * np.diff(strided, axis=0)[:, None]
    return np.asarray(filled.reshape(-1, strided.shape[1])[:count])
