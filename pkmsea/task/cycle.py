"""The pick-and-place cycle: operating points with rest windows, repeated with a period (paper, section 2.1)."""

from __future__ import annotations

import numpy as np
from pydantic import Field, model_validator

from pkmsea.actuation.drive import NotNegative, Number, Positive
from pkmsea.files import Record

PerAxis = float | tuple[float, ...]


class OperatingPoint(Record):
    """A point that the end effector keeps to, within a window, during a rest time centred at `time`."""

    at: tuple[Number, ...] = Field(min_length=1, description="position along the end effector's axes [m]")
    rest: NotNegative | tuple[NotNegative, ...] = Field(0.0, description="rest time [s], one for all axes or per axis")
    window: Positive | tuple[Positive, ...] = Field(description="allowed deviation [m], one or per axis")
    time: NotNegative | None = Field(None, description="middle of the rest [s]; default: evenly spread from t = 0")

    @model_validator(mode="after")
    def _one_per_axis(self) -> OperatingPoint:
        for key in ("rest", "window"):
            value = getattr(self, key)
            if isinstance(value, tuple) and len(value) != len(self.at):
                raise ValueError(f"{key} has {len(value)} entries for {len(self.at)} axes")
        return self

    def per_axis(self, key: str) -> np.ndarray:
        """`rest` or `window` as one number per axis."""
        return np.broadcast_to(np.asarray(getattr(self, key), float), len(self.at)).copy()


class Window(Record):
    """One axis of one operating point: |r_E - at| <= deviation for all t in [start, end]."""

    axis: int
    at: float
    deviation: float
    start: float
    end: float


class Cycle(Record):
    """A periodic pick-and-place operation."""

    period: Positive = Field(description="T_P [s]")
    points: tuple[OperatingPoint, ...] = Field(min_length=2)

    @model_validator(mode="after")
    def _consistent(self) -> Cycle:
        sizes = {len(point.at) for point in self.points}
        if len(sizes) > 1:
            raise ValueError("the operating points have different numbers of coordinates")
        times = self.times
        if np.any(np.diff(times) <= 0) or times[-1] >= times[0] + self.period:
            raise ValueError("the times of the operating points do not increase within one period")
        for axis in range(sizes.pop()):
            for i, point in enumerate(self.points):
                after = self.points[(i + 1) % len(self.points)]
                gap = times[(i + 1) % len(times)] + (self.period if i + 1 == len(times) else 0.0) - times[i]
                if (point.per_axis("rest")[axis] + after.per_axis("rest")[axis]) / 2 >= gap:
                    raise ValueError(f"the rest times of points {i + 1} and the next overlap; shorten them")
        return self

    @property
    def times(self) -> np.ndarray:
        """Middle of each rest [s]."""
        count = len(self.points)
        return np.array([i * self.period / count if p.time is None else p.time for i, p in enumerate(self.points)])

    @property
    def windows(self) -> list[Window]:
        """All rest windows, axis by axis; a rest time of zero gives a window of one instant."""
        return [
            Window(
                axis=axis,
                at=point.at[axis],
                deviation=point.per_axis("window")[axis],
                start=time - point.per_axis("rest")[axis] / 2,
                end=time + point.per_axis("rest")[axis] / 2,
            )
            for point, time in zip(self.points, self.times, strict=True)
            for axis in range(len(point.at))
        ]


class Limits(Record):
    """Box limits of the end effector [m, s] and of the joints [rad or m, s], by axis or joint name.

    Positions are [low, high]; velocities and accelerations are largest magnitudes, one number for all or by name.
    """

    position: dict[str, tuple[Number, Number]] = Field(default_factory=dict)
    velocity: Positive | dict[str, Positive] | None = None
    acceleration: Positive | dict[str, Positive] | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Limits:
        for name, (low, high) in self.position.items():
            if low >= high:
                raise ValueError(f"the position limits of '{name}' are not [low, high]")
        return self

    @property
    def named(self) -> set[str]:
        """All axis or joint names that stand in these limits."""
        names = set(self.position)
        for value in (self.velocity, self.acceleration):
            names |= set(value) if isinstance(value, dict) else set()
        return names

    def bounds(self, order: int, name: str) -> tuple[float, float]:
        """Lower and upper limit of the derivative of this order (0, 1, 2); infinite where there is none."""
        if order == 0:
            return self.position.get(name, (-np.inf, np.inf))
        value = self.velocity if order == 1 else self.acceleration
        largest = value.get(name, np.inf) if isinstance(value, dict) else (np.inf if value is None else value)
        return -largest, largest
