"""Programs of the vector machine, and pipelines of programs and linear systems, on arrays (rows, instants)."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import casadi as ca
import numpy as np

from pkmsea.bridge import _bridge
from pkmsea.errors import BridgeError


@lru_cache(maxsize=512)
def program(function: ca.Function, uniform: tuple[str, ...] = ()) -> _bridge.Program:
    """The instructions of an SX Function; `uniform` are names that inputs may have which are the same at all instants.

    Values are those of `Function.map` to the last bit, but for sin, cos and exp, which are within 2 ulp of libm's.

    Raises
    ------
    BridgeError : the Function is no SX Function, or has an instruction that the machine does not know.
    """
    try:
        return _bridge.Program(function.serialize(), [name in uniform for name in function.name_in()])
    except _bridge.UnknownInstruction as error:
        raise BridgeError(
            f"This Function cannot run on the vector machine: {error}.",
            "Write it with CasADi's elementary operations on SX.",
            key=function.name(),
        ) from None


class Pipeline:
    """Steps that run one after the other at all k instants: programs, factorisations and solves of small systems.

    The arrays that are handed over stay; a run reads and overwrites them.
    """

    def __init__(self, instants: int, lanes: str = "") -> None:
        """`lanes` names an instruction set (`pkmsea.bridge.lanes()`); by default the widest that can be used."""
        self.instants = instants
        self._steps = _bridge.Pipeline(instants, lanes)

    def call(self, function: _bridge.Program, inputs: Sequence[np.ndarray], outputs: Sequence[np.ndarray]) -> None:
        """Evaluate a program: arrays (nonzeros, k), or (nonzeros,) of a uniform input, in and out."""
        self._steps.call(function, list(inputs), list(outputs))

    def factor(self, matrix: np.ndarray) -> Factors:
        """P A = L U by rows with partial pivoting, of matrices A (n n, k), columns one after the other; in place."""
        n = round(matrix.shape[0] ** 0.5)
        factors = Factors(matrix, np.zeros((n, self.instants)), np.zeros(self.instants))
        self._steps.factor(n, matrix, factors.pivots, factors.sign)
        return factors

    def solve(self, factors: Factors, right: np.ndarray, transposed: bool = False) -> None:
        """A x = b, or A^T x = b, for right-hand sides (n columns, k), in place."""
        n = factors.pivots.shape[0]
        if right.shape[0]:
            self._steps.solve(n, right.shape[0] // n, transposed, factors.matrix, factors.pivots, right)

    def run(self, threads: int = 1) -> None:
        """Do all steps at all instants."""
        self._steps.run(threads)

    def newton(
        self, unknowns: np.ndarray, step: np.ndarray, gap: np.ndarray, *, longest: float, near: float, iterations: int
    ) -> bool:
        """Add `step`, which a run computes, to the unknowns until |gap| was below `near` before the last one.

        False where a step is as long as `longest` anywhere (or no number), or after so many iterations.
        """
        return bool(self._steps.newton(unknowns, step, gap, longest, near, iterations, 1))


class Factors:
    """Factors of matrices (n n, k) with their pivots (n, k) and the sign of their determinants (k,), 0 if singular."""

    def __init__(self, matrix: np.ndarray, pivots: np.ndarray, sign: np.ndarray) -> None:
        self.matrix, self.pivots, self.sign = matrix, pivots, sign
