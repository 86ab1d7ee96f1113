"""Fixed sparsity of an NLP on cells: where blocks of a cell's local variables lie in Jacobian and Hessian."""

from __future__ import annotations

import casadi as ca
import numpy as np

from pkmsea.transcription.robot import RobotOnGrid
from pkmsea.transcription.windows import LinearRows


class Pattern:
    """Sparsity of Jacobian and Hessian, and the places of the cells' entries among their nonzeros.

    Attributes
    ----------
    slots : (cells, local, local), the nonzero of the Hessian's upper triangle that a pair of local variables adds to.
    nonzeros : of the Hessian.
    """

    def __init__(self, robot: RobotOnGrid, rows: LinearRows, limited: int) -> None:
        """`limited` signals are constrained at every sample, after the linear rows."""
        size, index = robot.size, robot.local
        a, b = np.broadcast_arrays(index[:, :, None], index[:, None, :])
        keys = np.maximum(a, b).astype(np.int64) * size + np.minimum(a, b)
        unique, slots = np.unique(keys, return_inverse=True)
        self.slots, self.nonzeros = slots.reshape(keys.shape).astype(np.int32), unique.size
        self.hessian = _sparsity(size, size, unique % size, unique // size)

        linear = rows.matrix.tocoo()
        self._linear = linear.data
        first = rows.matrix.shape[0]
        self.rows = first + robot.samples * limited
        samples = robot.cells.own[:, :, None, None] * limited + np.arange(limited)[None, None, :, None]
        i, j = np.broadcast_arrays(first + samples, index[:, None, None, :])
        all_rows = np.concatenate([linear.row, i.ravel()])
        all_columns = np.concatenate([linear.col, j.ravel()])
        self._order = np.lexsort((all_rows, all_columns))
        self.jacobian = _sparsity(self.rows, size, all_rows[self._order], all_columns[self._order])

    def jacobian_values(self, nonlinear: np.ndarray) -> np.ndarray:
        """Nonzeros of the Jacobian from the rows of the limited signals."""
        return np.asarray(np.concatenate([self._linear, nonlinear.ravel()])[self._order])


def _sparsity(rows: int, columns: int, i: np.ndarray, j: np.ndarray) -> ca.Sparsity:
    """Compressed columns from entries that are sorted by column, then row."""
    starts = np.concatenate([[0], np.cumsum(np.bincount(j, minlength=columns))])
    return ca.Sparsity(rows, columns, [int(s) for s in starts], [int(r) for r in i])
