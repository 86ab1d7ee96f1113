"""Torques, speeds and the cost's rate at all instants of a grid, with derivatives in z."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pkmsea.actuation import Actuation
from pkmsea.actuation.cost import Cost
from pkmsea.actuation.signals import signal_functions
from pkmsea.kernels import Pipeline, program

UNIFORM = ("r", "eps", "factor")


class SignalsOnGrid:
    """The Functions of `pkmsea.actuation.signals` on an array z (rows, instants) that somebody else fills.

    All results are overwritten by the next call.

    Attributes
    ----------
    tau, v_M, joints : motor torques and speeds (m, instants) and the limited motions of joints, after `evaluate`.
    """

    def __init__(self, actuation: Actuation, cost: Cost, z: np.ndarray, joints: int, columns: Sequence[int]) -> None:
        """Signals are those of all drives and of so many joints' motions; `columns` are the constrained ones."""
        functions, rows, count = signal_functions(actuation.structure, cost, joints), z.shape[0], z.shape[1]
        self._actuation, self._cost, self._columns = actuation, cost, list(columns)
        signals = 2 * actuation.m + joints
        self._eps, self._factor = np.zeros(1), np.zeros(1)
        self._rate, self._h = np.zeros((1, count)), np.zeros((signals, count))
        self.tau, self.v_M, self.joints = np.split(self._h, (actuation.m, 2 * actuation.m))
        self._mu, self._slope = np.zeros((signals, count)), np.zeros((rows, count))
        self._J, self._Q = np.zeros((signals * rows, count)), np.zeros((rows * rows, count))
        given = [z, actuation.r]
        weights = [*given, self._eps, self._factor, self._mu]
        calls = (
            (functions.value, [*given, self._eps], [self._rate, self._h]),
            (functions.slope, weights, [self._slope]),
            (functions.jacobian, given, [self._J]),
            (functions.curvature, weights, [self._Q]),
        )
        self._run_value, self._run_slope, self._run_jacobian, self._run_curvature = (Pipeline(count) for _ in calls)
        runs = (self._run_value, self._run_slope, self._run_jacobian, self._run_curvature)
        for run, (function, inputs, outputs) in zip(runs, calls, strict=True):
            run.call(program(function, UNIFORM), inputs, outputs)

    def rate(self, eps: float) -> np.ndarray:
        """The cost's rate, smoothed by eps, (instants,)."""
        self._eps[0] = eps
        self._run_value.run()
        return self._rate[0]

    def evaluate(self) -> None:
        """Make `tau`, `v_M` and `joints` those of z."""
        self._run_value.run()

    def constrained(self) -> np.ndarray:
        """The constrained signals, (instants, columns)."""
        self._run_value.run()
        return self._h[self._columns].T

    def exact(self) -> np.ndarray:
        """The cost's exact rate, (instants,)."""
        self._run_value.run()
        return np.asarray(self._cost.exact(self.tau, self.v_M, self._actuation.each))

    def slope(self, eps: float, factor: float, mu: np.ndarray | None = None) -> np.ndarray:
        """Gradient of factor * rate + mu^T (constrained signals) in z, (z, instants)."""
        self._eps[0], self._factor[0] = eps, factor
        self._mu[...] = 0.0
        if mu is not None:
            np.add.at(self._mu, self._columns, mu)
        self._run_slope.run()
        return self._slope

    def jacobian(self) -> np.ndarray:
        """d(constrained signals)/dz, (columns z, instants), columns one after the other."""
        self._run_jacobian.run()
        by_column = self._J.reshape(self._slope.shape[0], self._h.shape[0], -1)[:, self._columns]
        return np.ascontiguousarray(by_column.reshape(-1, by_column.shape[-1]))

    def curvature(self) -> np.ndarray:
        """Hessian of what `slope` was asked for last, (z z, instants)."""
        self._run_curvature.run()
        return self._Q
