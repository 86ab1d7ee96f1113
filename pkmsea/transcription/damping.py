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

    def slope(self, i: int, p: np.ndarray, u: np.ndarray, u_x: np.ndarray, column: int) -> np.ndarray:
        """de/dx from du/dx (samples, x); `column` belongs to ln c."""
        K, K_theta, _ = self._gains(i, p)
        result = self._filter(K, u_x)
        result[:, column] += self._filter(K_theta, u)
        return result

    def curvature(
        self, i: int, p: np.ndarray, u: np.ndarray, u_x: np.ndarray, weights: np.ndarray, column: int
    ) -> np.ndarray:
        """Hessian of weights^T e, but for that of u itself, (x, x)."""
        _, K_theta, K_theta_theta = self._gains(i, p)
        mixed = self._filter(K_theta.conj(), weights) @ u_x
        result = np.zeros((u_x.shape[1], u_x.shape[1]))
        result[column] += mixed
        result[:, column] += mixed
        result[column, column] += weights @ self._filter(K_theta_theta, u)
        return result

    def _gains(self, i: int, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        c = np.exp(p[self._elastic.index(i)])
        K = 1.0 / (c + 1j * self._omega * self._damping[i])
        return K, -c * K**2, -c * K**2 + 2 * c**2 * K**3

    def _filter(self, gain: np.ndarray, values: np.ndarray) -> np.ndarray:
        shape = (-1,) + (1,) * (values.ndim - 1)
        return np.asarray(np.fft.irfft(gain.reshape(shape) * np.fft.rfft(values, axis=0), self._samples, axis=0))
