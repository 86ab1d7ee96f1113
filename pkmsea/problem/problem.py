"""The optimal control problem of one robot and one cycle, before any discretisation (paper, section 4.3).

min over y(t), c   a cost of one period; by default the energy that the drives draw from their common bus
subject to         the robot's equations of motion (through its flat output y), y periodic,
                   the rest windows at every instant, and the limits of motion and drives.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from itertools import product
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from pkmsea.actuation import Actuation, Drive
from pkmsea.actuation.cost import ENERGY, Cost
from pkmsea.errors import InputError, Unreachable, one_line
from pkmsea.files import Name
from pkmsea.mechanism import Mechanism
from pkmsea.problem.bounds import Bound, bounds_of, check_points
from pkmsea.task import Cycle, OperatingPoint, Options, Payload, TaskLimits

NAME = TypeAdapter(Name)  # result files and figures have it
CORNERS = (-1.0, 0.0, 1.0)  # of a window, along each axis


@dataclass(frozen=True, repr=False)
class Problem:
    """What is to be solved, as a value: it knows no file, changes by `dataclasses.replace`, and pickles as it is.

    What follows from these fields (`actuation`, `bounds`, `kappa`) follows from them after every change.

    Attributes
    ----------
    name : of this robot among those that perform the same cycle, and `title`, of all of them together.
    mechanism : the robot without its drives.
    drives : one per actuated joint (m), or one for all of them; seen from the motor where they have a `gear_ratio`.
    cycle, limits, payload : what the end effector does, must keep to, and carries.
    options : how it is solved.
    cost : what is minimised, one of `pkmsea.problem.COSTS` or another `Cost`.

    Raises
    ------
    InputError : these do not fit each other. Unreachable : an operating point, or a corner of its window.
    Keys of these errors are paths from here, such as cycle.points.0.at.
    """

    name: str
    mechanism: Mechanism
    drives: tuple[Drive, ...]
    cycle: Cycle
    limits: TaskLimits = field(default_factory=TaskLimits)
    payload: Payload | None = None
    options: Options = field(default_factory=Options)
    title: str = ""
    cost: Cost = ENERGY

    def __post_init__(self) -> None:
        object.__setattr__(self, "title", self.title or self.name)
        for key in ("name", "title"):
            self._check_name(key)
        one_for_all = len(self.mechanism.actuated) if len(self.drives) == 1 else 1
        object.__setattr__(self, "drives", tuple(self.drives) * one_for_all)
        axes = self.mechanism.description.end_effector.coordinates
        if len(self.cycle.points[0].at) != len(axes):
            raise InputError(
                f"The operating points have {len(self.cycle.points[0].at)} coordinates, but the end effector of "
                f"'{self.mechanism.name}' moves along {', '.join(map(str, axes))}.",
                f"Give {len(axes)} coordinates.",
                key="cycle.points",
            )
        if self.payload is not None:
            try:
                self.payload.check(self.cycle)
            except ValueError as error:
                raise InputError(f"{error}.", "Correct it.", key="payload") from None
        for derived in ("actuation", "bounds"):  # they raise where something does not fit
            getattr(self, derived)
        centers = self.actuation.poses[:: len(CORNERS) ** len(axes)]
        check_points(self.bounds, self.ranges, self.cycle, self.mechanism, centers)

    def _check_name(self, key: str) -> None:
        try:
            NAME.validate_python(getattr(self, key))
        except ValidationError as error:
            what = error.errors()[0]["msg"].removeprefix("Value error, ")
            raise InputError(f"{what}.", "Choose another one.", key=key, value=getattr(self, key)) from None

    def __hash__(self) -> int:
        return hash((self.name, self.mechanism, self.drives, self.cycle))

    def __getstate__(self) -> dict[str, Any]:
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __repr__(self) -> str:
        kinds = ", ".join(f"{count} {kind}" for kind, count in Counter(drive.kind for drive in self.drives).items())
        what = f"{self.mechanism.name}, drives: {kinds}, {len(self.cycle.points)} points in {self.cycle.period:g} s"
        return one_line(f"<Problem '{self.name}': {what}, {len(self.bounds)} bounds>")

    @cached_property
    def actuation(self) -> Actuation:
        """The mechanism with its drives, all numbers seen at the output side of the gears."""
        drives = tuple(drive.at_output() for drive in self.drives)
        payload = None if self.payload is None else self.payload.mass_over(self.cycle)
        return Actuation(self.mechanism, drives, _poses(self.mechanism, self.cycle.points), payload)

    @cached_property
    def bounds(self) -> tuple[Bound, ...]:
        """Limits of the end effector, the joints and the drives; see `pkmsea.problem.bounds`."""
        return bounds_of(self.actuation, self.limits)

    @cached_property
    def ranges(self) -> np.ndarray:
        """Lower and upper limit of each joint's position, infinite where there is none (2, n)."""
        found = np.full((2, len(self.mechanism.joints)), np.inf) * [[-1.0], [1.0]]
        for bound in self.bounds:
            if bound.quantity == "q":
                found[:, bound.index] = bound.lower, bound.upper
        return found

    @property
    def kappa(self) -> np.ndarray:
        """Copper loss per squared torque (m,)."""
        return self.actuation.numbers("copper_loss")

    @property
    def gear_ratios(self) -> tuple[float | None, ...]:
        """Motor turns per output turn of each drive (m); None where its numbers were given at the output side."""
        return tuple(drive.gear_ratio for drive in self.drives)

    @cached_property
    def span(self) -> np.ndarray:
        """Typical size of the motion per axis [m]: the spread of the operating points, at least a tenth of the
        largest spread."""
        at = np.array([point.at for point in self.cycle.points])
        spread = np.ptp(at, axis=0)
        return np.asarray(np.maximum(spread, 0.1 * max(spread.max(), 1e-6)))


@lru_cache(maxsize=64)
def _poses(mechanism: Mechanism, points: tuple[OperatingPoint, ...]) -> tuple[np.ndarray, ...]:
    """Poses at all operating points, each before those at the corners of its window; all must be reachable."""
    poses = []
    for i, point in enumerate(points):
        corners = product(*[CORNERS] * len(point.at))
        for corner in sorted(corners, key=lambda c: float(np.abs(c).sum())):
            target = np.array(point.at) + np.array(corner) * point.per_axis("window")
            try:
                poses.append(mechanism.configuration(target))
            except Unreachable as error:
                what = "operating point" if not any(corner) else "rest window of operating point"
                raise Unreachable(
                    f"The {what} {i + 1} is out of reach. {error.cause}",
                    "Move it into the workspace ('pkmsea check' prints it), shrink its window, or declare another "
                    "assembly mode under 'seed' in mechanism.yaml.",
                    key=f"cycle.points.{i}.at",
                    value=list(point.at),
                ) from None
    return tuple(poses)
