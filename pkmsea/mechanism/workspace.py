"""The workspace of a mechanism on its assembly mode, by flooding a grid from the seed."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from pkmsea.mechanism import pose
from pkmsea.mechanism.mechanism import Mechanism

RAYS = 24  # along which the extent is probed
STROKE = 20.0  # of a sliding joint without limits [m]
CELLS = 64  # of the grid, across the larger extent


@dataclass(frozen=True, eq=False)
class Workspace:
    """Reachable points of a planar end effector on a grid (ny, nx).

    Attributes
    ----------
    x, y : grid coordinates [m].
    reachable : mask.
    direct : signed determinant of [G; S_A] where m = delta, else the reciprocal condition number (type 2 singularity);
        NaN where not reachable.
    """

    x: np.ndarray
    y: np.ndarray
    reachable: np.ndarray
    direct: np.ndarray


def reach(mechanism: Mechanism, direction: np.ndarray) -> float:
    """How far the end effector gets from the seed along a direction [m, rad], within `extent`; to 1e-4 of it.

    Ends at the workspace's border or at a joint limit of the URDF, if the seed keeps that.
    """
    moving = np.abs(direction) > 0
    far = float((extent(mechanism)[moving] / np.abs(direction[moving])).min())
    lower = np.minimum(mechanism.model.lowerPositionLimit, mechanism.seed)
    upper = np.maximum(mechanism.model.upperPositionLimit, mechanism.seed)
    end = mechanism.end_effector(mechanism.seed) + far * direction
    return far * pose.walk(mechanism, mechanism.seed, end, lambda q: bool(np.all((q >= lower) & (q <= upper))))[1]


def extent(mechanism: Mechanism) -> np.ndarray:
    """What each coordinate of the end effector cannot move beyond: the sum of all placements and strokes [m].

    Where joints are followed, a turn [rad] or the stroke [m] of each.
    """
    model, follower = mechanism.model, mechanism.description.end_effector
    strokes = np.minimum(model.upperPositionLimit - model.lowerPositionLimit, STROKE)
    strokes = np.where(mechanism.revolute, 0.0, strokes)
    if follower.joints:
        own = np.where(mechanism.revolute, 2 * np.pi, strokes)
        return own[[mechanism.joints.index(name) for name in follower.joints]]
    lengths = [float(np.linalg.norm(placement.translation)) for placement in model.jointPlacements]
    lengths += [float(np.linalg.norm(frame.placement.translation)) for frame in model.frames]
    return np.full(len(follower.axes), sum(lengths) + float(strokes.sum()))


def workspace(mechanism: Mechanism) -> Workspace:
    """Flood the grid from the seed; the mechanism must have a planar end effector."""
    center = mechanism.end_effector(mechanism.seed)
    angles = np.linspace(0, 2 * np.pi, RAYS, endpoint=False)
    rays = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    ends = center + rays * np.array([reach(mechanism, ray) for ray in rays])[:, None]
    margin = 0.15 * np.ptp(ends, axis=0)
    low, high = ends.min(axis=0) - margin, ends.max(axis=0) + margin
    step = float((high - low).max()) / CELLS
    x, y = (np.arange(low[i], high[i] + step, step) for i in range(2))
    poses = _flood(mechanism, x, y, center)
    reachable = np.zeros((y.size, x.size), bool)
    direct = np.full((y.size, x.size), np.nan)
    if poses:
        cells = np.array(list(poses))
        rows, columns = cells.T
        reachable[rows, columns] = True
        direct[rows, columns] = _direct(mechanism, np.array(list(poses.values())))
    return Workspace(x, y, reachable, direct)


def _flood(mechanism: Mechanism, x: np.ndarray, y: np.ndarray, center: np.ndarray) -> dict[tuple[int, int], np.ndarray]:
    system = pose.task_system(mechanism)
    sign = np.sign(np.linalg.det(np.array(system(mechanism.seed)[1])))
    first = int(np.abs(y - center[1]).argmin()), int(np.abs(x - center[0]).argmin())
    start = pose.newton(system, mechanism.seed, np.array([x[first[1]], y[first[0]]]))
    if start is None:
        return {}
    poses, queue = {first: start}, deque([first])
    while queue:
        i, j = queue.popleft()
        for cell in ((i + 1, j), (i - 1, j), (i, j + 1), (i, j - 1)):
            if cell in poses or not (0 <= cell[0] < y.size and 0 <= cell[1] < x.size):
                continue
            q = pose.newton(system, poses[i, j], np.array([x[cell[1]], y[cell[0]]]))
            if q is not None and np.sign(np.linalg.det(np.array(system(q)[1]))) == sign:
                poses[cell] = q
                queue.append(cell)
    return poses


def _direct(mechanism: Mechanism, q: np.ndarray) -> np.ndarray:
    if len(mechanism.actuated) != mechanism.mobility:
        return pose.singularity(mechanism, q)[1]
    n = mechanism.model.nq
    G = np.array(mechanism.functions["closure_jacobian"].map(q.shape[0])(q.T)).reshape(-1, q.shape[0], n)
    select = np.broadcast_to(np.eye(n)[mechanism.actuated], (q.shape[0], mechanism.mobility, n))
    return np.asarray(np.linalg.det(np.concatenate([G.transpose(1, 0, 2), select], axis=1)))
