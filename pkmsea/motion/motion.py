"""A motion of the whole robot, free of any transcription: flat output in a basis, and stiffnesses."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from pkmsea.actuation import Actuation
from pkmsea.motion.bases import Basis


@dataclass(frozen=True, eq=False)
class Motion:
    """Everything else follows from it by the flat map.

    Attributes
    ----------
    basis : periodic basis of the flat output.
    coefficients : (basis size, m), one column per entry of the flat output.
    stiffness : (m,) [N m/rad, N/m], NaN for rigid drives.
    parallel : (m, 2), stiffness [N m/rad, N/m] and rest position [rad, m] of the parallel springs, NaN where none is.
    """

    basis: Basis
    coefficients: np.ndarray
    stiffness: np.ndarray
    parallel: np.ndarray = field(default_factory=lambda: np.zeros((0, 2)))

    def __post_init__(self) -> None:
        if self.parallel.shape[0] == 0:
            object.__setattr__(self, "parallel", np.full((self.stiffness.size, 2), np.nan))
        for array in (self.coefficients, self.stiffness, self.parallel):
            array.flags.writeable = False

    @classmethod
    def of(cls, actuation: Actuation, basis: Basis, coefficients: np.ndarray, variables: np.ndarray) -> Motion:
        """The motion of a robot from the variables of its parameters, in their order."""
        stiffness, parallel = np.full(actuation.m, np.nan), np.full((actuation.m, 2), np.nan)
        places = {"c": stiffness, "k": parallel[:, 0], "rest": parallel[:, 1]}
        for parameter, variable in zip(actuation.parameters, variables, strict=True):
            places[parameter.kind][parameter.drive] = np.exp(variable) if parameter.logarithmic else variable
        return cls(basis, coefficients.copy(), stiffness, parallel)

    @property
    def springs(self) -> dict[int, float]:
        """Stiffness of every series spring, by its drive [N m/rad, N/m]."""
        return {i: float(c) for i, c in enumerate(self.stiffness) if not np.isnan(c)}

    def variables(self, actuation: Actuation) -> np.ndarray:
        """The inverse of `of`: the variables of the robot's parameters, moved into their bounds."""
        places = {"c": self.stiffness, "k": self.parallel[:, 0], "rest": self.parallel[:, 1]}
        values = [(places[p.kind][p.drive], p) for p in actuation.parameters]
        return np.array([np.clip(np.log(x) if p.logarithmic else x, *p.bounds) for x, p in values])

    def flat_output(self, t: np.ndarray, derivative: int = 0) -> np.ndarray:
        """d^k y / dt^k at times t, (len(t), m)."""
        return np.asarray(self.basis.matrix(t, derivative) @ self.coefficients)
