"""The drives around a mechanism, and the flat output that describes the whole robot."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Literal

import casadi as ca
import numpy as np

from pkmsea.actuation.drive import Drive, as_range
from pkmsea.errors import InputError, one_line
from pkmsea.mechanism import Mechanism, pose

RIGID_PENALTY = 0.1


@dataclass(frozen=True)
class Shape:
    """What a robot's Functions are built for; all its numbers are inputs of theirs, so that robots can share them.

    `elastic` are the series elastic drives, `free` those whose coordinate belongs to the flat output, `cubic` those
    whose spring hardens, `damped` those whose spring has losses, `parallel` those with a spring beside them; `payload`:
    whether the end effector carries one.
    """

    mechanism: Mechanism
    elastic: tuple[int, ...]
    free: tuple[int, ...]
    cubic: tuple[int, ...] = ()
    parallel: tuple[int, ...] = ()
    payload: bool = False
    damped: tuple[int, ...] = ()

    @property
    def m(self) -> int:
        """Number of drives."""
        return len(self.mechanism.actuated)

    @property
    def dependent(self) -> list[int]:
        """The delta drives whose forces follow from the load equation."""
        return [i for i in range(self.m) if i not in self.free]


@dataclass(frozen=True)
class Parameter:
    """A number of the robot that is a variable of the optimisation, fixed where low equals high.

    `kind` is c (series stiffness), k or rest (of the parallel spring); stiffnesses are optimised by their logarithm.
    """

    kind: Literal["c", "k", "rest"]
    drive: int
    label: str
    low: float
    high: float

    @property
    def logarithmic(self) -> bool:
        return self.kind != "rest"

    @property
    def name(self) -> str:
        return f"ln {self.kind} {self.label}" if self.logarithmic else f"{self.kind} {self.label}"

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of the variable."""
        return (float(np.log(self.low)), float(np.log(self.high))) if self.logarithmic else (self.low, self.high)


NUMBERS = ("inertia", "friction", "coulomb", "coulomb_width", "cubic")  # r holds each for all drives


@dataclass(frozen=True, eq=False, repr=False)
class Actuation:
    """A mechanism with m drives; rigid and series elastic ones may be mixed, and m may exceed the mobility delta.

    The flat output is y = (r_E, z). The load equation in task space, N_A^T u = N^T rnea(q, v, a) with v = N dr_E/dt
    and N_A its rows at the drives, fixes the forces u of delta `dependent` drives. Each of the m - delta `free` drives
    adds one entry to z: its motor position q_M if it is elastic, its force u if its spring is damped, its torque tau if
    it is rigid.

    `poses` (n,) each, are where the robot works; by default the mechanism's seed. `payload` gives the mass at the end
    effector [kg] and its derivatives: (times, order) -> (len(times),).
    """

    mechanism: Mechanism
    drives: tuple[Drive, ...]
    poses: tuple[np.ndarray, ...] = ()
    payload: Callable[[np.ndarray, int], np.ndarray] | None = None

    def __post_init__(self) -> None:
        m, delta = len(self.mechanism.actuated), self.mechanism.mobility
        if len(self.drives) != m:
            raise InputError(
                f"{len(self.drives)} drives are given, but '{self.mechanism.name}' has {m} actuated joints.",
                "Give one drive for all, or one per actuated joint in the order of mechanism.yaml.", key="drives",
            )  # fmt: skip
        if m < delta:
            raise InputError(
                f"'{self.mechanism.name}' is underactuated: {m} drives for mobility {delta}; its motion is not free "
                "to choose.",
                "Add drives under 'actuated' in mechanism.yaml.", key="actuated",
            )  # fmt: skip

    def __repr__(self) -> str:
        kinds = ", ".join(f"{label} {drive.kind}" for label, drive in zip(self.labels, self.drives, strict=True))
        return one_line(f"<Actuation of '{self.mechanism.name}', drives: {kinds}>")

    @property
    def m(self) -> int:
        return len(self.drives)

    @cached_property
    def labels(self) -> list[str]:
        """One name per drive: its joint's, numbered where a joint carries several."""
        names = self.mechanism.description.actuated
        return [
            name if names.count(name) == 1 else f"{name} {names[: i + 1].count(name)}" for i, name in enumerate(names)
        ]

    @cached_property
    def free(self) -> list[int]:
        """The m - delta drives whose motor coordinate or torque belongs to the flat output.

        The paper takes the first drive; where the others come near a singularity, its force would jump. So the free
        drives are those that leave the best conditioned rest: the largest |det| of N_A's dependent rows, at the worst
        of the poses; elastic drives are preferred unless they are ten times worse, and the first ones among equals.
        """
        m, delta = self.m, self.mechanism.mobility
        jacobians = np.array([self._drive_jacobian(q) for q in self.poses or (self.mechanism.seed,)])

        def score(chosen: Iterable[int]) -> float:
            rest = [i for i in range(m) if i not in chosen]
            worst = float(np.abs(np.linalg.det(jacobians[:, rest])).min())
            return round(float(worst * RIGID_PENALTY ** sum(not self.drives[i].elastic for i in chosen)), 9)

        return list(max(combinations(range(m), m - delta), key=score))

    @cached_property
    def shape(self) -> Shape:
        """This robot without its numbers."""
        cubic = tuple(i for i, drive in enumerate(self.drives) if drive.cubic)
        parallel = tuple(i for i, drive in enumerate(self.drives) if drive.parallel)
        payload = self.payload is not None
        return Shape(
            self.mechanism, tuple(self.elastic), tuple(self.free), cubic, parallel, payload, tuple(self.damped)
        )

    @cached_property
    def damped(self) -> list[int]:
        """The elastic drives whose spring has losses."""
        return [i for i, drive in enumerate(self.drives) if drive.damping]

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Stiffness of each elastic drive; then stiffness and rest position of each parallel spring."""
        series = [Parameter("c", i, self.labels[i], *self.drives[i].stiffness_range) for i in self.elastic]
        beside = [
            parameter
            for i, drive in enumerate(self.drives)
            if (spring := drive.parallel) is not None
            for parameter in (
                Parameter("k", i, self.labels[i], *as_range(spring.stiffness)),
                Parameter("rest", i, self.labels[i], *as_range(spring.rest)),
            )
        ]
        return (*series, *beside)

    def load(self, t: np.ndarray) -> np.ndarray:
        """Mass at the end effector at times t [kg], (len(t),)."""
        return np.zeros(t.size) if self.payload is None else self.payload(t, 0)

    @cached_property
    def elastic(self) -> list[int]:
        """The series elastic drives."""
        return [i for i, drive in enumerate(self.drives) if drive.elastic]

    @cached_property
    def flat_outputs(self) -> list[str]:
        """Names of the flat output's entries."""
        axes = [f"{axis}_E" for axis in self.mechanism.description.end_effector.coordinates]
        kinds = ["u" if i in self.damped else "q_M" if i in self.elastic else "tau" for i in range(self.m)]
        return axes + [f"{kinds[i]} {self.labels[i]}" for i in self.free]

    def relative_degree(self) -> tuple[int, ...]:
        """Vector relative degree of the flat output, found by Lie derivatives (Isidori, 1995).

        Entry i is the number of time derivatives of y_i until an input tau occurs first; zero where y_i is a torque.
        """
        from pkmsea.actuation.degree import relative_degree

        return relative_degree(self)

    def numbers(self, key: str) -> np.ndarray:
        """One number of every drive (m,), such as `inertia`, `friction`, `copper_loss`."""
        return np.array([getattr(drive, key) for drive in self.drives])

    def _drive_jacobian(self, q: np.ndarray) -> np.ndarray:
        """N_A(q), (m, delta): v_A = N_A dr_E/dt."""
        A = np.array(pose.task_system(self.mechanism)(q)[1])
        N = np.linalg.solve(A, np.eye(A.shape[0])[:, A.shape[0] - self.mechanism.mobility :])
        return np.asarray(N[self.mechanism.actuated])


def stack(expressions: list[ca.SX]) -> ca.SX:
    """Vertical stack that stays a column when it is empty."""
    return ca.densify(ca.vertcat(*expressions)) if expressions else ca.SX(0, 1)


def on_joints(u: ca.SX, at: list[int], n: int) -> ca.SX:
    """S_A^T u: the drives' forces on the joints (n,)."""
    result = ca.SX(n, 1)
    for i, joint in enumerate(at):
        result[joint] += u[i]
    return result


def dependent_columns(shape: Shape) -> ca.DM:
    """Columns of S_A^T that belong to the dependent drives, (n, delta)."""
    S = ca.DM(shape.mechanism.model.nq, len(shape.dependent))
    for column, i in enumerate(shape.dependent):
        S[shape.mechanism.actuated[i], column] = 1
    return S
