"""What every transcription offers to the solve: starts, an NLP around a start, and the motion that an x means."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np

from pkmsea.errors import one_line
from pkmsea.motion import Basis
from pkmsea.motion.motion import Motion
from pkmsea.problem import Problem
from pkmsea.transcription.nlp import Nlp
from pkmsea.transcription.relaxed import Side


class Transcription(ABC):
    """A problem made finite.

    One of your own is a subclass that offers what is abstract here, in a module that can be imported; `solve(Yours(
    problem))` then does with it what it does with pkmsea's: starts on all cores, each sharpened through the NLP's
    steps; audit on a dense grid; refinement, where `refined` and `transfer` are offered; export and verification. A
    name in `TRANSCRIPTIONS` lets `transcribe` find it. Its Nlp is any (`pkmsea.transcription.nlp`), in CasADi
    expressions or by hand; parameter, window and limit rows of pkmsea's own can be used: `actuation.flat_map()`,
    `actuation.pose_equation()`, `pkmsea.transcription.windows.linear_rows`, `problem.bounds`, `problem.cost`.

    `size` is the number of coefficients per entry of the flat output, `samples` the number of grid points; `quick` says
    that a start which takes many iterations may be cut off, `refines` that only meshes which agree verify a result.
    """

    size: int
    samples: int
    quick: bool = True
    refines: bool = False

    def __init__(self, problem: Problem) -> None:
        self.problem = problem

    @classmethod
    def of(cls, problem: Problem) -> Transcription:
        """As the problem's options ask for it."""
        return cls(problem)

    @classmethod
    def on(cls, problem: Problem, basis: Basis, samples: int) -> Transcription | None:
        """The one whose motions have this basis, on so many grid points; None where there is none."""
        return None

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickled as what it is made of; a class whose constructor takes more says so here."""
        return type(self), (self.problem,)

    def __repr__(self) -> str:
        size = f"{self.size} coefficients per output, {self.samples} samples"
        return one_line(f"<{type(self).__name__} of '{self.problem.name}': {size}>")

    @abstractmethod
    def start(self, rng: np.random.Generator | None) -> np.ndarray:
        """A first x: the plain one for None, else a random one.

        Raises
        ------
        FloatingPointError : the path leaves the workspace, or crosses a singularity.
        """

    @abstractmethod
    def nlp(self, x: np.ndarray, limited: Collection[str] = (), seen: Sequence[np.ndarray] = ()) -> Nlp:
        """The NLP around x. It may leave out the limits of drives and joints but for those `limited`, by their labels
        (`pkmsea.problem.Bound`).

        Between its samples it may take the signals of x, and of trajectories `seen` before, for those of its solution.
        """

    @abstractmethod
    def claimed(self, x: np.ndarray) -> float:
        """The value of the problem's cost as the transcription sees it, in the cost's unit."""

    @abstractmethod
    def motion(self, x: np.ndarray) -> Motion:
        """The motion that x stands for."""

    def excesses(self, x: np.ndarray) -> dict[str, float]:
        """How far x oversteps each limit at most, by its label, relative to its size; negative where it is kept.

        None by default: where the NLP holds all limits as far as it can.
        """
        return {}

    def relaxed(self, x: np.ndarray, limited: Collection[str]) -> tuple[Nlp, list[Side]] | None:
        """The NLP around x with limits that may be widened, and their sides, whose shares follow x among its variables;
        None where there is none. See `pkmsea.transcription.relaxed`."""
        return None

    def refined(self) -> Transcription | None:
        """The same on twice as fine a mesh; None where there is none."""
        return None

    def transfer(self, motion: Motion) -> np.ndarray:
        """The x nearest to a motion, which is stretched in time to this problem's period."""
        raise TypeError(f"{type(self).__name__} does not take over motions")
