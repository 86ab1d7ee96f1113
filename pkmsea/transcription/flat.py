"""The default transcription: flat outputs in a coarse basis, everything else on a finer grid, exact derivatives.

The NLP's variables are the coefficients of the flat output and the robot's parameters (ln c) only; the equations of
motion hold at every iterate, so there is nothing to be infeasible but windows and limits, and nothing to be exploited
between the knots. The objective is the integral over the grid of the cost's rate (`pkmsea.actuation.cost`), smoothed
by eps, which is sharpened in steps.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from pkmsea.actuation.cost import SHARPENING
from pkmsea.motion import Basis
from pkmsea.problem import Bound, Problem
from pkmsea.transcription.nlp import Callback, Nlp, Variable
from pkmsea.transcription.pattern import Pattern
from pkmsea.transcription.robot import RobotOnGrid
from pkmsea.transcription.signals import SignalsOnGrid
from pkmsea.transcription.windows import LinearRows, linear_rows

SMALLEST_SPREAD = 1e-6  # [rad, m, N m, N]; keeps a scale positive where nothing moves
DRIVES = ("tau", "speed")
JOINTS = ("q", "dq", "ddq")
# typical change of a coefficient relative to that of a parameter (1), found by trial: IPOPT regularises by scale
PATH_SCALE, FREE_SCALE = 0.03, 0.3  # of the operating points' span, and of the spread of a free drive's coordinate


class FlatNlp:
    """Values and derivatives of the NLP; `nlp` wraps them for the solver."""

    def __init__(self, problem: Problem, basis: Basis, samples: int, limited: tuple[Bound, ...]) -> None:
        self.problem, self.basis = problem, basis
        self.weight = basis.period / samples
        self.limited = [bound for bound in limited if not bound.of_end_effector]
        m, n = problem.actuation.m, problem.actuation.mechanism.model.nq
        motions = {self._motion(bound, n) for bound in self.limited if bound.quantity in JOINTS}
        joints = sorted(motions)
        self._columns = [
            2 * m + joints.index(self._motion(bound, n))
            if bound.quantity in JOINTS
            else m * DRIVES.index(bound.quantity) + bound.index
            for bound in self.limited
        ]
        self.robot = RobotOnGrid(problem.actuation, basis, samples, joints)
        self._signals = SignalsOnGrid(problem.actuation, problem.cost, self.robot.z, len(joints), self._columns)
        self.rows: LinearRows = linear_rows(problem, basis, samples, self.robot.size)
        self._pattern = Pattern(self.robot, self.rows, len(self._columns))

    @staticmethod
    def _motion(bound: Bound, n: int) -> int:
        """Index into (q, v, a) of all n joints of what a bound limits."""
        return n * JOINTS.index(bound.quantity) + bound.index

    def signal(self, x: np.ndarray, bound: Bound) -> np.ndarray:
        """What a bound limits, at all samples."""
        if bound.of_end_effector:
            coefficients = self.robot.split(x)[0][:, bound.index]
            return np.asarray(self.basis.matrix(self.robot.t, bound.order) @ coefficients)
        self.robot.at(x)
        if bound.quantity in JOINTS:
            return self.robot.instants.xi[self._motion(bound, self.robot.n)]
        self._signals.evaluate()
        return {"tau": self._signals.tau, "speed": self._signals.v_M}[bound.quantity][bound.index]

    def claimed(self, x: np.ndarray) -> float:
        """The transcription's own value of the cost, without smoothing."""
        self.robot.at(x)
        return self.problem.cost.value(self._signals.exact(), self.weight)

    def objective(self, x: np.ndarray, eps: float) -> float:
        """Integral of the smoothed rate."""
        self.robot.at(x)
        return float(self.weight * self._signals.rate(eps).sum())

    def constraints(self, x: np.ndarray) -> np.ndarray:
        """Windows and end-effector limits (linear), then limited signals sample by sample."""
        self.robot.at(x)
        limited = self._signals.constrained() if self._columns else np.zeros(0)
        return np.concatenate([self.rows.matrix @ x, limited.ravel()])

    def gradient(self, x: np.ndarray, eps: float) -> np.ndarray:
        """Gradient of the objective."""
        self.robot.at(x)
        return self.robot.gradient(self._signals.slope(eps, self.weight))

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Nonzeros of the constraints' Jacobian, in CasADi's order."""
        nonlinear = np.zeros(0)
        if self._columns:
            self.robot.at(x)
            nonlinear = self.robot.jacobian(self._signals.jacobian())
        return self._pattern.jacobian_values(nonlinear)

    def hessian(self, x: np.ndarray, eps: float, factor: float, multipliers: np.ndarray) -> np.ndarray:
        """Nonzeros of the upper triangle of the Lagrangian's Hessian."""
        self.robot.at(x)
        weights = multipliers[self.rows.matrix.shape[0] :].reshape(self.robot.samples, -1).T
        slope = self._signals.slope(eps, factor * self.weight, weights)
        Q = self._signals.curvature()
        return self.robot.hessian(slope, Q, self._pattern.slots, self._pattern.nonzeros)

    @property
    def bounds(self) -> list[Bound]:
        """All limits that the NLP holds, in the order of their rows."""
        return [*(bound for bound, _ in self.rows.limits), *self.limited]

    def nlp(self, guess: np.ndarray, room: Sequence[np.ndarray]) -> Nlp:
        """The NLP around a first trajectory, whose poses are found by continuation.

        `room` is what signals need between the samples, below and above, of each of the `bounds` (2, samples).
        """
        self.robot.start(guess)
        variables = self._variables(guess)
        pattern, rows = self._pattern, self._pattern.rows
        one, g = ca.Sparsity.dense(1), ("g", ca.Sparsity.dense(rows))
        given = [("x", ca.Sparsity.dense(self.robot.size)), ("p", one)]
        multipliers = [("lam_f", one), ("lam_g", ca.Sparsity.dense(rows))]

        def value(a, r):
            if r[0] is not None:
                r[0][0] = self.objective(a[0], a[1][0])

        def values(a, r):
            value(a, r)
            if r[1] is not None:
                r[1][:] = self.constraints(a[0])

        def slopes(a, r):
            value(a, r)
            if r[1] is not None:
                r[1][:] = self.gradient(a[0], a[1][0])

        def rates(a, r):
            if r[0] is not None:
                r[0][:] = self.constraints(a[0])
            if r[1] is not None:
                r[1][:] = self.jacobian(a[0])

        def second(a, r):
            on_g = a[3] if a[3] is not None else np.zeros(rows)
            r[0][:] = self.hessian(a[0], a[1][0], a[2][0], on_g)

        f = ("f", one)
        oracle = Callback("nlp", given, [f, g], values)
        derivatives = {
            "grad_f": Callback("nlp_grad_f", given, [f, ("grad_f_x", given[0][1])], slopes),
            "jac_g": Callback("nlp_jac_g", given, [g, ("jac_g_x", pattern.jacobian)], rates),
            "hess_lag": Callback(
                "nlp_hess_l", [*given, *multipliers], [("triu_hess_gamma_x_x", pattern.hessian)], second
            ),
        }
        lower, upper = self._boxes(room)
        return Nlp(variables, lower, upper, oracle, len(SHARPENING), self._sharpen, derivatives, self)

    def _boxes(self, room: Sequence[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper sides of the constraints."""
        lower, upper = self.rows.lower.copy(), self.rows.upper.copy()
        boxes = [(bound.lower - low, bound.upper - high) for bound, (low, high) in zip(self.bounds, room, strict=True)]
        linear = len(self.rows.limits)
        for (_, at), (low, high) in zip(self.rows.limits, boxes[:linear], strict=True):
            lower[at], upper[at] = low, high
        if not self.limited:
            return lower, upper
        low, high = np.array(boxes[linear:]).transpose(1, 2, 0)  # sample by sample, as the constraints are
        return np.concatenate([lower, low.ravel()]), np.concatenate([upper, high.ravel()])

    def _sharpen(self, step: int, x: np.ndarray) -> np.ndarray:
        return np.array([self.problem.cost.smoothing(step, self.claimed(x), self.basis.period)])

    def _variables(self, guess: np.ndarray) -> tuple[Variable, ...]:
        coefficients, p = self.robot.split(guess)
        actuation, free = self.problem.actuation, np.full(self.basis.size, np.inf)
        result = []
        for j, name in enumerate(actuation.flat_outputs):
            column = coefficients[:, j]
            if j < self.robot.delta:
                scale = PATH_SCALE * self.problem.span[j]
            else:
                scale = FREE_SCALE * max(float(np.ptp(column)), SMALLEST_SPREAD)
            result.append(Variable(name, -free, free, np.full(self.basis.size, scale), column))
        for j, parameter in enumerate(actuation.parameters):
            low, high = (np.array([bound]) for bound in parameter.bounds)
            result.append(Variable(parameter.name, low, high, np.ones(1), p[j : j + 1]))
        return tuple(result)
