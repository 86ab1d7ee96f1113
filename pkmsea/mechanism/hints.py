"""What a file does not say and its user may not notice, as notes."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import combinations

import numpy as np
import pinocchio as pin

from pkmsea.bridge import frame_id
from pkmsea.description import Description, xml
from pkmsea.mechanism.closed_tree import ClosedTree
from pkmsea.mechanism.conditioning import characteristic_length

NEAR = 0.03  # of the characteristic length: ends that are closer at the neutral pose may be one pin
LEAST = 3  # joints of a loop that is opened at a further one; fewer leave it rigid
IDLE = 1e-9  # of weight times characteristic length: a gravity torque that rounding leaves


def possible_loops(model: pin.Model, description: Description) -> list[str]:
    """Ends of different branches that nearly meet at the neutral pose, where no closure joins these branches."""
    ends = _ends(model, description)
    joined = [{_joint(model, name) for name in closure.frames} for closure in description.closures]
    near = NEAR * characteristic_length(model, ends)
    pairs = sorted((float(np.linalg.norm(ends[a] - ends[b])), a, b) for a, b in combinations(ends, 2))
    notes = []
    for distance, a, b in pairs:
        joints = [_joint(model, name) for name in (a, b)]
        between = set(model.supports[joints[0]]) ^ set(model.supports[joints[1]])
        if distance < near and len(between) >= LEAST and set(joints) not in joined:
            joined.append(set(joints))
            notes.append(
                f"'{a}' and '{b}' are {distance * 1e3:.3g} mm apart with all joints at zero: if they are one pin, add "
                f"'closures: [{{frames: [{a}, {b}]}}]'"
            )
    return notes


def of(mechanism: ClosedTree, poses: Iterable[np.ndarray]) -> list[str]:
    """Gravity without effect, and a seed outside the joints' limits."""
    return [*_gravity(mechanism, poses), *_limits(mechanism)]


def _gravity(mechanism: ClosedTree, poses: Iterable[np.ndarray]) -> list[str]:
    gravity, model = mechanism.description.gravity, mechanism.model
    weight = sum(inertia.mass for inertia in model.inertias) * float(np.linalg.norm(gravity))
    scale, rest = weight * mechanism.length, np.zeros(mechanism.mobility)
    if weight == 0 or any(np.abs(mechanism.bias(q, rest)).max() > IDLE * scale for q in poses):
        return []
    return [
        f"gravity [{', '.join(f'{g:g}' for g in gravity)}] does no work in any motion, since all masses move at right "
        "angles to it; if the mechanism stands another way, give 'gravity'"
    ]


def _limits(mechanism: ClosedTree) -> list[str]:
    model, seed = mechanism.model, mechanism.seed
    return [
        f"seed: joint '{name}' stands at {at:.4g}, outside its limits of {low:.4g} to {high:.4g}"
        for name, at, low, high in zip(
            mechanism.joints, seed, model.lowerPositionLimit, model.upperPositionLimit, strict=True
        )
        if not low <= at <= high
    ]


def _ends(model: pin.Model, description: Description) -> dict[str, np.ndarray]:
    """Moving links without a child, and where they are at the neutral pose."""
    root = xml.parse_text(description.tree.encode(), description.origin.tree)
    parents = {joint.find("parent").get("link") for joint in root.findall("joint")}
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.zeros(model.nq))
    names = [link.get("name", "") for link in root.findall("link")]
    return {
        name: data.oMf[frame_id(model, name)].translation.copy()
        for name in names
        if name not in parents and _joint(model, name)
    }


def _joint(model: pin.Model, frame: str) -> int:
    return int(model.frames[frame_id(model, frame)].parentJoint)
