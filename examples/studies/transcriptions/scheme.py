"""What every scheme offers, and what all those share that are put together from equal stages."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
from stages import StageNlp

from pkmsea.actuation.cost import SHARPENING
from pkmsea.motion import Basis, Motion
from pkmsea.motion.bases import SplineBasis
from pkmsea.problem import Problem
from pkmsea.task import Spline
from pkmsea.transcription import Transcription
from pkmsea.transcription.default import FlatTranscription
from pkmsea.transcription.nlp import Nlp, Variable

KNOTS = 25  # of the default, where starts are made and the shared one is solved
DEGREE = 7  # of the splines through the nodes of schemes that know r_E only there


class Scheme(Transcription):
    """A transcription of the problem of a fully actuated robot with elastic drives, free of limits.

    It comes through pkmsea's own door (`pkmsea.transcription.base`): `solve(scheme)` solves, audits and stores it, too.
    `points` instants per period at which the cost is evaluated, `unknowns` entries of x.
    """

    title: str
    points: int
    unknowns: int

    def __init__(self, problem: Problem, size: int) -> None:
        super().__init__(problem)
        self.size = size

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.problem, self.size)

    @property
    def samples(self) -> int:
        return self.points

    def start(self, rng: np.random.Generator | None) -> np.ndarray:
        """The x nearest to a first motion of the default."""
        default = FlatTranscription(self.problem, Spline(kind="spline", knots=KNOTS), None)
        return self.transfer(default.motion(default.start(rng)))

    @abstractmethod
    def transfer(self, motion: Motion) -> np.ndarray:
        """The x nearest to a motion."""


class StageScheme(Scheme):
    """A scheme put together from equal stages; x begins with `head` entries, then theta = ln c, then the rest."""

    head = 0
    basis: Basis
    stages: StageNlp

    def nlp(self, x: np.ndarray, limited: Collection[str] = (), seen: Sequence[np.ndarray] = ()) -> Nlp:
        free, low, high = np.full(x.size, np.inf), np.full(x.size, -np.inf), np.full(x.size, np.inf)
        theta = slice(self.head, self.head + self.problem.actuation.m)
        low[theta], high[theta] = np.log([drive.stiffness_range for drive in self.problem.actuation.drives]).T
        return self.stages.nlp((Variable("x", low, high, np.ones_like(free), x),), self._width, len(SHARPENING))

    def claimed(self, x: np.ndarray) -> float:
        return self.stages.cost(x, 0.0)

    def _width(self, step: int, x: np.ndarray) -> np.ndarray:
        return np.array([self.problem.cost.smoothing(step, self.claimed(x), self.problem.cycle.period)])

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
