"""Limits of a problem as boxes on signals: those of the task, of its drives, and of the URDF's joints."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from math import inf

import numpy as np

from pkmsea.actuation import Actuation
from pkmsea.errors import InputError, NameNotFound
from pkmsea.mechanism import Mechanism
from pkmsea.task import Cycle, Limits, TaskLimits

MOTIONS = {"end_effector": ("r_E", "dr_E", "ddr_E"), "joints": ("q", "dq", "ddq")}  # by order of their derivative
DRIVES = {"torque": "tau", "speed": "speed"}  # by key of a drive
KEYS = ("position", "velocity", "acceleration")
POSED = 1e-9  # of a limit's size: rounding of a pose
TINY = 1e-12  # keeps ratios finite where nothing moves
TOUCHING = 1e-4  # of a limit's size: a signal that comes so near is at its limit


@dataclass(frozen=True)
class Bound:
    """A box on one signal at every instant: `quantity` of `name` between lower and upper.

    quantity: r_E, dr_E, ddr_E (of an axis), q, dq, ddq (of a joint), tau or speed (of a drive); index in its order.
    `stated` says where lower and upper stand: a key of the task, or the joint of the URDF.
    """

    quantity: str
    index: int
    name: str
    lower: float
    upper: float
    stated: tuple[str, str] = ("", "")

    @property
    def label(self) -> str:
        """Such as 'dq A': the bound among others of its problem."""
        return f"{self.quantity} {self.name}"

    @property
    def of_end_effector(self) -> bool:
        """Whether it limits the flat output itself, in whose coefficients it is linear."""
        return self.quantity in MOTIONS["end_effector"]

    @property
    def order(self) -> int:
        """Of the time derivative that it limits."""
        return next((names.index(self.quantity) for names in MOTIONS.values() if self.quantity in names), 0)

    def sizes(self, values: np.ndarray) -> np.ndarray:
        """What an excess over the lower and the upper limit is relative to: that limit, or the range of the signal
        where that is larger (2,)."""
        limits = np.abs([self.lower, self.upper])
        return np.maximum(np.where(np.isfinite(limits), limits, 0.0), max(float(np.ptp(values)), TINY))

    def excesses(self, values: np.ndarray) -> np.ndarray:
        """Largest excess of a signal over the lower and the upper limit, relative to their sizes; negative if kept."""
        return np.array([self.lower - values.min(), values.max() - self.upper]) / self.sizes(values)

    def excess(self, values: np.ndarray) -> float:
        """The larger one."""
        return float(self.excesses(values).max())

    def touched(self, values: np.ndarray) -> list[str]:
        """The sides that a signal reaches, such as 'dq A <= 3'."""
        sides = f"{self.label} >= {self.lower:.4g}", f"{self.label} <= {self.upper:.4g}"
        return [side for side, excess in zip(sides, self.excesses(values), strict=True) if excess >= -TOUCHING]


def near(excesses: Mapping[str, float], within: float) -> tuple[str, ...]:
    """Labels of the limits that a motion comes near to, `within` a share of their size, or oversteps by -within."""
    return tuple(label for label, excess in excesses.items() if excess >= -within)


def bounds_of(actuation: Actuation, limits: TaskLimits) -> tuple[Bound, ...]:
    """All limits of a robot, the tighter one where two hold for the same signal.

    Raises
    ------
    InputError : a name does not exist, or two limits leave no room between them.
    """
    mechanism = actuation.mechanism
    found: dict[tuple[str, int], Bound] = {}
    stated = [
        *_of_task("end_effector", [*mechanism.description.end_effector.coordinates], limits.end_effector),
        *_of_task("joints", mechanism.joints, limits.joints),
        *_of_drives(actuation),
        *(_of_tree(actuation) if limits.urdf else ()),
    ]
    for bound in stated:
        key = bound.quantity, bound.index
        found[key] = _tighter(found[key], bound) if key in found else bound
    return tuple(found.values())


def check_points(
    bounds: tuple[Bound, ...], ranges: np.ndarray, cycle: Cycle, mechanism: Mechanism, poses: Sequence[np.ndarray]
) -> None:
    """Refuse position limits that exclude an operating point, or its pose, one of `poses`, whatever its whole turns.

    Raises
    ------
    InputError : names the limit, or the point where a limit of the URDF excludes it.
    """
    positions = [bound for bound in bounds if bound.quantity in ("r_E", "q")]
    for (i, point), bound in product(enumerate(cycle.points), positions):
        if bound.of_end_effector:
            at, unit = point.at[bound.index], mechanism.end_effector_units[bound.index]
            turned = np.array([at])
        else:
            at, unit = float(poses[i][bound.index]), mechanism.units[bound.index]
            turned = mechanism.within(poses[i][:, None], ranges)[bound.index]
        if bound.excess(turned) <= POSED:
            continue
        stated = bound.stated[int(at > bound.upper)]
        of_task = stated.startswith("limits.")
        raise InputError(
            f"Operating point {i + 1} is excluded: '{bound.name}' is at {at:.4g} {unit} there, and its limits are "
            f"{bound.lower:g} to {bound.upper:g} {unit}" + ("." if of_task else f" ({stated})."),
            "Widen the limit, or move the point."
            if of_task
            else "Move the point, declare another assembly mode under 'seed' in mechanism.yaml, or switch the limits "
            "of the URDF off by 'limits: {urdf: false}'.",
            key=stated if of_task else f"cycle.points.{i}.at",
            value=[bound.lower, bound.upper] if of_task else list(point.at),
        )


def _of_task(group: str, names: list[str], limits: Limits) -> Iterator[Bound]:
    for name in limits.named:
        if name not in names:
            raise NameNotFound("axis" if group == "end_effector" else "joint", name, names, key=f"limits.{group}")
    for order, quantity in enumerate(MOTIONS[group]):
        for index, name in enumerate(names):
            lower, upper = limits.bounds(order, name)
            if np.isfinite(lower) or np.isfinite(upper):
                key = f"limits.{group}.{KEYS[order]}"
                key += f".{name}" if isinstance(getattr(limits, KEYS[order]), dict) else ""
                yield Bound(quantity, index, name, lower, upper, (key, key))


def _of_drives(actuation: Actuation) -> Iterator[Bound]:
    for key, quantity in DRIVES.items():
        for i, drive in enumerate(actuation.drives):
            if (largest := getattr(drive, key)) is not None:
                where = f"drives.{i}.{key}"
                yield Bound(quantity, i, actuation.labels[i], -largest, largest, (where, where))


def _of_tree(actuation: Actuation) -> Iterator[Bound]:
    """Positions and velocities of all joints; effort of the drives that state no torque of their own."""
    mechanism = actuation.mechanism
    for i, (name, own) in enumerate(zip(mechanism.joints, mechanism.limits, strict=True)):
        where = f"<limit> of joint '{name}' in {mechanism.description.origin.tree.name}"
        for quantity, lower, upper in (("q", own.lower, own.upper), ("dq", -own.velocity, own.velocity)):
            if np.isfinite(lower) or np.isfinite(upper):
                yield Bound(quantity, i, name, lower, upper, (where, where))
        for k, drive in enumerate(actuation.drives):
            if mechanism.actuated[k] == i and drive.torque is None and own.effort < inf:
                yield Bound("tau", k, actuation.labels[k], -own.effort, own.effort, (where, where))


def _tighter(a: Bound, b: Bound) -> Bound:
    low, high = max(a, b, key=lambda x: x.lower), min(a, b, key=lambda x: x.upper)
    if low.lower >= high.upper:
        raise InputError(
            f"This limit leaves '{a.name}' no room beside {b.stated[0]}, {b.lower:g} to {b.upper:g}.",
            "Widen one of the two, or switch those of the URDF off by 'limits: {urdf: false}'.",
            key=a.stated[0],
            value=[a.lower, a.upper],
        )
    return replace(a, lower=low.lower, upper=high.upper, stated=(low.stated[0], high.stated[1]))
