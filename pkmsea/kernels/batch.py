"""One CasADi Function at many instants at once, on NumPy arrays."""

from __future__ import annotations

import casadi as ca
import numpy as np

from pkmsea.kernels.program import Pipeline, program


class Batch:
    """Evaluates an SX Function whose inputs are columns at k instants: arrays (k, size) in, arrays (k, ...) out.

    Outputs that are columns come back as (k, rows), the others as matrices (k, rows, columns). An input may also be
    given as one row for all instants.
    """

    def __init__(self, function: ca.Function, k: int, threads: int = 1) -> None:
        self._function, self._threads = function, threads
        self._inputs = [np.zeros((function.numel_in(i), k)) for i in range(function.n_in())]
        outputs, self._results = [], []
        for i in range(function.n_out()):
            rows, columns = function.size_out(i)
            if function.nnz_out(i) != rows * columns:
                raise ValueError(f"output {i} of {function.name()} is sparse; densify it")
            output = np.zeros((rows * columns, k))
            outputs.append(output)
            matrix = output.reshape(columns, rows, k).transpose(2, 1, 0)
            self._results.append(output.T if columns == 1 else matrix)
        self._pipeline = Pipeline(k)
        self._pipeline.call(program(function), self._inputs, outputs)

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """The outputs, overwritten by the next call."""
        for own, given in zip(self._inputs, arguments, strict=True):
            own.T[...] = given
        self._pipeline.run(self._threads)
        return self._results

    def single(self) -> Batch:
        """The same Function at one instant."""
        return Batch(self._function, 1)
