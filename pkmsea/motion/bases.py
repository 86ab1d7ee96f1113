"""Periodic function bases for the flat outputs: a trajectory is y(t) = B(t) x with coefficients x.

A basis is a class here, a record of a task's options that has its numbers, and a line of BASES.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import BSpline

from pkmsea.task import Fourier, Spline
from pkmsea.task.task import Trajectory


@dataclass(frozen=True)
class Basis(ABC):
    """`size` periodic functions of period `period` [s]."""

    period: float

    @property
    @abstractmethod
    def size(self) -> int:
        """Number of coefficients."""

    @property
    @abstractmethod
    def modes(self) -> int:
        """Highest harmonic that the basis resolves; grids are chosen by it."""

    @property
    @abstractmethod
    def trajectory(self) -> Fourier | Spline:
        """The record of a task's options that names this basis."""

    @abstractmethod
    def matrix(self, t: np.ndarray, derivative: int = 0) -> np.ndarray:
        """d^k B / dt^k at times t, (len(t), size)."""

    @property
    def pieces(self) -> int:
        """Intervals between knots; a grid has as many points in each."""
        return 1

    def finer(self) -> Basis:
        """One of twice the knots, which contains this one; itself where there are none."""
        return self

    def cells(self, samples: int, halo: int) -> int:
        """Cells of equal shape into which a grid can be cut, so that each depends on few coefficients."""
        return 1

    def fit(self, t: np.ndarray, values: np.ndarray) -> np.ndarray:
        """Coefficients of the least-squares fit to samples."""
        return np.asarray(np.linalg.lstsq(self.matrix(t), values, rcond=None)[0])


@dataclass(frozen=True)
class FourierBasis(Basis):
    """1, sin(l w t), cos(l w t) for l = 1 ... order, with w = 2 pi / period."""

    order: int

    @property
    def size(self) -> int:
        return 2 * self.order + 1

    @property
    def modes(self) -> int:
        return self.order

    @property
    def trajectory(self) -> Fourier:
        return Fourier(kind="fourier", order=self.order)

    def matrix(self, t: np.ndarray, derivative: int = 0) -> np.ndarray:
        w = 2 * np.pi / self.period * np.arange(1, self.order + 1)
        phase = np.outer(np.asarray(t, float), w) + derivative * np.pi / 2
        gain = w**derivative
        constant = np.full((phase.shape[0], 1), float(derivative == 0))
        return np.hstack([constant, gain * np.sin(phase), gain * np.cos(phase)])


@dataclass(frozen=True)
class SplineBasis(Basis):
    """Periodic B-splines of a degree on uniform knots: piecewise polynomials, `degree - 1` times differentiable."""

    knots: int
    degree: int

    @property
    def size(self) -> int:
        return self.knots

    @property
    def modes(self) -> int:
        return self.knots // 2

    @property
    def trajectory(self) -> Spline:
        return Spline(kind="spline", knots=self.knots, degree=self.degree)

    @property
    def pieces(self) -> int:
        return self.knots

    def finer(self) -> SplineBasis:
        return replace(self, knots=2 * self.knots)

    def cells(self, samples: int, halo: int) -> int:
        reach = -(-halo // (samples // self.knots))
        return self.knots if self.degree + 1 + 2 * reach < self.knots else 1

    def matrix(self, t: np.ndarray, derivative: int = 0) -> np.ndarray:
        n, k, h = self.knots, self.degree, self.period / self.knots
        t = np.asarray(t, float) % self.period
        knots = h * np.arange(-k, n + k + 1)
        spline = BSpline(knots, np.eye(n + k), k, extrapolate=False)
        B = spline(t, nu=derivative)
        wrapped: np.ndarray = B[:, :n].copy()
        wrapped[:, :k] += B[:, n:]
        return wrapped


BASES: dict[str, type[Basis]] = {"fourier": FourierBasis, "spline": SplineBasis}


def make_basis(trajectory: Trajectory, period: float) -> Basis:
    """The basis that a task's options name; the numbers of their record are the basis's own."""
    if trajectory.kind not in BASES:
        raise TypeError("a chain of integrators has no basis; it is transcribed by multiple shooting")
    return BASES[trajectory.kind](period, **trajectory.model_dump(exclude={"kind"}))
