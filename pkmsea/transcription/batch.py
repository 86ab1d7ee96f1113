"""One CasADi Function at many instants at once, on NumPy arrays without copies."""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import casadi as ca
import numpy as np

from pkmsea.errors import Unreachable
from pkmsea.mechanism import Mechanism
from pkmsea.transcription.compiled import Kernel


class Batch:
    """Evaluates a Function whose inputs are columns at k instants: arrays (k, size) in, arrays (k, ...) out.

    Outputs that are columns come back as (k, rows), the others as matrices (k, rows, columns). With a kernel
    (`pkmsea.transcription.compiled`) it runs as machine code, else in CasADi's interpreter.
    """

    def __init__(self, function: ca.Function, k: int, kernel: Kernel | None = None) -> None:
        self._function, self._kernel = function, kernel
        self._inputs = [np.zeros((k, function.size1_in(i))) for i in range(function.n_in())]
        self._outputs, self._results = [], []
        for i in range(function.n_out()):
            rows, columns = function.size_out(i)
            if function.sparsity_out(i).nnz() != rows * columns:
                raise ValueError(f"output {i} of {function.name()} is sparse; densify it")
            # CasADi stores columns one after the other: (k, columns, rows) in NumPy's order
            output = np.zeros((k, columns, rows))
            self._outputs.append(output)
            self._results.append(output[:, 0, :] if columns == 1 else output.transpose(0, 2, 1))
        self._run = self._interpreted(function, k) if kernel is None else self._compiled(kernel, k)

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """The outputs, overwritten by the next call."""
        for own, given in zip(self._inputs, arguments, strict=True):
            own[...] = given
        self._run()
        return self._results

    def single(self) -> Batch:
        """The same function at one instant."""
        return Batch(self._function, 1, self._kernel)

    def _interpreted(self, function: ca.Function, k: int) -> Callable[[], None]:
        self._buffer, run = function.map(k).buffer()
        empty = np.zeros(1)
        for i, x in enumerate(self._inputs):
            self._buffer.set_arg(i, (x if x.size else empty).data)
        for i, x in enumerate(self._outputs):
            self._buffer.set_res(i, (x if x.size else empty).data)
        return run

    def _compiled(self, kernel: Kernel, k: int) -> Callable[[], None]:
        given, wanted = ((ctypes.c_void_p * len(x))(*(a.ctypes.data for a in x)) for x in (self._inputs, self._outputs))
        count = ctypes.c_long(k)
        return lambda: kernel(count, given, wanted)


NEWTON_STEP = 0.5  # largest step of a joint [rad, m]; a longer one may leave the branch
NEWTON_NEAR = 1e-8  # [m]; one more step squares it, down to rounding
NEWTON_ITERATIONS = 12
FOLLOWED = (64, 512)  # points of the continuation along a path; more where they lie too far apart; at last, all


def close_poses(pose_step: Batch, q: np.ndarray, targets: np.ndarray) -> np.ndarray | None:
    """Solve Psi(q) = [0; target] at all instants at once, near q (k, n); None where a step would be too long.

    `pose_step` is the Batch of `pkmsea.mechanism.pose.pose_step`.
    """
    for _ in range(NEWTON_ITERATIONS):
        step, gap = pose_step(q, targets)
        if not np.abs(step).max() < NEWTON_STEP:
            return None
        q = q + step
        if np.abs(gap).max() < NEWTON_NEAR:
            return q
    return None


def poses_along(mechanism: Mechanism, pose_step: Batch, targets: np.ndarray) -> np.ndarray:
    """Poses (k, n) along a closed path of the end effector: continuation in strides, then Newton for all at once.

    Raises
    ------
    FloatingPointError : the path leaves the workspace.
    """
    try:
        return _follow(mechanism, pose_step, targets)
    except Unreachable as error:
        raise FloatingPointError("the path leaves the workspace") from error


def _follow(mechanism: Mechanism, pose_step: Batch, targets: np.ndarray) -> np.ndarray:
    single, count = pose_step.single(), targets.shape[0]
    for stride in (*(max(count // points, 1) for points in FOLLOWED), 1):
        q = mechanism.configuration(targets[0])
        strided = []
        for target in targets[::stride]:
            following = close_poses(single, q[None], target[None])
            q = mechanism.configuration(target) if following is None else following[0]
            strided.append(q)
        poses = close_poses(pose_step, _between(np.array(strided), stride, count), targets)
        if poses is not None:
            return poses
    raise FloatingPointError("the path leaves the workspace")


def _between(strided: np.ndarray, stride: int, count: int) -> np.ndarray:
    """Linear interpolation of every `stride`-th pose on a periodic grid of `count` points."""
    following = np.roll(strided, -1, axis=0)
    last = count - (strided.shape[0] - 1) * stride  # grid steps from the last followed pose to the first
    share = np.arange(stride) / np.array([stride] * (strided.shape[0] - 1) + [last])[:, None]
    filled = strided[:, None] + share[:, :, None] * (following - strided)[:, None]
    return np.asarray(filled.reshape(-1, strided.shape[1])[:count])
