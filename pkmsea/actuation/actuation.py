"""The drives around a mechanism, and the flat output that describes the whole robot."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from math import prod

import casadi as ca
import numpy as np

from pkmsea.actuation.degree import relative_degree
from pkmsea.actuation.drive import Drive, ParameterKind
from pkmsea.actuation.flat_map import flat_map
from pkmsea.actuation.kinds import Kind, kind_of
from pkmsea.actuation.laws import NUMBERS
from pkmsea.actuation.structure import Structure
from pkmsea.errors import InputError, one_line
from pkmsea.mechanism import Mechanism, pose


@dataclass(frozen=True)
class Parameter:
    """A number of the robot that is a variable of the optimisation, fixed where low equals high.

    `kind` is c (series stiffness), k or rest (of the parallel spring); stiffnesses are optimised by their logarithm.
    """

    kind: ParameterKind
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


@dataclass(frozen=True, eq=False, repr=False)
class Actuation:
    """A mechanism with m drives; rigid and series elastic ones may be mixed, and m may exceed the mobility delta.

    The flat output is y = (r_E, z). The load equation in task space, N_A^T u = N^T rnea(q, v, a) with v = N dr_E/dt
    and N_A its rows at the drives, fixes the forces u of delta `dependent` drives. Each of the m - delta `free` drives
    adds one entry to z: its motor position q_M if it is elastic, its force u if its spring is damped, its torque tau if
    it is rigid (`pkmsea.actuation.kinds`).

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
                "Give one drive for all, or one per actuated joint in the order of mechanism.yaml.",
                key="drives",
            )
        if m < delta:
            raise InputError(
                f"'{self.mechanism.name}' is underactuated: {m} drives for mobility {delta}; its motion is not free "
                "to choose.",
                "Add drives under 'actuated' in mechanism.yaml.",
                key="actuated",
            )

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
            return round(worst / prod(self.kinds[i].reluctance for i in chosen), 9)

        return list(max(combinations(range(m), m - delta), key=score))

    @cached_property
    def structure(self) -> Structure:
        """This robot without its numbers."""
        parallel = tuple(i for i, drive in enumerate(self.drives) if drive.parallel)
        return Structure(self.mechanism, self.kinds, tuple(self.free), parallel, self.payload is not None)

    @cached_property
    def kinds(self) -> tuple[Kind, ...]:
        """The kind of each drive (m)."""
        return tuple(kind_of(drive) for drive in self.drives)

    @cached_property
    def parameters(self) -> tuple[Parameter, ...]:
        """Stiffness of each elastic drive; then stiffness and rest position of each parallel spring."""
        return tuple(
            Parameter(kind, i, self.labels[i], *self.drives[i].range_of(kind)) for kind, i in self.structure.parameters
        )

    def load(self, t: np.ndarray) -> np.ndarray:
        """Mass at the end effector at times t [kg], (len(t),)."""
        return np.zeros(t.size) if self.payload is None else self.payload(t, 0)

    @cached_property
    def elastic(self) -> list[int]:
        """The series elastic drives."""
        return [i for i, kind in enumerate(self.kinds) if kind.sprung]

    @cached_property
    def flat_outputs(self) -> list[str]:
        """Names of the flat output's entries."""
        axes = [f"{axis}_E" for axis in self.mechanism.description.end_effector.coordinates]
        return axes + [f"{self.kinds[i].coordinate} {self.labels[i]}" for i in self.free]

    def relative_degree(self) -> tuple[int, ...]:
        """Vector relative degree of the flat output, found by Lie derivatives (Isidori, 1995).

        Entry i is the number of time derivatives of y_i until an input tau occurs first; zero where y_i is a torque.
        """
        return relative_degree(self.structure, self.drives)

    def flat_map(self) -> ca.Function:
        """(q, Y, Z, c, k, rest, L) -> q_M, v_M, tau, u, v, a: `pkmsea.flat_map` with this robot's numbers in place.

        q (n,) is the pose that satisfies `pose_equation`; Y (delta, 5) is r_E and four time derivatives, Z (m - delta,
        3) the free drives' coordinates and two, c (m,) the stiffnesses. Called with keywords, what the robot does not
        have can be left out: free drives, springs in parallel (k, rest), the payload (L). For NLPs of one's own.
        """
        exact = flat_map(self.structure)
        names = exact.name_in()[:-1]
        given = [ca.SX.sym(name, *exact.size_in(name)) for name in names]
        return ca.Function("flat_map", given, exact.call([*given, ca.SX(self.r)]), names, exact.name_out())

    def pose_equation(self) -> ca.Function:
        """(q, y) -> Psi(q) - [0; y] (n,): zero where the loops are closed and the end effector is at y (delta,)."""
        n, delta = self.mechanism.model.nq, self.mechanism.mobility
        q, y = ca.SX.sym("q", n), ca.SX.sym("y", delta)
        gap = pose.task_system(self.mechanism)(q)[0] - ca.vertcat(ca.SX(n - delta, 1), y)
        return ca.Function("pose_equation", [q, y], [ca.densify(gap)], ["q", "y"], ["gap"])

    def numbers(self, key: str) -> np.ndarray:
        """One number of every drive (m,), such as `inertia`, `friction`, `copper_loss`."""
        return np.array([getattr(drive, key) for drive in self.drives])

    @cached_property
    def r(self) -> np.ndarray:
        """NUMBERS of all drives, one after the other."""
        return np.concatenate([self.numbers(key) for key in NUMBERS])

    @cached_property
    def each(self) -> list[dict[str, float]]:
        """NUMBERS of each drive, by name (m)."""
        return [{key: getattr(drive, key) for key in NUMBERS} for drive in self.drives]

    def _drive_jacobian(self, q: np.ndarray) -> np.ndarray:
        """N_A(q), (m, delta): v_A = N_A dr_E/dt."""
        A = np.array(pose.task_system(self.mechanism)(q)[1])
        N = np.linalg.solve(A, np.eye(A.shape[0])[:, A.shape[0] - self.mechanism.mobility :])
        return np.asarray(N[self.mechanism.actuated])
