"""One CasADi Function at many instants at once, on NumPy arrays without copies."""

from __future__ import annotations

import casadi as ca
import numpy as np


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
            self._buffer.set_arg(i, memoryview(x) if x.size else memoryview(np.zeros(1)))
        for i in range(function.n_out()):
            rows, columns = function.size_out(i)
            if function.sparsity_out(i).nnz() != rows * columns:
                raise ValueError(f"output {i} of {function.name()} is sparse; densify it")
            # CasADi stores columns one after the other: (k, columns, rows) in NumPy's order
            self._outputs.append(np.zeros((k, columns, rows)))
            self._buffer.set_res(i, memoryview(self._outputs[-1]) if rows * columns else memoryview(np.zeros(1)))

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """The outputs, overwritten by the next call."""
        for own, given in zip(self._inputs, arguments, strict=True):
            own[...] = given
        self._evaluate()
        pairs = zip(self._outputs, self._is_vector, strict=True)
        return [x[:, 0, :] if vector else x.transpose(0, 2, 1) for x, vector in pairs]
