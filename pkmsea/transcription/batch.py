"""One CasADi Function at many instants at once, on NumPy arrays without copies."""

from __future__ import annotations

import casadi as ca
import numpy as np

from pkmsea.mechanism import Mechanism, pose


class Batch:
    """Evaluates a Function whose inputs are columns at k instants: arrays (k, size) in, arrays (k, ...) out.

    `vectors` names the outputs that come back as (k, rows); the others are matrices (k, rows, columns).
    """

    def __init__(self, function: ca.Function, k: int, vectors: tuple[str, ...] = ()) -> None:
        self._is_vector = [name in vectors for name in function.name_out()]
        mapped = function.map(k)
        self._buffer, self._evaluate = mapped.buffer()
        self._inputs = [np.zeros((k, function.size1_in(i))) for i in range(function.n_in())]
        self._outputs = []
        for i, x in enumerate(self._inputs):
            self._buffer.set_arg(i, x.data if x.size else np.zeros(1).data)
        for i in range(function.n_out()):
            rows, columns = function.size_out(i)
            if function.sparsity_out(i).nnz() != rows * columns:
                raise ValueError(f"output {i} of {function.name()} is sparse; densify it")
            # CasADi stores columns one after the other: (k, columns, rows) in NumPy's order
            self._outputs.append(np.zeros((k, columns, rows)))
            self._buffer.set_res(i, self._outputs[-1].data if rows * columns else np.zeros(1).data)

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """The outputs, overwritten by the next call."""
        for own, given in zip(self._inputs, arguments, strict=True):
            own[...] = given
        self._evaluate()
        pairs = zip(self._outputs, self._is_vector, strict=True)
        return [x[:, 0, :] if vector else x.transpose(0, 2, 1) for x, vector in pairs]


NEWTON_STEP = 0.5  # largest step of a joint [rad, m]; a longer one may leave the branch
NEWTON_TOLERANCE = 1e-12  # [m]
NEWTON_ITERATIONS = 12
STRIDES = (8, 1)  # of the continuation along a path; the second one where points lie far apart


def close_poses(system: Batch, q: np.ndarray, targets: np.ndarray) -> np.ndarray | None:
    """Solve Psi(q) = [0; target] at all instants at once, near q (k, n); None where a step would be too long.

    `system` is the Batch of `pkmsea.mechanism.pose.task_system`, with Psi as a vector.
    """
    goal = np.hstack([np.zeros((q.shape[0], q.shape[1] - targets.shape[1])), targets])
    for _ in range(NEWTON_ITERATIONS):
        Psi, A = system(q)
        gap = goal - Psi
        if np.abs(gap).max() < NEWTON_TOLERANCE:
            return q
        try:
            step = np.linalg.solve(A, gap[:, :, None])[..., 0]
        except np.linalg.LinAlgError:
            return None
        if not np.abs(step).max() < NEWTON_STEP:
            return None
        q = q + step
    return None


def poses_along(mechanism: Mechanism, system: Batch, targets: np.ndarray) -> np.ndarray:
    """Poses (k, n) along a path of the end effector: continuation from the seed in strides, then Newton for all.

    Raises
    ------
    FloatingPointError, Unreachable : the path leaves the workspace.
    """
    single = pose.task_system(mechanism)
    for stride in STRIDES:
        q = mechanism.configuration(targets[0])
        strided = []
        for target in targets[::stride]:
            following = pose.newton(single, q, target)
            q = mechanism.configuration(target) if following is None else following
            strided.append(q)
        poses = close_poses(system, np.repeat(strided, stride, axis=0)[: targets.shape[0]], targets)
        if poses is not None:
            return poses
    raise FloatingPointError("the path leaves the workspace")
