"""Closing the loops: a seed, the rows of Phi that are independent, and so the mobility, by rank at generic poses."""

from __future__ import annotations

from collections.abc import Callable

import casadi as ca
import numpy as np
import pinocchio as pin

from pkmsea.description import Description
from pkmsea.errors import MechanismError
from pkmsea.mechanism import plane, pose
from pkmsea.mechanism.closures import Equations
from pkmsea.mechanism.conditioning import Conditioning, reciprocal_condition, turning
from pkmsea.mechanism.loops import Loops, independent_rows

DOUBTFUL = 1e-6  # between the two, a rank comes from rounded numbers of a CAD export
SINGULAR = 1e-8  # conditioning of a pose that is of no use as a seed
IMPLIED = 1e-8  # rows that were left out must be closed to this where the others are
SEARCH = 60  # random poses from which a seed is proposed
NEAR = 0.2  # the neutral pose is preferred down to this share of the best one's value
LIMIT = 2.0  # joints turn at most so far from zero in the search [rad; of sliders, characteristic lengths]


Worth = Callable[[np.ndarray, int], float]  # of a pose q of a mechanism with mobility delta


def close_loops(
    every_row: Equations,
    sense: ca.Function,
    model: pin.Model,
    description: Description,
    measure: Conditioning,
    worth: Worth | None,
) -> Loops:
    """Close the loops from the declared seed, else from the neutral pose; with `worth`, propose a seed if needed: a
    pose away from singularities at which the end effector can follow the motion.

    Raises
    ------
    MechanismError : the loops do not close, the seed is singular, closures contradict each other, nothing can move.
    """
    joints = list(model.names)[1:]
    declared = dict(description.seed or ())
    guess = np.array([declared.get(name, 0.0) for name in joints])
    seed = _closed(every_row, sense, guess)
    far = _spread(every_row, sense, model, description) if worth and description.seed is None else []
    if seed is None and not far:
        raise plane.open_across(model, description) or _stays_open(every_row, guess, description)
    start = far[0] if seed is None else seed
    poses = [*([] if seed is None else [seed]), *_scatter(every_row, sense, start), *far]
    rows = _fixed_rows(every_row, poses, model, description)
    if len(rows) == model.nq:
        raise MechanismError(
            "The closed mechanism cannot move.",
            plane.remedy(model, description) or "Remove a closure, a coupling, or a lock.",
            **description.where("closures"),
        )
    proposed = False
    if far and worth:
        value = [worth(q, model.nq - len(rows)) for q in poses]
        if seed is None or value[0] < NEAR * max(value):
            start, proposed = _inside(poses, value, model), True
    if _quality(every_row, start, rows) < SINGULAR:
        raise MechanismError(
            "The seed pose is singular: the loops lose rank there."
            if description.seed
            else "No seed is declared, and the neutral pose is singular.",
            "Give joint positions near a generic closed pose ('pkmsea check' proposes one where none is declared).",
            **description.where("seed"),
        )
    near = [start, *_scatter(every_row, sense, start)]
    generic = [q for q in near if _quality(every_row, q, rows) > SINGULAR]
    _check_implied(every_row, rows, generic, description)
    G = np.array([every_row(q)[1][rows] for q in generic])
    return Loops(start, proposed, rows, np.array(generic), G, measure)


def _closed(every_row: Equations, sense: ca.Function, guess: np.ndarray) -> np.ndarray | None:
    q = pose.close(every_row, guess, every_row.units)
    return q if q is not None and np.all(np.array(sense(q)) > 0) else None


def _scatter(every_row: Equations, sense: ca.Function, seed: np.ndarray) -> list[np.ndarray]:
    return [q for q in pose.scatter(every_row, seed, every_row.units) if np.all(np.array(sense(q)) > 0)]


def _spread(every_row: Equations, sense: ca.Function, model: pin.Model, description: Description) -> list[np.ndarray]:
    """Closed poses all over the joints' ranges, from a fixed random sequence."""
    rng = np.random.default_rng(0)
    far = LIMIT * every_row.units
    low, high = np.maximum(model.lowerPositionLimit, -far), np.minimum(model.upperPositionLimit, far)
    starts = rng.uniform(low, np.maximum(low, high), (SEARCH, model.nq))
    found = [q for q in (_closed(every_row, sense, start) for start in starts) if q is not None]
    return found if description.couplings else [_wrap(q, model) for q in found]


def _wrap(q: np.ndarray, model: pin.Model) -> np.ndarray:
    """The same pose with the angles of revolute joints between -pi and pi, where the limits allow it."""
    wrapped = np.where(turning(model), (q + np.pi) % (2 * np.pi) - np.pi, q)
    allowed = (wrapped >= model.lowerPositionLimit) & (wrapped <= model.upperPositionLimit)
    return np.asarray(np.where(allowed, wrapped, q))


def _quality(every_row: Equations, q: np.ndarray, rows: list[int]) -> float:
    """Smallest over largest singular value of the rows that are kept; 1 in an open chain."""
    if not rows:
        return 1.0
    return float(reciprocal_condition(every_row(q)[1][rows]))


def _inside(poses: list[np.ndarray], value: list[float], model: pin.Model) -> np.ndarray:
    """The pose of most value, of those inside the joint limits if there are any."""
    inside = [bool(np.all((q >= model.lowerPositionLimit) & (q <= model.upperPositionLimit))) for q in poses]
    return poses[max(range(len(poses)), key=lambda i: (inside[i] or not any(inside), value[i]))]


def _fixed_rows(every_row: Equations, poses: list[np.ndarray], model: pin.Model, description: Description) -> list[int]:
    """Rows of largest rank, well conditioned at most of the poses."""
    jacobians = [every_row(q)[1] for q in poses]
    ranked = [independent_rows(G) for G in jacobians]
    rank = max(len(rows) for rows, _ in ranked)
    candidates = {tuple(rows): margin for rows, margin in ranked if len(rows) == rank}
    if rank and max(candidates.values()) < DOUBTFUL:
        raise MechanismError(
            f"The closures are almost dependent (by a part in {1 / max(candidates.values()):.0e}), as rounded numbers "
            "make them, so that the mobility is in doubt.",
            plane.remedy(model, description) or "Use closures of fewer rows (type point), or more digits.",
            **description.where("closures"),
        )
    if not rank:
        return []
    return list(max(candidates, key=lambda rows: np.median([reciprocal_condition(G[list(rows)]) for G in jacobians])))


def _check_implied(every_row: Equations, rows: list[int], poses: list[np.ndarray], description: Description) -> None:
    """Where the kept rows are closed, so must be the others; else they meet at single poses only."""
    if len(rows) == every_row.lengths.size:
        return

    def kept(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        Phi, G = every_row(q)
        return Phi[rows], G[rows]

    for q in poses[:3]:
        moved = pose.close(kept, q + every_row.units * pose.SMALL * np.cos(np.arange(q.size)), every_row.units)
        if moved is not None and np.abs(every_row(moved)[0]).max() > IMPLIED:
            raise MechanismError(
                "Some closures hold together at single poses only.",
                "Check frames and axes; use type point where a revolute or frame closure asks too much.",
                **description.where("closures"),
            )


def _stays_open(every_row: Equations, guess: np.ndarray, description: Description) -> MechanismError:
    gap = float(np.abs(every_row(guess)[0] * every_row.lengths).max(initial=0.0))
    start = "the seed pose" if description.seed else "the neutral pose, and no seed is declared"
    return MechanismError(
        f"The loops do not close from {start}; they stay open by up to {gap:.3g} m there.",
        "Give joint positions near a closed pose under 'seed'; check frames, types and plane of the closures.",
        **description.where("seed"),
    )
