"""What every scheme offers, and what all those share that are put together from equal stages."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np
from stages import StageNlp

from pkmsea.problem import Problem
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
        low[theta], high[theta] = np.log([drive.stiffness_range for drive in self.problem.actuation.drives]).T
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
