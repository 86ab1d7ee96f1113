"""Scheme a, pkmsea's default: flat outputs on few knots, all else on a grid four times finer."""

from __future__ import annotations

import numpy as np
from scheme import Scheme

from pkmsea.problem import Problem
from pkmsea.task import Spline
from pkmsea.transcription import Motion
from pkmsea.transcription.default import PER_KNOT, FlatTranscription
from pkmsea.transcription.nlp import Nlp


class Default(Scheme):
    """All of it is pkmsea's own; `size` counts the points of the finer grid."""

    title = "default: N/4 knots, N samples"

    def __init__(self, problem: Problem, size: int) -> None:
        super().__init__(problem)
        knots = -(-size // PER_KNOT)
        self.own = FlatTranscription(problem, Spline(kind="spline", knots=knots), PER_KNOT * knots)
        self.points = self.own.samples
        self.unknowns = knots * problem.actuation.m + problem.actuation.m

    def start(self, motion: Motion) -> np.ndarray:
        return self.own.transfer(motion)

    def nlp(self, x: np.ndarray) -> Nlp:
        return self.own.nlp(x, limited=False)

    def claimed(self, x: np.ndarray) -> float:
        return self.own.energy(x)

    def motion(self, x: np.ndarray) -> Motion:
        return self.own.motion(x)
