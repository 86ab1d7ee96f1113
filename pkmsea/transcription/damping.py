"""Springs with losses on a periodic grid: their deflection e follows the force, c e + d_s de/dt = u.

Over one period this is a filter, e = K(c) u, which is diagonal in the frequencies: K = 1 / (c + i w d_s). With
theta = ln c: dK/dtheta = -c K^2 and d^2K/dtheta^2 = -c K^2 + 2 c^2 K^3.
"""

from __future__ import annotations

import numpy as np

from pkmsea.actuation import Actuation


def frequencies(period: float, samples: int) -> np.ndarray:
    """Angular frequencies of the real Fourier transform of a periodic grid [rad/s]."""
    return np.asarray(2 * np.pi / period * np.arange(samples // 2 + 1))


def derivative(values: np.ndarray, period: float, order: int) -> np.ndarray:
    """Time derivative of samples (k, ...) of one period, by Fourier transform."""
    factor = (1j * frequencies(period, values.shape[0])) ** order
    return np.asarray(np.fft.irfft(factor[:, None] * np.fft.rfft(values, axis=0), values.shape[0], axis=0))


class DampedSprings:
    """The filters of a robot's damped springs on a grid; p are the variables of its parameters, ln c first."""

    def __init__(self, actuation: Actuation, period: float, samples: int) -> None:
        self._elastic, self._damping, self._samples = actuation.elastic, actuation.numbers("damping"), samples
        self._omega = frequencies(period, samples)

    def deflection(self, i: int, p: np.ndarray, u: np.ndarray) -> np.ndarray:
        """e of drive i from its force u, (samples,)."""
        return self._filter(self._gains(i, p)[0], u)

    def adjoint(self, i: int, p: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """K^T weights."""
        return self._filter(self._gains(i, p)[0].conj(), weights)

    def kernel(self, i: int, p: np.ndarray) -> np.ndarray:
        """First column of the circulant matrix K, (samples,)."""
        return np.asarray(np.fft.irfft(self._gains(i, p)[0], self._samples))

    def slope(self, i: int, p: np.ndarray, u: np.ndarray) -> np.ndarray:
        """de/d(ln c) for a given force, (samples,)."""
        return self._filter(self._gains(i, p)[1], u)

    def mixed(self, i: int, p: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """d^2(weights^T e)/d(ln c)du, (samples,)."""
        return self._filter(self._gains(i, p)[1].conj(), weights)

    def curvature(self, i: int, p: np.ndarray, u: np.ndarray, weights: np.ndarray) -> float:
        """d^2(weights^T e)/d(ln c)^2 for a given force."""
        return float(weights @ self._filter(self._gains(i, p)[2], u))

    def _gains(self, i: int, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        c = np.exp(p[self._elastic.index(i)])
        K = 1.0 / (c + 1j * self._omega * self._damping[i])
        return K, -c * K**2, -c * K**2 + 2 * c**2 * K**3

    def _filter(self, gain: np.ndarray, values: np.ndarray) -> np.ndarray:
        return np.asarray(np.fft.irfft(gain * np.fft.rfft(values), self._samples))
