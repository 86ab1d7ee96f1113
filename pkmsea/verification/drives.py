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

        elastic:  M_M a_M + d_v v_M + F_C tanh(v_M / w) + u = tau,   u = c e + c_3 e^3 + d_s de/dt,   e = q_M - q_A
        rigid:    M_M a_A + d_v v_A + F_C tanh(v_A / w) + u = tau

    u and the parallel springs' k (rest - q_A) act on the joints. `stiffness` (m,) is NaN for rigid drives, `parallel`
    (m, 2), stiffness and rest position, is NaN where there is none.
    """

    actuation: Actuation
    stiffness: np.ndarray
    parallel: np.ndarray

    def __post_init__(self) -> None:
        for i in np.flatnonzero(self.elastic):
            label = self.actuation.labels[i]
            if self.actuation.drives[i].inertia == 0:
                raise InputError(
                    "A motor without inertia cannot be simulated.",
                    "Give the drive a rotor inertia.",
                    key=f"drive {label}: inertia",
                    value=0,
                )
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
    def c(self) -> np.ndarray:
        """Stiffness, zero for rigid drives (m,)."""
        return np.where(self.elastic, self.stiffness, 0.0)

    @cached_property
    def cubic(self) -> np.ndarray:
        return self.actuation.numbers("cubic")

    @cached_property
    def beside(self) -> np.ndarray:
        """Stiffness and rest position of the parallel springs, zero where there is none (2, m)."""
        return np.nan_to_num(self.parallel).T

    @cached_property
    def losses(self) -> np.ndarray:
        """d_v, F_C and w, (3, m)."""
        return np.array([self.actuation.numbers(key) for key in ("friction", "coulomb", "coulomb_width")])

    def friction(self, v_M: np.ndarray) -> np.ndarray:
        """Friction at speeds v_M (..., m)."""
        viscous, coulomb, width = self.losses
        return np.asarray(viscous * v_M + coulomb * np.tanh(v_M / width))

    @cached_property
    def damping(self) -> np.ndarray:
        return self.actuation.numbers("damping")

    @cached_property
    def inertia_on_joints(self) -> np.ndarray:
        """Rotor inertias that the joints carry (m,): those of rigid drives."""
        return np.where(self.elastic, 0.0, self.inertia)

    def forces(self, wound: np.ndarray, rate: np.ndarray, left: np.ndarray) -> np.ndarray:
        """u (..., m): of the springs at q_M - q_A and v_M - v_A, or what is left of a rigid drive's torque."""
        return np.where(self.elastic, self.spring(wound, rate), left)

    @cached_property
    def damped_gain(self) -> np.ndarray:
        """Largest gain of a feedback of the motors' speeds that is no faster than the rotor on its spring (m,)."""
        return np.where(self.elastic, np.sqrt(self.c * self.inertia), np.inf)

    def spring(self, wound: np.ndarray, rate: np.ndarray) -> np.ndarray:
        """Spring forces u at q_M - q_A and v_M - v_A (..., m)."""
        return np.asarray(self.c * wound + self.cubic * wound**3 + self.damping * rate)

    def parallel_spring(self, q_A: np.ndarray) -> np.ndarray:
        """Forces of the parallel springs on the joints (..., m)."""
        k, rest = self.beside
        return np.asarray(k * (rest - q_A))

    def spring_energy(self, wound: np.ndarray, q_A: np.ndarray) -> np.ndarray:
        """Energy in all springs [J] (...)."""
        k, rest = self.beside
        stored = self.c * wound**2 / 2 + self.cubic * wound**4 / 4 + k * (rest - q_A) ** 2 / 2
        return np.asarray(stored.sum(axis=-1))

    def fastest(self, wound: np.ndarray) -> float:
        """Highest rate of the motors at deflections up to `wound` (m,) [1/s]: of a rotor on its spring, or in its
        friction."""
        at = self.inertia > 0
        viscous, coulomb, width = self.losses
        swinging = np.sqrt((self.c + 3 * self.cubic * wound**2)[at] / self.inertia[at])
        braking = (viscous + coulomb / width + self.damping)[at & self.elastic] / self.inertia[at & self.elastic]
        return float(max(swinging.max(initial=0.0), braking.max(initial=0.0)))
