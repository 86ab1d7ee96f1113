"""Scheme a, pkmsea's default: flat outputs on few knots, all else on a grid four times finer."""

from __future__ import annotations

from typing import Any

from pkmsea.problem import Problem
from pkmsea.task import Spline
from pkmsea.transcription.default import PER_KNOT, FlatTranscription


class Default(FlatTranscription):
    """All of it is pkmsea's own; `size` counts the points of the finer grid."""

    title = "default: N/4 knots, N samples"

    def __init__(self, problem: Problem, size: int) -> None:
        knots = -(-size // PER_KNOT)
        super().__init__(problem, Spline(kind="spline", knots=knots), PER_KNOT * knots)
        self.points = self.samples
        self.unknowns = knots * problem.actuation.m + problem.actuation.m

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.problem, self.samples)
