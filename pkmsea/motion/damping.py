"""Springs with losses on a periodic grid: their deflection e follows the force, c e + d_s de/dt = u.

Over one period this is a filter, e = K(c) u, which is diagonal in the frequencies: K = 1 / (c + i w d_s). With
theta = ln c: dK/dtheta = -c K^2 and d^2K/dtheta^2 = -c K^2 + 2 c^2 K^3.
"""

from __future__ import annotations

import numpy as np

from pkmsea.actuation import Actuation
from pkmsea.motion.periodic import filtered, frequencies


def compliance(c: float, damping: float, omega: np.ndarray) -> np.ndarray:
    """K = 1 / (c + i w d_s) [rad/(N m), m/N] at angular frequencies w."""
    return np.asarray(1.0 / (c + 1j * omega * damping))


class DampedSprings:
    """The filters of a robot's damped springs on a grid; p are the variables of its parameters, with ln c among them.

    `drives` are the drives that have such springs, `parameter` gives the place of each one's ln c in p.
    """

    def __init__(self, actuation: Actuation, period: float, samples: int) -> None:
        self.drives = [i for i, kind in enumerate(actuation.kinds) if kind.remembers]
        self.parameter = {i: actuation.structure.parameters.index(("c", i)) for i in self.drives}
        self._damping, self._samples = actuation.numbers("damping"), samples
        self._omega = frequencies(period, samples)

    def deflection(self, i: int, p: np.ndarray, u: np.ndarray) -> np.ndarray:
        """e of drive i from its force u, (samples,)."""
        return filtered(self._gains(i, p)[0], u)

    def adjoint(self, i: int, p: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """K^T weights."""
        return filtered(self._gains(i, p)[0].conj(), weights)

    def kernel(self, i: int, p: np.ndarray) -> np.ndarray:
        """First column of the circulant matrix K, (samples,)."""
        return np.asarray(np.fft.irfft(self._gains(i, p)[0], self._samples))

    def slope(self, i: int, p: np.ndarray, u: np.ndarray) -> np.ndarray:
        """de/d(ln c) for a given force, (samples,)."""
        return filtered(self._gains(i, p)[1], u)

    def mixed(self, i: int, p: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """d^2(weights^T e)/d(ln c)du, (samples,)."""
        return filtered(self._gains(i, p)[1].conj(), weights)

    def curvature(self, i: int, p: np.ndarray, u: np.ndarray, weights: np.ndarray) -> float:
        """d^2(weights^T e)/d(ln c)^2 for a given force."""
        return float(weights @ filtered(self._gains(i, p)[2], u))

    def _gains(self, i: int, p: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        c = np.exp(p[self.parameter[i]])
        K = compliance(c, self._damping[i], self._omega)
        return K, -c * K**2, -c * K**2 + 2 * c**2 * K**3
