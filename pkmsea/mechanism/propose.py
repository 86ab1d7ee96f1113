"""What the files of a mechanism leave open, guessed: drives, minimal coordinates, end effector."""

from __future__ import annotations

import re
from itertools import combinations
from typing import Any, Literal

import numpy as np
import pinocchio as pin

from pkmsea.bridge import frame_id
from pkmsea.errors import MechanismError, NameNotFound
from pkmsea.files import parse
from pkmsea.mechanism import pose
from pkmsea.mechanism.conventions import Source
from pkmsea.mechanism.mobility import Loops
from pkmsea.mechanism.sidecar import EndEffector, Sidecar

WORTH = 0.02  # conditioning from which drives or an end effector are proposed
CANDIDATES = 8  # frames that are tried as end effector
TOOLS = [re.compile(names, re.IGNORECASE) for names in (r"effector|tool|tcp|^ee|ee$", r"gripper|flange|hand", r"tip")]
AXES: tuple[Literal["x", "y", "z"], ...] = ("x", "y", "z")


def complete(source: Source, loops: Loops, model: pin.Model, guess: bool) -> tuple[Sidecar, tuple[str, ...]]:
    """The draft as a complete sidecar, and the keys that were proposed.

    Minimal coordinates are a matter of numerics and always found. Drives, end effector and a seed where the neutral
    pose will not do are a matter of intent: they are proposed where `guess` allows, else missing.

    Raises
    ------
    MechanismError : a key is missing, or nothing can be proposed for it; says what to fill in.
    """
    draft, proposed = source.draft, ["seed"] if loops.proposed else []
    joints = list(model.names)[1:]
    data: dict[str, Any] = {name: getattr(draft, name) for name in draft.model_fields_set}
    if draft.independent is not None and len(set(draft.independent)) != loops.mobility:
        raise MechanismError(
            f"{len(draft.independent)} independent coordinates are named, but the mobility of the closed mechanism is "
            f"{loops.mobility}.",
            f"Name {loops.mobility} different joint(s), or leave the key out.",
            file=source.where("independent"), key="independent", value=list(draft.independent),
        )  # fmt: skip
    for key, propose in (("actuated", _drives), ("end_effector", _end_effector)):
        if getattr(draft, key) is None:
            if not guess:
                raise MechanismError(
                    "This key is missing.",
                    f"Add it to mechanism.yaml ('pkmsea check {source.folder} --write' proposes one).",
                    file=source.where(key), key=key,
                )  # fmt: skip
            data[key] = propose(source, loops, model)
            proposed.append(key)
    if draft.independent is None:
        chosen = loops.independent([joints.index(name) for name in data["actuated"] if name in joints])
        data["independent"] = tuple(joints[i] for i in chosen)
        proposed.append("independent")
    if loops.proposed or draft.seed is None:
        data["seed"] = dict(zip(joints, (loops.seed.round(6) + 0.0).tolist(), strict=True))
    return parse(Sidecar, data, source.sidecar or source.tree), tuple(proposed)


def check_joint_names(source: Source, model: pin.Model) -> None:
    """Every joint that the draft names exists and moves."""
    joints, draft = list(model.names)[1:], source.draft
    named: list[tuple[str, str, Any]] = [
        (key, key, name) for key in ("actuated", "independent", "seed") for name in getattr(draft, key) or ()
    ]
    if draft.end_effector is not None:
        named += [("end_effector", "end_effector.joints", name) for name in draft.end_effector.joints]
    for i, coupling in enumerate(draft.couplings):
        named += [("couplings", f"couplings.{i}.{end}", getattr(coupling, end)) for end in ("joint", "of")]
    for key, place, name in named:
        if name in draft.locked:
            raise MechanismError(
                f"The joint '{name}' is locked.",
                "Take it out here, or out of 'locked'. Where actuated, independent, end_effector and seed are left "
                "out, they are proposed.", file=source.where(key), key=place,
            )  # fmt: skip
        if name not in joints:
            raise NameNotFound("moving joint", name, joints, file=source.where(key), key=place)


def _drives(source: Source, loops: Loops, model: pin.Model) -> tuple[str, ...]:
    """The independent joints of the file; else joints at the base that determine the motion; else any."""
    joints = list(model.names)[1:]
    if source.draft.independent:
        return source.draft.independent
    at_base = [i for i in range(loops.n) if model.parents[i + 1] == 0]
    chosen = loops.choose(at_base)
    if not chosen or loops.conditioning(chosen) < WORTH:
        chosen = loops.independent([])
    return tuple(joints[i] for i in chosen)


def _end_effector(source: Source, loops: Loops, model: pin.Model) -> EndEffector:
    """A frame named like a tool, else one at a closure, else the last link, whose origin follows the motion.

    More than three coordinates need joints in place of the origin.
    """
    where: dict[str, Any] = {"file": source.where("end_effector"), "key": "end_effector"}
    if loops.mobility > len(AXES):
        chosen = loops.independent([])
        frame = next(iter(_candidates(source, model)), model.frames[-1].name)
        return EndEffector(frame=frame, joints=tuple(list(model.names)[1:][i] for i in chosen))
    ranked = _ranked(source, model, loops.seed, loops.G[0])
    found = next((follower for worth, follower in ranked if worth >= WORTH), None)
    if found is None:
        raise MechanismError(
            f"No frame follows the motion well along {loops.mobility} axes, the mobility of the mechanism.",
            "Place one under 'frames', such as 'tool: {link: LINK, xyz: [x, y, z]}', and name it as end effector; or "
            "hold joints at a position under 'locked', which lowers the mobility.", **where,
        )  # fmt: skip
    return found


def worth(source: Source, model: pin.Model, q: np.ndarray, G: np.ndarray) -> float:
    """How well an end effector can follow the motion at a closed pose, 0 to 1: the declared one, or the best frame."""
    return max((value for value, _ in _ranked(source, model, q, G)), default=0.0)


def _ranked(source: Source, model: pin.Model, q: np.ndarray, G: np.ndarray) -> list[tuple[float, EndEffector]]:
    """Frames that may be the end effector, most likely first, along their best axes, with their worth: the reciprocal
    condition number of [G; J_E], zero at the border of the workspace."""
    mobility = model.nq - G.shape[0]
    declared = source.draft.end_effector
    if declared and declared.joints:
        S = np.eye(model.nq)[[list(model.names)[1:].index(name) for name in declared.joints]]
        return [(_worth(G, S), declared)] if len(S) == mobility else []
    if mobility > len(AXES) or (declared and len(declared.axes) != mobility):
        return []
    data = model.createData()
    pin.computeJointJacobians(model, data, q)
    pin.updateFramePlacements(model, data)
    ranked = []
    for name in [declared.frame] if declared else _candidates(source, model)[:CANDIDATES]:
        J = pin.getFrameJacobian(model, data, frame_id(model, name), pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:3]
        choices = [declared.axes] if declared else list(combinations(AXES, mobility))
        values = {axes: _worth(G, J[[AXES.index(axis) for axis in axes]]) for axes in choices}
        axes = max(values, key=lambda axes: values[axes])
        ranked.append((values[axes], EndEffector(frame=name, axes=axes)))
    return ranked


def _worth(G: np.ndarray, J_E: np.ndarray) -> float:
    A = np.vstack([G, J_E])
    return float(pose.reciprocal_condition(A)) if np.abs(J_E).max() > pose.TOLERANCE else 0.0


def _candidates(source: Source, model: pin.Model) -> list[str]:
    kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
    frames = {f.name: f for f in model.frames if f.type in kinds and f.parentJoint}
    closing = [name for closure in source.draft.closures for name in closure.frames if name in frames]
    depth = {
        name: (len(model.supports[f.parentJoint]), np.linalg.norm(f.placement.translation))
        for name, f in frames.items()
    }
    others = sorted(frames, key=lambda name: depth[name], reverse=True)
    tools = [name for pattern in TOOLS for name in others if pattern.search(name)]
    return list(dict.fromkeys(tools + closing + others))
