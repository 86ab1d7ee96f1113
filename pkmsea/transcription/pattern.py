"""Fixed sparsity patterns: cell blocks scattered into the nonzeros that the solver wants."""

from __future__ import annotations

import casadi as ca
import numpy as np

from pkmsea.transcription.robot import RobotOnGrid
from pkmsea.transcription.windows import LinearRows


class Pattern:
    """Fixed sparsity of Jacobian and Hessian, and the scatter of cell blocks into their nonzeros."""

    def __init__(self, robot: RobotOnGrid, rows: LinearRows, columns: list[int]) -> None:
        self._size, self._index = robot.size, robot.local
        self._own, self._columns = robot.cells.own, columns
        a, b = np.broadcast_arrays(robot.local[:, :, None], robot.local[:, None, :])
        upper = (a <= b).ravel()
        keys = (b.ravel()[upper].astype(np.int64) * self._size + a.ravel()[upper]).astype(np.int64)
        unique, self._slot = np.unique(keys, return_inverse=True)
        self._upper = upper
        self.hessian = _sparsity(self._size, self._size, unique % self._size, unique // self._size)
        self._hessian_nnz = unique.size

        linear = rows.matrix.tocoo()
        self._linear = linear.data
        first, count = rows.matrix.shape[0], len(columns)
        self.rows = first + robot.samples * count
        samples = self._own[:, :, None, None] * count + np.arange(count)[None, None, :, None]
        variables = robot.local[:, None, None, :]
        i, j = np.broadcast_arrays(first + samples, variables)
        all_rows = np.concatenate([linear.row, i.ravel()])
        all_columns = np.concatenate([linear.col, j.ravel()])
        self._order = np.lexsort((all_rows, all_columns))
        self.jacobian = _sparsity(self.rows, self._size, all_rows[self._order], all_columns[self._order])

    def scales(self, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Factors of the nonzeros of Jacobian and Hessian where each variable is divided by its scale."""
        row, column = (np.array(x) for x in self.hessian.get_triplet())
        return scale[np.array(self.jacobian.get_triplet()[1])], scale[row] * scale[column]

    def gather(self, weights: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """sum over samples and signals of weights * slope, scattered to x."""
        own = weights[self._own]
        local = (own.reshape(own.shape[0], 1, -1) @ slope.reshape(own.shape[0], -1, slope.shape[-1]))[:, 0]
        return np.bincount(self._index.ravel(), local.ravel(), self._size)

    def hessian_values(self, blocks: np.ndarray) -> np.ndarray:
        return np.bincount(self._slot, blocks.reshape(-1)[self._upper], self._hessian_nnz)

    def jacobian_values(self, slope: np.ndarray | None) -> np.ndarray:
        nonlinear = np.zeros(0) if slope is None else slope[:, :, self._columns, :].ravel()
        return np.asarray(np.concatenate([self._linear, nonlinear])[self._order])


def _sparsity(rows: int, columns: int, i: np.ndarray, j: np.ndarray) -> ca.Sparsity:
    """Compressed columns from entries that are sorted by column, then row."""
    starts = np.concatenate([[0], np.cumsum(np.bincount(j, minlength=columns))])
    return ca.Sparsity(rows, columns, [int(s) for s in starts], [int(r) for r in i])
