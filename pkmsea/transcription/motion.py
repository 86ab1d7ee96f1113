"""A motion of the whole robot, free of any transcription: flat output in a basis, and stiffnesses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pkmsea.transcription.bases import Basis


@dataclass(frozen=True, eq=False)
class Motion:
    """Everything else follows from it by the flat map.

    Attributes
    ----------
    basis : periodic basis of the flat output.
    coefficients : (basis size, m), one column per entry of the flat output.
    stiffness : (m,) [N m/rad, N/m], NaN for rigid drives.
    """

    basis: Basis
    coefficients: np.ndarray
    stiffness: np.ndarray

    def __post_init__(self) -> None:
        self.coefficients.flags.writeable = False
        self.stiffness.flags.writeable = False

    def flat_output(self, t: np.ndarray, derivative: int = 0) -> np.ndarray:
        """d^k y / dt^k at times t, (len(t), m)."""
        return np.asarray(self.basis.matrix(t, derivative) @ self.coefficients)
