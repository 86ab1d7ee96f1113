"""The default transcription: flat outputs in a coarse basis, everything else on a finer grid, exact derivatives.

The NLP's variables are the coefficients of the flat output and the robot's parameters (ln c) only; the equations of
motion hold at every iterate, so there is nothing to be infeasible but windows and limits, and nothing to be exploited
between the knots. The cost is the mean of (P + sqrt(P^2 + eps^2)) / 2 over the grid, eps sharpened in steps.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from pkmsea.problem import Bound, Problem
from pkmsea.transcription.bases import Basis
from pkmsea.transcription.nlp import Callback, Nlp, Variable
from pkmsea.transcription.pattern import Pattern
from pkmsea.transcription.robot import RobotOnGrid, State
from pkmsea.transcription.windows import LinearRows, linear_rows, narrowed

SHARPENING = (1.0, 0.3, 0.1, 0.03)  # eps of each step, relative to the mean positive power before it
SMALLEST_POWER = 1e-9  # [W]; keeps the root differentiable where nothing moves
SMALLEST_SPREAD = 1e-6  # [rad, m, N m, N]; keeps a scale positive where nothing moves
SIGNALS = ("tau", "speed")
# typical change of a coefficient relative to that of a parameter (1), found by trial: IPOPT regularises by scale
PATH_SCALE, FREE_SCALE = 0.03, 0.3  # of the operating points' span, and of the spread of a free drive's coordinate


class FlatNlp:
    """Values and derivatives of the NLP; `nlp` wraps them for the solver."""

    def __init__(self, problem: Problem, basis: Basis, samples: int, limited: tuple[Bound, ...]) -> None:
        self.problem, self.basis = problem, basis
        self.weight = basis.period / samples
        self.limited = [bound for bound in limited if not bound.quantity.endswith("r_E")]
        self.columns = [column for bound in self.limited if (column := self.column(bound)) is not None]
        joints = sorted({column for column in self.columns if column >= 2 * problem.actuation.m})
        self.robot = RobotOnGrid(problem.actuation, basis, samples, joints)
        self.rows: LinearRows = linear_rows(problem, basis, samples, self.robot.size)
        self._differentiated = [self.robot.differentiated.index(column) for column in self.columns]
        self._state: State | None = None
        self._pattern = Pattern(self.robot, self.rows, self._differentiated)

    def column(self, bound: Bound) -> int | None:
        """Column of the signal that a bound limits; None for the end effector's, which are linear."""
        m, n = self.problem.actuation.m, self.problem.actuation.mechanism.model.nq
        if bound.quantity.endswith("r_E"):
            return None
        if bound.quantity in SIGNALS:
            return 2 * bound.index + SIGNALS.index(bound.quantity)
        return 2 * m + n * ("q", "dq", "ddq").index(bound.quantity) + bound.index

    def at(self, x: np.ndarray) -> State:
        """The robot's state at x; the last one is kept."""
        if self._state is None or not np.array_equal(self._state.x, x):
            self._state = self.robot.state(x)
        return self._state

    def power(self, state: State) -> np.ndarray:
        """Bus power P at all samples [W]."""
        tau, speed = state.signals[:, 0 : 2 * self.robot.m : 2], state.signals[:, 1 : 2 * self.robot.m : 2]
        return np.asarray((tau * speed + self.problem.kappa * tau**2).sum(axis=1))

    def energy(self, x: np.ndarray) -> float:
        """The transcription's own energy, with the exact positive part [J]."""
        return float(self.weight * np.maximum(self.power(self.at(x)), 0.0).sum())

    def objective(self, x: np.ndarray, eps: float) -> float:
        """Smoothed energy [J]."""
        P = self.power(self.at(x))
        return float(self.weight * (P + np.sqrt(P**2 + eps**2)).sum() / 2)

    def constraints(self, x: np.ndarray) -> np.ndarray:
        """Windows and end-effector limits (linear), then limited signals sample by sample."""
        return np.concatenate([self.rows.matrix @ x, self.at(x).signals[:, self.columns].ravel()])

    def gradient(self, x: np.ndarray, eps: float) -> np.ndarray:
        """Gradient of the smoothed energy."""
        state = self.at(x)
        return self._pattern.gather(self._drive_weights(state, eps), self.robot.differentiate(state))

    def jacobian(self, x: np.ndarray) -> np.ndarray:
        """Nonzeros of the constraints' Jacobian, in CasADi's order."""
        slope = self.robot.differentiate(self.at(x)) if self.columns else None
        return self._pattern.jacobian_values(slope)

    def hessian(self, x: np.ndarray, eps: float, factor: float, multipliers: np.ndarray) -> np.ndarray:
        """Nonzeros of the upper triangle of the Lagrangian's Hessian."""
        state, m = self.at(x), self.robot.m
        slope = self.robot.differentiate(state)
        weights = factor * self._drive_weights(state, eps)
        nonlinear = multipliers[self.rows.matrix.shape[0] :].reshape(self.robot.samples, -1)
        for j, column in enumerate(self._differentiated):
            weights[:, column] += nonlinear[:, j]
        blocks = self.robot.curvature(state, weights)
        Q = factor * self._drive_curvature(state, eps)
        speed = np.arange(1, 2 * m, 2)
        Q[:, speed, speed] += weights[:, 0 : 2 * m : 2] * self.robot.friction_curvature(state)
        drives = slope[:, :, : 2 * m]
        weighted = Q[self.robot.cells.own] @ drives
        shape = (drives.shape[0], -1, drives.shape[-1])
        blocks += drives.reshape(shape).transpose(0, 2, 1) @ weighted.reshape(shape)
        return self._pattern.hessian_values(blocks)

    def _drive_weights(self, state: State, eps: float) -> np.ndarray:
        """dE/dsignals, (samples, differentiated signals)."""
        gain, _ = _positive_part_slopes(self.power(state), eps)
        weights = np.zeros((self.robot.samples, len(self.robot.differentiated)))
        m2 = 2 * self.robot.m
        weights[:, :m2] = self.weight * gain[:, None] * self._power_slope(state)
        return weights

    def _power_slope(self, state: State) -> np.ndarray:
        """dP/d(tau_1, v_1, tau_2, ...), (samples, 2m)."""
        m2 = 2 * self.robot.m
        tau, speed = state.signals[:, 0:m2:2], state.signals[:, 1:m2:2]
        result = np.empty((tau.shape[0], m2))
        result[:, 0::2] = speed + 2 * self.problem.kappa * tau
        result[:, 1::2] = tau
        return result

    def _drive_curvature(self, state: State, eps: float) -> np.ndarray:
        """d^2E/d(tau, v)^2, (samples, 2m, 2m)."""
        gain, bend = _positive_part_slopes(self.power(state), eps)
        slope = self._power_slope(state)
        m2 = 2 * self.robot.m
        own = np.zeros((m2, m2))
        tau = np.arange(0, m2, 2)
        own[tau, tau] = 2 * self.problem.kappa
        own[tau, tau + 1] = own[tau + 1, tau] = 1.0
        return np.asarray(
            self.weight * (bend[:, None, None] * slope[:, :, None] * slope[:, None, :] + gain[:, None, None] * own)
        )

    def nlp(self, guess: np.ndarray) -> Nlp:
        """The NLP around a first trajectory, whose poses are found by continuation."""
        self.robot.start(guess)
        variables = self._variables(guess)
        scale = np.concatenate([variable.scale for variable in variables])
        pattern, rows = self._pattern, self._pattern.rows
        scale_jacobian, scale_hessian = pattern.scales(scale)
        one, g = ca.Sparsity.dense(1), ("g", ca.Sparsity.dense(rows))
        given = [("x", ca.Sparsity.dense(self.robot.size)), ("p", one)]
        multipliers = [("lam_f", one), ("lam_g", ca.Sparsity.dense(rows))]

        def value(a, r):
            if r[0] is not None:
                r[0][0] = self.objective(a[0] * scale, a[1][0])

        def values(a, r):
            value(a, r)
            if r[1] is not None:
                r[1][:] = self.constraints(a[0] * scale)

        def slopes(a, r):
            value(a, r)
            if r[1] is not None:
                r[1][:] = self.gradient(a[0] * scale, a[1][0]) * scale

        def rates(a, r):
            if r[0] is not None:
                r[0][:] = self.constraints(a[0] * scale)
            if r[1] is not None:
                r[1][:] = self.jacobian(a[0] * scale) * scale_jacobian

        def second(a, r):
            on_g = a[3] if a[3] is not None else np.zeros(rows)
            r[0][:] = self.hessian(a[0] * scale, a[1][0], a[2][0], on_g) * scale_hessian

        f = ("f", one)
        oracle = Callback("nlp", given, [f, g], values)
        derivatives = {
            "grad_f": Callback("nlp_grad_f", given, [f, ("grad_f_x", given[0][1])], slopes),
            "jac_g": Callback("nlp_jac_g", given, [g, ("jac_g_x", pattern.jacobian)], rates),
            "hess_lag": Callback(
                "nlp_hess_l", [*given, *multipliers], [("triu_hess_gamma_x_x", pattern.hessian)], second
            ),
        }
        boxes = np.array([narrowed(bound.lower, bound.upper) for bound in self.limited]).reshape(-1, 2)
        lower = np.concatenate([self.rows.lower, np.tile(boxes[:, 0], self.robot.samples)])
        upper = np.concatenate([self.rows.upper, np.tile(boxes[:, 1], self.robot.samples)])
        return Nlp(variables, lower, upper, oracle, len(SHARPENING), self._sharpen, derivatives, self)

    def _sharpen(self, step: int, x: np.ndarray) -> np.ndarray:
        mean = max(self.energy(x) / self.basis.period, SMALLEST_POWER)
        return np.array([mean * SHARPENING[step]])

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


def _positive_part_slopes(P: np.ndarray, eps: float) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivative of (P + sqrt(P^2 + eps^2)) / 2."""
    root = np.sqrt(P**2 + eps**2)
    return (1 + P / root) / 2, eps**2 / (2 * root**3)
