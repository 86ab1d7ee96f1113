"""What all schemes share: the robot's symbols, a start from a motion, and the motion that a result stands for."""

from __future__ import annotations

from abc import ABC, abstractmethod

import casadi as ca
import numpy as np
from stages import StageNlp

from pkmsea.problem import Problem
from pkmsea.solution.audit import Series, series
from pkmsea.transcription import Motion
from pkmsea.transcription.bases import Basis, SplineBasis
from pkmsea.transcription.flat import SHARPENING
from pkmsea.transcription.nlp import Nlp, Variable

DEGREE = 7  # of the splines through the nodes of schemes that know r_E only there


class Scheme(ABC):
    """A transcription of the problem of a fully actuated robot with elastic drives, free of limits.

    `points` instants per period at which the cost is evaluated, `unknowns` entries of x.
    """

    title: str
    points: int
    unknowns: int

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    @abstractmethod
    def start(self, motion: Motion) -> np.ndarray:
        """The x nearest to a motion."""

    @abstractmethod
    def nlp(self, x: np.ndarray) -> Nlp:
        """The NLP, started at x; its steps sharpen the kink of the positive part."""

    @abstractmethod
    def claimed(self, x: np.ndarray) -> float:
        """The energy as the scheme sees it, with the exact positive part [J]."""

    @abstractmethod
    def motion(self, x: np.ndarray) -> Motion:
        """The motion that x stands for."""


class StageScheme(Scheme):
    """A scheme put together from equal stages; x begins with `head` entries, then theta = ln c, then the rest."""

    head = 0
    basis: Basis
    stages: StageNlp

    def nlp(self, x: np.ndarray) -> Nlp:
        free, low, high = np.full(x.size, np.inf), np.full(x.size, -np.inf), np.full(x.size, np.inf)
        theta = slice(self.head, self.head + self.problem.actuation.m)
        low[theta], high[theta] = np.log(self.problem.stiffness_range).T
        return self.stages.nlp((Variable("x", low, high, np.ones_like(free), x),), self._width, len(SHARPENING))

    def claimed(self, x: np.ndarray) -> float:
        return self.stages.cost(x, 0.0)

    def _width(self, step: int, x: np.ndarray) -> np.ndarray:
        return np.array([SHARPENING[step] * self.claimed(x) / self.problem.cycle.period])

    def _fitted(self, motion: Motion) -> np.ndarray:
        """Coefficients of r_E nearest to a motion, axis by axis."""
        fine = np.arange(4 * self.basis.size) * self.basis.period / (4 * self.basis.size)
        return self.basis.fit(fine, motion.flat_output(fine)).T.ravel()

    def _motion(self, basis: Basis, coefficients: np.ndarray, x: np.ndarray) -> Motion:
        theta = x[self.head : self.head + self.problem.actuation.m]
        return Motion(basis, coefficients.copy(), np.exp(theta))

    def _through(self, t: np.ndarray, r_E: np.ndarray, x: np.ndarray) -> Motion:
        """The periodic spline through r_E (K, delta) at nodes t, with as many knots as nodes."""
        basis = SplineBasis(self.problem.cycle.period, t.size, DEGREE)
        return self._motion(basis, basis.fit(t, r_E), x)


class Symbols:
    """The drives' numbers and the robot's equations as CasADi expressions."""

    def __init__(self, problem: Problem) -> None:
        self.mechanism, m = problem.actuation.mechanism, problem.actuation.m
        self.f, self.ind, self.at = self.mechanism.functions, self.mechanism.independent, self.mechanism.actuated
        self.n, self.m, self.delta = self.mechanism.model.nq, m, self.mechanism.mobility
        self.eps, self.step, self.theta = ca.SX.sym("eps"), ca.SX.sym("h"), ca.SX.sym("theta", m)
        self.M_M, self.d_v, self.kappa = ca.SX.sym("M_M", m), ca.SX.sym("d_v", m), ca.SX.sym("kappa", m)
        self.p = ca.vertcat(self.eps, self.step, self.M_M, self.d_v, self.kappa)
        self.c = ca.exp(self.theta)

    def energy_rate(self, tau: ca.SX, v_M: ca.SX) -> ca.SX:
        """Smoothed positive part of the bus power."""
        return self.positive(ca.dot(tau, v_M) + ca.dot(self.kappa, tau**2))

    def positive(self, P: ca.SX) -> ca.SX:
        """Smoothed positive part."""
        return (P + ca.sqrt(P**2 + self.eps**2)) / 2

    def load(self, q: ca.SX, v_ind: ca.SX, a_ind: ca.SX, q_M: ca.SX) -> ca.SX:
        """M a_ind + g - H_A^T C (q_M - q_A)."""
        u = self.c * (q_M - q[self.at])
        return (
            ca.mtimes(self.f["mass_matrix"](q), a_ind)
            + self.f["bias"](q, v_ind)
            - ca.mtimes(self.f["actuation_jacobian"](q).T, u)
        )


def numbers(problem: Problem, step: float) -> np.ndarray:
    """Values of `Symbols.p` without eps."""
    return np.concatenate([[step], *(problem.actuation.numbers(k) for k in ("inertia", "friction", "copper_loss"))])


def sampled(problem: Problem, motion: Motion, t: np.ndarray, names: tuple[str, ...]) -> list[np.ndarray]:
    """Series of a motion at times t, interpolated: good enough for a first x."""
    dense: Series = series(problem, motion)
    period = problem.cycle.period
    return [
        np.stack([np.interp(t, dense.t, column, period=period) for column in getattr(dense, name).T], axis=1)
        for name in names
    ]


def aligned(problem: Problem, wanted: float) -> int:
    """The number of equal steps nearest to a wanted one for which all window edges are nodes."""
    edges = np.array([t for w in problem.cycle.windows for t in (w.start, w.end)]) / problem.cycle.period
    fitting = [k for k in range(1, 4 * int(wanted) + 1) if np.abs(edges * k - np.round(edges * k)).max() < 1e-9]
    return min(fitting, key=lambda k: (abs(k - wanted), -k))


def window_box(problem: Problem, t: np.ndarray) -> np.ndarray:
    """Bounds of r_E at nodes t, (2, K, delta); infinite outside the rest windows, whose edges belong to them."""
    period = problem.cycle.period
    box = np.stack([np.full((t.size, len(problem.span)), side) for side in (-np.inf, np.inf)])
    for w in problem.cycle.windows:
        away = (t - (w.start + w.end) / 2 + period / 2) % period - period / 2
        inside = np.abs(away) <= (w.end - w.start) / 2 + 1e-9
        box[:, inside, w.axis] = [[w.at - w.deviation], [w.at + w.deviation]]
    return box
