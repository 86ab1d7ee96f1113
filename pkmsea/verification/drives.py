"""The drives' own equations in doubles: rotors, friction, springs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pkmsea.actuation import Actuation
from pkmsea.errors import InputError


@dataclass(frozen=True, eq=False)
class Drives:
    """m drives with motor torques tau; rotor and friction stand before the spring, or on the joint where it is rigid.

        elastic:  M_M a_M + d_v v_M + u = tau,   u = c (q_M - q_A)
        rigid:    M_M a_A + d_v v_A + u = tau

    u acts on the joints. `stiffness` (m,) is NaN for rigid drives.
    """

    actuation: Actuation
    stiffness: np.ndarray

    def __post_init__(self) -> None:
        for i in self.actuation.elastic:
            label = self.actuation.labels[i]
            if self.actuation.drives[i].inertia == 0:
                raise InputError(
                    "A motor without inertia cannot be simulated.", "Give the drive a rotor inertia.",
                    key=f"drive {label}: inertia", value=0,
                )  # fmt: skip
            if not 0 < self.stiffness[i] < np.inf:
                raise InputError(
                    "The stiffness is not a positive number.", "Solve the task again.", key=f"stiffness of {label}"
                )

    @cached_property
    def elastic(self) -> np.ndarray:
        """Which drives are series elastic (m,)."""
        return np.array([drive.elastic for drive in self.actuation.drives])

    @cached_property
    def inertia(self) -> np.ndarray:
        return self.actuation.numbers("inertia")

    @cached_property
    def viscous(self) -> np.ndarray:
        return self.actuation.numbers("friction")

    @cached_property
    def c(self) -> np.ndarray:
        """Stiffness, zero for rigid drives (m,)."""
        return np.where(self.elastic, self.stiffness, 0.0)

    def friction(self, v_M: np.ndarray) -> np.ndarray:
        """Friction at speeds v_M (..., m)."""
        return np.asarray(self.viscous * v_M)

    def spring(self, wound: np.ndarray) -> np.ndarray:
        """Spring forces u at q_M - q_A (..., m)."""
        return np.asarray(self.c * wound)

    def spring_energy(self, wound: np.ndarray) -> np.ndarray:
        """Energy in the springs [J] (...)."""
        return np.asarray((self.c * wound**2).sum(axis=-1) / 2)

    @cached_property
    def frequency(self) -> float:
        """Highest natural frequency of a rotor on its spring [rad/s]; zero without springs."""
        return float(np.sqrt(self.c[self.elastic] / self.inertia[self.elastic]).max(initial=0.0))
