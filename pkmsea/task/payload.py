"""What the end effector carries: all the time, or from one operating point to another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import Polynomial
from pydantic import Field, model_validator

from pkmsea.actuation.drive import Positive
from pkmsea.files import Record
from pkmsea.task.cycle import Cycle

# 35 x^4 - 84 x^5 + 70 x^6 - 20 x^7: from 0 to 1 on [0, 1] with three vanishing derivatives at both ends
HANDOVER = Polynomial([0, 0, 0, 0, 35, -84, 70, -20])


class Payload(Record):
    """A point mass at the origin of the end effector's frame.

    Carried from operating point `pick` to operating point `place`, it is taken over and handed over smoothly during the
    rests there; without the two it is carried all the time.
    """

    mass: Positive = Field(description="[kg]")
    pick: int | None = Field(None, ge=1, description="number of the operating point where it is taken, from 1")
    place: int | None = Field(None, ge=1, description="number of the operating point where it is left, from 1")

    @model_validator(mode="after")
    def _both_or_none(self) -> Payload:
        if (self.pick is None) != (self.place is None) or (self.pick is not None and self.pick == self.place):
            raise ValueError("give two different operating points as pick and place, or neither of the two")
        return self

    def check(self, cycle: Cycle) -> None:
        """Raise ValueError where the cycle has no such points, or no rest there."""
        for key in ("pick", "place"):
            number = getattr(self, key)
            if number is not None and number > len(cycle.points):
                raise ValueError(f"payload.{key} is {number}, but the cycle has {len(cycle.points)} operating points")
            if number is not None and not cycle.points[number - 1].per_axis("rest").min() > 0:
                raise ValueError(f"operating point {number} needs a rest time, during which the payload is handed over")

    def mass_over(self, cycle: Cycle) -> PayloadMass:
        """The mass as a function of time."""
        if self.pick is None or self.place is None:
            return PayloadMass(self.mass, cycle.period, None, None)
        handovers = []
        for number in (self.pick, self.place):
            rest = float(cycle.points[number - 1].per_axis("rest").min())
            handovers.append((float(cycle.times[number - 1]) - rest / 2, rest))
        return PayloadMass(self.mass, cycle.period, handovers[0], handovers[1])


@dataclass(frozen=True)
class PayloadMass:
    """m_L(t) [kg] and its derivatives; `pick` and `place` are begin and length of the handovers [s]."""

    mass: float
    period: float
    pick: tuple[float, float] | None
    place: tuple[float, float] | None

    def __call__(self, t: np.ndarray, order: int) -> np.ndarray:
        if self.pick is None or self.place is None:
            return np.full(np.shape(t), self.mass if order == 0 else 0.0)
        since = (np.asarray(t, float) - self.pick[0]) % self.period
        until = since - (self.place[0] - self.pick[0]) % self.period
        return self.mass * (
            _handover(since / self.pick[1], self.pick[1], order)
            - _handover(until / self.place[1], self.place[1], order)
        )


def _handover(x: np.ndarray, length: float, order: int) -> np.ndarray:
    """Derivative of HANDOVER(x), constant outside [0, 1], in time."""
    inside = (x > 0) & (x < 1)
    outside = np.where(x >= 1, 1.0, 0.0) if order == 0 else 0.0
    return np.asarray(np.where(inside, HANDOVER.deriv(order)(x) / length**order, outside))
