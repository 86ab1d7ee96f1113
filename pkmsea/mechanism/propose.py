"""What the files of a mechanism leave open, guessed: drives, minimal coordinates, end effector."""

from __future__ import annotations

import re
from itertools import combinations
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from pkmsea.description import CompleteDescription, Description, EndEffector
from pkmsea.errors import MechanismError, NameNotFound
from pkmsea.files import parse
from pkmsea.mechanism.conditioning import Conditioning
from pkmsea.mechanism.loops import Loops

WORTH = 0.02  # conditioning from which drives or an end effector are proposed
CANDIDATES = 8  # frames that are tried as end effector
TOOLS = [re.compile(names, re.IGNORECASE) for names in (r"effector|tool|tcp|^ee|ee$", r"gripper|flange|hand", r"tip")]
AXES: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")


def complete(description: Description, loops: Loops, model: pin.Model, guess: bool) -> CompleteDescription:
    """The description with all that it leaves open; `origin.proposed` names the keys.

    Minimal coordinates are a matter of numerics and always found, and so is the seed where the neutral pose will do.
    Drives, end effector and any other seed are a matter of intent: they are proposed where `guess` allows.

    Raises
    ------
    MechanismError : a key is missing, or nothing can be proposed for it; says what to fill in.
    """
    proposed = ["seed"] if loops.proposed else []
    joints = list(model.names)[1:]
    found: dict[str, Any] = {}
    _check_count(description, loops)
    for key, propose in (("actuated", _drives), ("end_effector", _end_effector)):
        if getattr(description, key) is None:
            if not guess:
                raise _missing(description, key)
            found[key] = propose(description, loops, model)
            proposed.append(key)
    if description.independent is None:
        drives = description.actuated or found["actuated"]
        chosen = loops.independent([joints.index(name) for name in drives if name in joints])
        found["independent"] = tuple(joints[i] for i in chosen)
        proposed.append("independent")
    if description.seed is None:
        found["seed"] = tuple(zip(joints, loops.seed.tolist(), strict=True))
    origin = description.origin
    found["origin"] = origin.model_copy(update={"proposed": (*origin.proposed, *proposed)})
    return parse(CompleteDescription, dict(description) | found, origin.sidecar or origin.tree)


def _check_count(description: Description, loops: Loops) -> None:
    declared = description.independent
    if declared is not None and len(set(declared)) != loops.mobility:
        raise MechanismError(
            f"{len(declared)} independent coordinates are named, but the mobility of the closed mechanism is "
            f"{loops.mobility}.",
            f"Name {loops.mobility} different joint(s), or leave the key out.",
            **description.where("independent", value=list(declared)),
        )


def _missing(description: Description, key: str) -> MechanismError:
    return MechanismError(
        "This key is missing.",
        f"Add it to mechanism.yaml ('pkmsea check {description.origin.folder} --write' proposes one).",
        **description.where(key),
    )


def check_joint_names(description: Description, model: pin.Model) -> None:
    """Every joint that the description names exists and moves."""
    joints, locked = list(model.names)[1:], dict(description.locked)
    named: list[tuple[str, str, str]] = [
        *(("actuated", "actuated", name) for name in description.actuated or ()),
        *(("independent", "independent", name) for name in description.independent or ()),
        *(("seed", "seed", name) for name, _ in description.seed or ()),
    ]
    if description.end_effector is not None:
        named += [("end_effector", "end_effector.joints", name) for name in description.end_effector.joints]
    for i, coupling in enumerate(description.couplings):
        named += [("couplings", f"couplings.{i}.{end}", getattr(coupling, end)) for end in ("joint", "of")]
    for key, place, name in named:
        if name in locked:
            raise MechanismError(
                f"The joint '{name}' is locked.",
                "Take it out here, or out of 'locked'. Where actuated, independent, end_effector and seed are left "
                "out, they are proposed.",
                **description.where(key, place),
            )
        if name not in joints:
            raise NameNotFound("moving joint", name, joints, **description.where(key, place))


def _drives(description: Description, loops: Loops, model: pin.Model) -> tuple[str, ...]:
    """The independent joints of the file; else joints at the base that determine the motion; else any."""
    joints = list(model.names)[1:]
    if description.independent:
        return description.independent
    at_base = [i for i in range(loops.n) if model.parents[i + 1] == 0]
    chosen = loops.choose(at_base)
    if not chosen or loops.conditioning(chosen) < WORTH:
        chosen = loops.independent([])
    return tuple(joints[i] for i in chosen)


def _end_effector(description: Description, loops: Loops, model: pin.Model) -> EndEffector:
    """A frame named like a tool, else one at a closure, else the last link, whose origin follows the motion.

    More than three coordinates need joints in place of the origin.
    """
    if loops.mobility > len(AXES):
        chosen = loops.independent([])
        frame = next(iter(_candidates(description, model)), model.frames[-1].name)
        return EndEffector(frame=frame, joints=tuple(list(model.names)[1:][i] for i in chosen))
    ranked = _ranked(description, loops.measure, loops.seed, loops.mobility)
    found = next((follower for worth, follower in ranked if worth >= WORTH), None)
    if found is None:
        raise MechanismError(
            f"No frame follows the motion well along {loops.mobility} axes, the mobility of the mechanism.",
            "Place one under 'frames', such as 'tool: {link: LINK, xyz: [x, y, z]}', and name it as end effector; or "
            "hold joints at a position under 'locked', which lowers the mobility.",
            **description.where("end_effector"),
        )
    return found


def worth(description: Description, measure: Conditioning, q: np.ndarray, mobility: int) -> float:
    """How well an end effector can follow the motion at a closed pose, 0 to 1: the declared one, or the best frame."""
    return max((value for value, _ in _ranked(description, measure, q, mobility)), default=0.0)


def _ranked(
    description: Description, measure: Conditioning, q: np.ndarray, mobility: int
) -> list[tuple[float, EndEffector]]:
    """Frames that may be the end effector, most likely first, along their best axes, with their worth: the distance to
    singularities of type 1, zero at the border of the workspace."""
    declared = description.end_effector
    if declared and declared.joints:
        joints = [measure.joints.index(name) for name in declared.joints]
        return [(measure.of_joints(q, joints), declared)] if len(joints) == mobility else []
    if mobility > len(AXES) or (declared and len(declared.axes) != mobility):
        return []
    ranked = []
    for name in followers(description, measure.model):
        choices = [declared.axes] if declared else list(combinations(AXES, mobility))
        values = {axes: measure.of_point(q, name, [AXES.index(axis) for axis in axes]) for axes in choices}
        axes = max(values, key=lambda axes: values[axes])
        ranked.append((values[axes], EndEffector(frame=name, axes=axes)))
    return ranked


def followers(description: Description, model: pin.Model) -> list[str]:
    """Frames that may be the end effector: the declared one, or the likely ones."""
    return (
        [description.end_effector.frame] if description.end_effector else _candidates(description, model)[:CANDIDATES]
    )


def _candidates(description: Description, model: pin.Model) -> list[str]:
    kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
    frames = {f.name: f for f in model.frames if f.type in kinds and f.parentJoint}
    closing = [name for closure in description.closures for name in closure.frames if name in frames]
    depth = {
        name: (len(model.supports[f.parentJoint]), np.linalg.norm(f.placement.translation))
        for name, f in frames.items()
    }
    others = sorted(frames, key=lambda name: depth[name], reverse=True)
    tools = [name for pattern in TOOLS for name in others if pattern.search(name)]
    return list(dict.fromkeys(tools + closing + others))
