"""Costs of a cycle: what is minimised, each a thing that the task names and that carries its words and its unit.

A cost is found in COSTS by its name; a `Problem` takes any other `Cost` as well. Torques tau, speeds v_M and numbers
have one entry per drive: CasADi expressions in `rate`, arrays over the instants of a motion in `exact`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

SHARPENING = (1.0, 0.3, 0.1, 0.03)  # smoothing of each step of a solve, relative to the cost's own size before it
SMALLEST = 1e-9  # [W]; keeps the root differentiable where nothing moves

Signals = Iterable[Any]
Numbers = Iterable[Mapping[str, Any]]


def positive(x: Any, eps: Any = 0.0) -> Any:
    """(x + sqrt(x^2 + eps^2)) / 2: the positive part max(x, 0), smoothed over a width eps; exact for eps = 0."""
    return (x + (x**2 + eps**2) ** 0.5) / 2


def bus_power(tau: Signals, v: Signals, numbers: Numbers) -> Any:
    """P = sum_i tau_i v_i + kappa_i tau_i^2 on the common bus [W]."""
    return sum(t * w + each["copper_loss"] * t**2 for t, w, each in zip(tau, v, numbers, strict=True))


@dataclass(frozen=True)
class Cost(ABC):
    """The value of a cycle, and the rate whose integral J over one period a transcription minimises in its place.

    J is the value itself, or grows with it: near a value V, about as V to the power `degree`.

    Attributes
    ----------
    name : in the task and, as a key, in records. label : in prose. symbol, unit : of the value.
    """

    name: ClassVar[str]
    label: ClassVar[str]
    symbol: ClassVar[str]
    unit: ClassVar[str]
    degree: ClassVar[int] = 1

    @abstractmethod
    def rate(self, tau: Signals, v: Signals, numbers: Numbers, eps: Any) -> Any:
        """dJ/dt, smoothed by `eps` so that it can be differentiated twice."""

    @abstractmethod
    def value(self, rates: np.ndarray, dt: Any) -> float:
        """The cost of a cycle from its exact rates (points,); dt [s] is the time for which each stands."""

    def exact(self, tau: Signals, v: Signals, numbers: Numbers) -> Any:
        """The rate without smoothing, from which `value` follows."""
        return self.rate(tau, v, numbers, 0.0)

    def smoothing(self, step: int, value: float, period: float) -> float:
        """`eps` of a step of the solve, from the value before it."""
        return SHARPENING[step] * max(value / period, SMALLEST)

    def scale(self, value: float, idle: float) -> float:
        """What differences of values are relative to; `idle` is a small share of the drives' turnover [J]."""
        return max(value, 1e-12)

    def in_objective(self, difference: float, value: float, J: float) -> float:
        """A difference of values as one of J: dJ/dV = degree J / V."""
        return difference * self.degree * J / max(value, 1e-12)

    def show(self, value: float, form: str = ".4g") -> str:
        """A value with its unit."""
        return f"{value:{form}} {self.unit}"


@dataclass(frozen=True)
class Energy(Cost):
    """E = integral of max(P, 0): a common bus that shares power between the drives and burns what is left."""

    name, label, symbol, unit = "energy", "energy", "E", "J"

    def rate(self, tau: Signals, v: Signals, numbers: Numbers, eps: Any) -> Any:
        return positive(bus_power(tau, v, numbers), eps)

    def value(self, rates: np.ndarray, dt: Any) -> float:
        return float((rates * dt).sum())

    def scale(self, value: float, idle: float) -> float:
        return max(value, idle, 1e-12)

    def in_objective(self, difference: float, value: float, J: float) -> float:
        return difference

    def turnover(self, power: np.ndarray, dt: float, idle: float) -> float:
        """What power balances are relative to: the energy of a bus power P (points,) [J], or `idle` if that is more."""
        return self.scale(self.value(positive(power), dt), idle)


@dataclass(frozen=True)
class RmsTorque(Cost):
    """tau_rms = sqrt(mean of sum_i tau_i^2), which heats the motors; J is its square, times the period."""

    name, label, symbol, unit = "rms_torque", "RMS-torque", "tau_rms", "N m"
    degree = 2

    def rate(self, tau: Signals, v: Signals, numbers: Numbers, eps: Any) -> Any:
        return sum(t**2 for t in tau)

    def value(self, rates: np.ndarray, dt: Any) -> float:
        total = rates * dt
        return float(np.sqrt(total.sum() / (dt * np.ones_like(rates)).sum()))


@dataclass(frozen=True)
class PeakPower(Cost):
    """P_max = max of max(P, 0), by which a supply is bought.

    J is the integral of eps (P_+ / eps)^16, a 16-norm of the bus power's positive part P_+, which is within 5 % of the
    maximum where P stays near it for half the time, and eps the peak [W] before the step.
    """

    name, label, symbol, unit = "peak_power", "peak-power", "P_max", "W"
    degree = 16

    def rate(self, tau: Signals, v: Signals, numbers: Numbers, eps: Any) -> Any:
        power = positive(bus_power(tau, v, numbers) / eps, SHARPENING[-1])
        for _ in range(4):  # squares, up to the 16th power
            power = power**2
        return eps * power

    def exact(self, tau: Signals, v: Signals, numbers: Numbers) -> Any:
        return positive(bus_power(tau, v, numbers))

    def value(self, rates: np.ndarray, dt: Any) -> float:
        return float(rates.max())

    def smoothing(self, step: int, value: float, period: float) -> float:
        return max(value, SMALLEST)


ENERGY = Energy()
COSTS: dict[str, Cost] = {cost.name: cost for cost in (ENERGY, RmsTorque(), PeakPower())}
