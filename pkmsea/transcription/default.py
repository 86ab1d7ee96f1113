"""The default transcription as the solve sees it: a basis, a grid, and the flat NLP on them."""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from pkmsea.motion import Basis
from pkmsea.motion.bases import make_basis
from pkmsea.motion.motion import Motion
from pkmsea.problem import Bound, Problem
from pkmsea.task.task import Trajectory
from pkmsea.transcription import guess
from pkmsea.transcription.base import Transcription
from pkmsea.transcription.between import FINER, beyond, exact, extremes, room
from pkmsea.transcription.flat import FlatNlp
from pkmsea.transcription.nlp import Nlp
from pkmsea.transcription.relaxed import Side, relaxed

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
        self._limited: dict[tuple[Bound, ...], FlatNlp] = {}

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

    def relaxed(self, x: np.ndarray, limited: Collection[str]) -> tuple[Nlp, list[Side]] | None:
        flat = self._flat(limited)
        nlp = flat.nlp(x, self._room(flat, [x]))
        sides = flat.sides(x)
        return (relaxed(nlp, sides), sides) if sides else None

    def nlp(self, x: np.ndarray, limited: Collection[str] = (), seen: Sequence[np.ndarray] = ()) -> Nlp:
        flat = self._flat(limited)
        return flat.nlp(x, self._room(flat, [*seen, x]))

    def _flat(self, limited: Collection[str]) -> FlatNlp:
        bounds = tuple(b for b in self.problem.bounds if b.label in limited and not b.of_end_effector)
        if bounds and bounds not in self._limited:
            self._limited[bounds] = FlatNlp(self.problem, self.basis, self.samples, bounds)
        return self._limited[bounds] if bounds else self._free

    def _room(self, flat: FlatNlp, trajectories: Sequence[np.ndarray]) -> list[np.ndarray]:
        """What the limits leave between the samples, as any of the trajectories needs it; see `between.room`."""
        found = [np.full((2, self.samples), -np.inf) for _ in flat.bounds]
        for x in trajectories if found else ():
            flat.robot.start(x)
            sides = extremes(self.problem, self.motion(x), flat.bounds, self.samples)
            needed = [room(bound, flat.signal(x, bound), ends) for bound, ends in zip(flat.bounds, sides, strict=True)]
            found = [np.maximum(a, b) for a, b in zip(found, needed, strict=True)]
        return found

    def claimed(self, x: np.ndarray) -> float:
        self._free.robot.start(x)
        return self._free.claimed(x)

    def motion(self, x: np.ndarray) -> Motion:
        return Motion.of(self.problem.actuation, self.basis, *self._free.robot.split(x))

    def excesses(self, x: np.ndarray) -> dict[str, float]:
        bounds = self.problem.bounds
        signals = exact(self.problem, self.motion(x), bounds, FINER * self.samples) if bounds else []
        return {b.label: b.excess(values + beyond(values)) for b, values in zip(bounds, signals, strict=True)}

    def refined(self) -> FlatTranscription:
        return FlatTranscription(self.problem, self.basis.finer().trajectory, 2 * self.samples)

    def transfer(self, motion: Motion) -> np.ndarray:
        t = np.arange(4 * self.basis.size) * self.basis.period / (4 * self.basis.size)
        coefficients = self.basis.fit(t, motion.flat_output(t * (motion.basis.period / self.basis.period)))
        return np.concatenate([coefficients.T.ravel(), motion.variables(self.problem.actuation)])
