"""Time derivatives and filters of what is sampled on a uniform grid over one period."""

from __future__ import annotations

import numpy as np


def frequencies(period: float, samples: int) -> np.ndarray:
    """Angular frequencies of the real Fourier transform of a periodic grid [rad/s]."""
    return np.asarray(2 * np.pi / period * np.arange(samples // 2 + 1))


def derivative(values: np.ndarray, period: float, order: int) -> np.ndarray:
    """Time derivative of samples (k, ...) of one period, by Fourier transform."""
    factor = (1j * frequencies(period, values.shape[0])) ** order
    return np.asarray(np.fft.irfft(factor[:, None] * np.fft.rfft(values, axis=0), values.shape[0], axis=0))


def filtered(gain: np.ndarray, values: np.ndarray) -> np.ndarray:
    """Samples of one period (samples,) through a filter that is given by its gains at their frequencies."""
    return np.asarray(np.fft.irfft(gain * np.fft.rfft(values), values.size))


def derivative_weights(order: int, half_width: int) -> np.ndarray:
    """Central difference weights for d^order/dt^order on a unit grid, exact to polynomial degree 2 half_width.

    Fornberg's formula by a Vandermonde solve; offsets run from -half_width to half_width.
    """
    offsets = np.arange(-half_width, half_width + 1, dtype=float)
    powers = np.vander(offsets, increasing=True).T
    right = np.zeros(offsets.size)
    right[order] = float(np.prod(np.arange(1, order + 1)))
    return np.asarray(np.linalg.solve(powers, right))
