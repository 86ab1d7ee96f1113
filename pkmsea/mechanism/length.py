"""A mechanism's characteristic length: what lengths are divided by, to be compared with angles."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

import numpy as np
import pinocchio as pin

from pkmsea.bridge import frame_id


def characteristic_length(model: pin.Model, frames: Iterable[str]) -> float:
    """The length of the longest link [m]: the largest distance on one link between two of its joints and of `frames`.

    It depends neither on the pose nor on where loops are opened. 1 where all distances are zero.
    """
    points: dict[int, list[np.ndarray]] = {i: [np.zeros(3)] if i else [] for i in range(model.njoints)}
    for i in range(1, model.njoints):
        points[model.parents[i]].append(model.jointPlacements[i].translation)
    for name in frames:
        frame = model.frames[frame_id(model, name)]
        points[frame.parentJoint].append(frame.placement.translation)
    lengths = [float(np.linalg.norm(a - b)) for on in points.values() for a, b in combinations(on, 2)]
    return max(lengths, default=0.0) or 1.0
