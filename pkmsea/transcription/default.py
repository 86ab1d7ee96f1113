"""The default transcription as the solve sees it: a basis, a grid, and the flat NLP on them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pkmsea.motion import Basis
from pkmsea.motion.bases import make_basis
from pkmsea.motion.motion import Motion
from pkmsea.problem import Problem
from pkmsea.task.task import Trajectory
from pkmsea.transcription import guess
from pkmsea.transcription.base import Transcription
from pkmsea.transcription.flat import FlatNlp
from pkmsea.transcription.nlp import Nlp
from pkmsea.transcription.windows import narrowed

PER_KNOT = 4  # grid points per knot: the motors' coordinates vary faster than the flat output
FEWEST_SAMPLES = 200


class FlatTranscription(Transcription):
    """Flat outputs on splines or Fourier series, everything else on a grid several times finer."""

    refines = True

    def __init__(self, problem: Problem, trajectory: Trajectory, samples: int | None) -> None:
        super().__init__(problem)
        self.trajectory, self.basis = trajectory, make_basis(trajectory, problem.cycle.period)
        self.size = self.basis.size
        wanted = samples or max(FEWEST_SAMPLES, 2 * PER_KNOT * self.basis.modes)
        self.samples = self.basis.pieces * math.ceil(wanted / self.basis.pieces)
        self._free = FlatNlp(problem, self.basis, self.samples, ())
        self._limited: FlatNlp | None = None

    @classmethod
    def of(cls, problem: Problem) -> FlatTranscription:
        return cls(problem, problem.options.trajectory, problem.options.samples)

    @classmethod
    def on(cls, problem: Problem, basis: Basis, samples: int) -> FlatTranscription:
        return cls(problem, basis.trajectory, samples)

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (self.problem, self.trajectory, self.samples)

    def start(self, rng: np.random.Generator | None) -> np.ndarray:
        return guess.start(self.problem, self._free.robot, rng)

    def nlp(self, x: np.ndarray, limited: bool) -> Nlp:
        if not limited:
            return self._free.nlp(x)
        if self._limited is None:
            self._limited = FlatNlp(self.problem, self.basis, self.samples, self.problem.bounds)
        return self._limited.nlp(x)

    def claimed(self, x: np.ndarray) -> float:
        self._free.robot.start(x)
        return self._free.claimed(x)

    def motion(self, x: np.ndarray) -> Motion:
        return Motion.of(self.problem.actuation, self.basis, *self._free.robot.split(x))

    def within_limits(self, x: np.ndarray) -> bool:
        return all(
            np.all(signal >= lower) and np.all(signal <= upper)
            for bound in self.problem.bounds
            if (signal := self._free.signal(x, bound)) is not None
            for lower, upper in [narrowed(bound.lower, bound.upper)]
        )

    def refined(self) -> FlatTranscription:
        return FlatTranscription(self.problem, self.basis.finer().trajectory, 2 * self.samples)

    def transfer(self, motion: Motion) -> np.ndarray:
        t = np.arange(4 * self.basis.size) * self.basis.period / (4 * self.basis.size)
        coefficients = self.basis.fit(t, motion.flat_output(t * (motion.basis.period / self.basis.period)))
        return np.concatenate([coefficients.T.ravel(), motion.variables(self.problem.actuation)])
