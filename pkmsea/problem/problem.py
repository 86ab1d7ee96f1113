"""The optimal control problem of one setup, before any discretisation (paper, section 4.3).

min over y(t), c   E = integral over one period of max(P, 0),   P = sum_i tau_i v_i + kappa_i tau_i^2
subject to         the robot's equations of motion (through its flat output y), y periodic,
                   the rest windows at every instant, and the limits of motion and drives.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import product
from pathlib import Path

import numpy as np

from pkmsea.actuation import Actuation, Drive
from pkmsea.description import find, shipped
from pkmsea.errors import InputError, Unreachable
from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.task import Cycle, Options, Setup, Task
from pkmsea.task.task import TaskLimits


@dataclass(frozen=True)
class Bound:
    """A box on one signal at every instant: `quantity` of `name` between lower and upper.

    quantity: r_E, dr_E, ddr_E (of an axis), q, dq, ddq (of a joint), tau or speed (of a drive); index in its order.
    """

    quantity: str
    index: int
    name: str
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class Problem:
    """One setup's problem: the robot, its cycle and its bounds."""

    task: Task
    setup: Setup
    actuation: Actuation
    bounds: tuple[Bound, ...]

    @property
    def cycle(self) -> Cycle:
        return self.task.cycle

    @property
    def options(self) -> Options:
        """The setup's own options, else the task's."""
        return self.setup.options or self.task.options

    @property
    def kappa(self) -> np.ndarray:
        """Copper loss per squared torque (m,)."""
        return self.actuation.numbers("copper_loss")

    @property
    def gear_ratios(self) -> tuple[float | None, ...]:
        """Motor turns per output turn of each drive (m); None where its numbers were given at the output side."""
        return tuple(drive.gear_ratio for drive in _per_joint(self.setup, self.actuation.m))

    @cached_property
    def span(self) -> np.ndarray:
        """Typical size of the motion per axis [m]: the spread of the operating points, at least a tenth of the
        largest spread."""
        at = np.array([point.at for point in self.cycle.points])
        spread = np.ptp(at, axis=0)
        return np.asarray(np.maximum(spread, 0.1 * max(spread.max(), 1e-6)))


def build_problem(task: Task, setup_name: str | None = None) -> Problem:
    """The problem of one setup of a task.

    Raises
    ------
    InputError : the setup does not fit its mechanism, or an operating point or rest window cannot be reached.
    """
    setup = task.setup(setup_name)
    where = {"file": task.file}
    source = task.mechanism_source(setup)
    if not os.path.exists(source) and Path(setup.mechanism).name not in shipped():
        raise InputError(
            "There is no mechanism folder of this name.",
            f"Give a folder, relative to the task file, or one that pkmsea ships: {', '.join(shipped())}.",
            file=task.file,
            key=f"setups.{task.setups.index(setup)}.mechanism",
            value=setup.mechanism,
        )
    mechanism = _unchanged(source)
    m = len(mechanism.actuated)
    drives = tuple(drive.at_output() for drive in _per_joint(setup, m))
    axes = [str(axis) for axis in mechanism.sidecar.end_effector.coordinates]
    if len(task.cycle.points[0].at) != len(axes):
        raise InputError(
            f"The operating points have {len(task.cycle.points[0].at)} coordinates, but the end effector of "
            f"'{mechanism.name}' moves along {', '.join(axes)}.",
            f"Give {len(axes)} coordinates.", key="cycle.points", **where,
        )  # fmt: skip
    actuation = Actuation(mechanism, drives, _check_reachable(task, mechanism), task.payload_mass)
    bounds = (
        *_bounds("end_effector", ("r_E", "dr_E", "ddr_E"), axes, task.limits, task),
        *_bounds("joints", ("q", "dq", "ddq"), mechanism.joints, task.limits, task),
        *_drive_bounds(actuation),
    )
    return Problem(task, setup, actuation, bounds)


def _per_joint(setup: Setup, m: int) -> tuple[Drive, ...]:
    """The setup's drives, the only one repeated for all m joints."""
    return setup.drives * m if len(setup.drives) == 1 else setup.drives


def _unchanged(source: Path) -> Mechanism:
    """The mechanism, loaded again only if a file beside it has changed: its Functions are shared by many problems."""
    found = find(source)
    folder = found if found.is_dir() else found.parent
    files = sorted(path for path in folder.iterdir() if path.is_file())
    return _loaded(source, tuple((path, path.stat().st_mtime_ns, path.stat().st_size) for path in files))


@lru_cache(maxsize=16)
def _loaded(source: Path, files: tuple[tuple[Path, int, int], ...]) -> Mechanism:
    return load_mechanism(source)


def _bounds(group: str, quantities: tuple[str, ...], names: list[str], limits: TaskLimits, task: Task) -> list[Bound]:
    limit = getattr(limits, group)
    for name in limit.named:
        if name not in names:
            raise InputError(
                f"There is no {'axis' if group == 'end_effector' else 'joint'} '{name}'.",
                f"Use one of: {', '.join(names)}.", file=task.file, key=f"limits.{group}",
            )  # fmt: skip
    found = []
    for order, quantity in enumerate(quantities):
        for index, name in enumerate(names):
            lower, upper = limit.bounds(order, name)
            if np.isfinite(lower) or np.isfinite(upper):
                found.append(Bound(quantity, index, name, lower, upper))
    return found


def _drive_bounds(actuation: Actuation) -> list[Bound]:
    return [
        Bound(quantity, i, actuation.labels[i], -largest, largest)
        for quantity, key in (("tau", "torque"), ("speed", "speed"))
        for i, drive in enumerate(actuation.drives)
        if (largest := getattr(drive, key)) is not None
    ]


def _check_reachable(task: Task, mechanism: Mechanism) -> tuple[np.ndarray, ...]:
    """Poses of all operating points; they and every corner of their windows must be reachable."""
    poses = []
    for i, point in enumerate(task.cycle.points):
        corners = product(*[(-1.0, 0.0, 1.0)] * len(point.at))
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
                    file=task.file, key=f"cycle.points.{i}.at", value=list(point.at),
                ) from None  # fmt: skip
    return tuple(poses)
