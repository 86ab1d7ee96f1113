"""Poses of a closed mechanism: closing the loops, following the end effector, and the distance to singularities."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from pkmsea.errors import InputError, Unreachable
from pkmsea.mechanism.closed_tree import ClosedTree
from pkmsea.mechanism.conditioning import Conditioning

Closure = Callable[[np.ndarray], Any]  # q to (Phi, G)

TOLERANCE = 1e-12  # of closures, without units, and of end-effector positions up to 1 m [m]; four digits above rounding
ITERATIONS = 30
SAMPLES = 12  # closed poses at which the mobility is taken
SCATTER = 0.4  # their spread in the joints [rad; of sliders, characteristic lengths]
RESOLUTION, COARSE = 2e-5, 1e-2  # of a way; of one to a place that need not be reached
DETOURS = 16  # places by way of which a point is looked for that lies in no straight line
SMALL = 0.05  # a step to a neighbouring pose [rad; of sliders, characteristic lengths]


def close(closure: Closure, guess: np.ndarray, units: np.ndarray | float = 1.0) -> np.ndarray | None:
    """The closed pose nearest to a guess, by Gauss-Newton steps of least norm; None where there is none near.

    `closure` gives Phi and its Jacobian for coordinates q / units.
    """
    q = guess.astype(float)
    for _ in range(ITERATIONS):
        Phi, G = (np.array(x) for x in closure(q))
        if Phi.size == 0 or np.abs(Phi).max() < TOLERANCE:
            return q
        if not (np.all(np.isfinite(Phi)) and np.all(np.isfinite(G))):
            return None
        step = np.linalg.lstsq(G, -Phi.ravel(), rcond=1e-10)[0]
        largest = np.abs(step).max()
        if not 0 < largest < np.inf:
            return None
        q = q + units * step * min(1.0, 0.5 / largest)
    return None


def scatter(closure: Closure, seed: np.ndarray, units: np.ndarray) -> list[np.ndarray]:
    """Closed poses around the seed, from a fixed random sequence."""
    rng = np.random.default_rng(0)
    tries = (close(closure, seed + units * rng.uniform(-SCATTER, SCATTER, seed.size), units) for _ in range(SAMPLES))
    return [q for q in tries if q is not None]


@lru_cache(maxsize=32)
def task_system(mechanism: ClosedTree) -> ca.Function:
    """(Psi, A)(q) with Psi = [Phi; r_E] and A = dPsi/dq, (n, n): A v = [0; dr_E/dt]."""
    axes, delta = len(mechanism.description.end_effector.coordinates), mechanism.mobility
    if axes != delta:
        raise InputError(
            f"The end effector is followed in {axes} coordinates, but the mechanism has mobility {delta}.",
            f"Name {delta} axes (or joints), so that the end effector determines the pose.",
            file=mechanism.folder / "mechanism.yaml",
            key="end_effector",
        )
    q = ca.SX.sym("q", mechanism.model.nq)
    f = mechanism.functions
    Psi = ca.vertcat(f["closure_residual"](q), f["end_effector"](q))
    A = ca.vertcat(f["closure_jacobian"](q), f["end_effector_jacobian"](q))
    return ca.Function("task_system", [q], [Psi, ca.densify(A)], ["q"], ["Psi", "A"])


@lru_cache(maxsize=32)
def pose_gap(mechanism: ClosedTree) -> ca.Function:
    """(q, y) -> A, gap, gap: how far Psi(q) is off [0; y]; Newton's step towards it is A^-1 gap."""
    q, y = ca.SX.sym("q", mechanism.model.nq), ca.SX.sym("y", mechanism.mobility)
    Psi, A = task_system(mechanism)(q)
    gap = ca.densify(ca.vertcat(ca.SX.zeros(q.numel() - y.numel()), y) - Psi)
    return ca.Function("pose_gap", [q, y], ca.cse([A, gap, gap]), ["q", "y"], ["A", "gap", "right"])


def follow(mechanism: ClosedTree, point: np.ndarray, detours: bool = True) -> np.ndarray:
    """Continuation from the seed to `point` (see `Mechanism.configuration`), straight or by detours."""
    start = mechanism.end_effector(mechanism.seed)
    if point.shape != start.shape or not np.all(np.isfinite(point)):
        raise InputError(
            f"A point of this mechanism has {start.size} finite coordinates "
            f"({', '.join(mechanism.description.end_effector.coordinates)}).",
            "Give them in m (rad for joints).",
            key="point",
            value=point.tolist(),
        )
    q, done = walk(mechanism, mechanism.seed, point)
    if done == 1.0:
        return q
    around = _around(mechanism, point) if detours and point.size > 1 else None
    if around is None:
        raise _unreachable(mechanism, point, start + done * (point - start))
    return around


def _around(mechanism: ClosedTree, point: np.ndarray) -> np.ndarray | None:
    """The pose at a point by way of places that a fixed random sequence draws around the straight way; None where all
    lead nowhere. Each way begins at the nearest place that is known."""
    rng, start = np.random.default_rng(0), mechanism.end_effector(mechanism.seed)
    poses, places = [mechanism.seed], [start]
    middle, far = (start + point) / 2, float(np.linalg.norm(point - start))
    for target in middle + far * rng.uniform(-1, 1, (DETOURS, point.size)):
        nearest = int(np.argmin([np.linalg.norm(place - target) for place in places]))
        poses.append(walk(mechanism, poses[nearest], target, resolution=COARSE)[0])
        places.append(mechanism.end_effector(poses[-1]))
        q, done = walk(mechanism, poses[-1], point)
        if done == 1.0:
            return q
    return None


def walk(
    mechanism: ClosedTree,
    q: np.ndarray,
    point: np.ndarray,
    allowed: Callable[[np.ndarray], bool] = lambda q: True,
    resolution: float = RESOLUTION,
) -> tuple[np.ndarray, float]:
    """The pose farthest on the straight line from pose q to `point`, and its share of the way (to `resolution`).

    Steps shrink where the pose turns quickly; the sign of det A may not change, and `allowed` must hold.
    """
    system, start = task_system(mechanism), mechanism.end_effector(q)
    sign = np.sign(np.linalg.det(np.array(system(q)[1])))
    done, step = 0.0, 1.0
    while done < 1.0 and step >= resolution:
        target = start + min(done + step, 1.0) * (point - start)
        found = newton(system, q, target)
        if found is not None and np.sign(np.linalg.det(np.array(system(found)[1]))) == sign and allowed(found):
            q, done, step = found, min(done + step, 1.0), 2 * step
        else:
            step /= 2
    return q, done


def newton(system: ca.Function, q: np.ndarray, target: np.ndarray) -> np.ndarray | None:
    """Solve Psi(q) = [0; target] near q; None where a step is larger than a branch is wide, or none converges."""
    goal = np.concatenate([np.zeros(q.size - target.size), target])
    for _ in range(ITERATIONS):
        Psi, A = (np.array(x) for x in system(q))
        gap = goal - Psi.ravel()
        if np.abs(gap).max() < TOLERANCE * max(1.0, float(np.abs(goal).max())):
            return q
        try:
            step = np.linalg.solve(A, gap)
        except np.linalg.LinAlgError:
            return None
        if not np.all(np.isfinite(step)) or np.abs(step).max() > 0.5:
            return None
        q = q + step
    return None


def _unreachable(mechanism: ClosedTree, point: np.ndarray, reached: np.ndarray) -> Unreachable:
    return Unreachable(
        f"The mechanism '{mechanism.name}' cannot reach the point {_text(point)} on its assembly mode; on the way "
        f"from its seed it gets as far as {_text(reached)}.",
        "Move the point into the workspace ('pkmsea check' prints it), or declare another assembly mode under 'seed'.",
        key="point",
    )


def _text(point: np.ndarray) -> str:
    return "[" + ", ".join(f"{x:.4g}" for x in point) + "]"


def singularity(mechanism: ClosedTree, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distances to singularities of type 1 and 2 at poses q (k, n), see `Mechanism.singularity`."""
    measure = Conditioning(mechanism.model, mechanism.description, mechanism.length)
    follower = mechanism.description.end_effector
    followed = [mechanism.joints.index(name) for name in follower.joints]
    axes = ["xyz".index(axis) for axis in follower.axes]
    inverse = [measure.of_joints(x, followed) if followed else measure.of_point(x, follower.frame, axes) for x in q]
    return np.array(inverse), np.array([measure.of_joints(x, mechanism.actuated) for x in q])
