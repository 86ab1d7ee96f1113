"""Gazebo: a `<joint>` of SDF inside a `<gazebo>` element closes a loop of the tree.

As in SDF, the joint's pose is given in its child link and its axis in the joint's frame; both links carry that frame as
it stands with all joints of the tree at zero.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pkmsea.description import tree
from pkmsea.description.conventions import keys
from pkmsea.description.xml import Element, numbers, tag
from pkmsea.errors import MechanismError, NameNotFound

LABEL = "<gazebo> joints"
TAGS: tuple[str, ...] = ("gazebo",)
TYPES = {"revolute": "revolute", "continuous": "revolute", "ball": "point", "fixed": "frame"}
BODIES = ("link", "model", "include")  # further bodies, which the tree does not have
SPRINGS = ("springStiffness", "spring_stiffness")
LOOPS = re.compile("closed.?loop|attach.?link", re.IGNORECASE)  # plugins that join links
MODEL, WORLD = "__model__", "world"
TRUE = ("1", "true")
Z = "0 0 1"  # SDF's default axis
FRAMES = ("relative_to", "frame", "expressed_in")  # attributes that name the frame in which numbers are given


def read(root: Element, file: Path) -> dict[str, Any]:
    """Loops as closures between two new frames; empty where there are none.

    Raises
    ------
    MechanismError : further bodies, springs at joints, plugins that join links; names them.
    """
    said: dict[str, Any] = {}
    for gazebo in root.findall("gazebo"):
        _refuse(gazebo, file, f"gazebo '{gazebo.get('reference')}'" if gazebo.get("reference") else "gazebo")
    if light := [f"'{g.get('reference')}'" for g in root.findall("gazebo") if _is(g.find("turnGravityOff"))]:
        said["notes"] = (f"gazebo turns the gravity of {', '.join(light)} off; here they have weight",)
    zero = tree.neutral(root, file) if root.find("gazebo/joint") is not None else {}
    for i, joint in enumerate(root.findall("gazebo/joint")):
        said = keys.joined(said, _loop(joint, joint.get("name") or f"gazebo{i + 1}", zero, file), file)
    return said


def _refuse(gazebo: Element, file: Path, key: str) -> None:
    for element in gazebo:
        what = None
        if tag(element) in BODIES:
            what = "A body that Gazebo adds is not read."
        elif tag(element) in SPRINGS and any(_words(element, 1, "0", file, f"{key}: {element.tag}")):
            what = "A spring at a joint is not read; springs belong to the drives of the task."
        elif tag(element) == "plugin" and LOOPS.search(f"{element.get('name')} {element.get('filename')}"):
            what = "A plugin that joins links is not read."
        if what:
            raise MechanismError(
                what,
                "Write bodies into the tree, loops as <gazebo><joint> or under 'closures'; else remove it.",
                file=file,
                key=f"{key}: {tag(element)}",
            )


def _loop(joint: Element, name: str, zero: dict[str, pin.SE3], file: Path) -> dict[str, Any]:
    key, base = f"gazebo joint '{name}'", next(iter(zero))
    parent, child = (_link(joint.find(end), zero, base, file, f"{key}: {end}") for end in ("parent", "child"))
    if parent == child == base:
        return {}  # the base stands on the ground
    kind = keys.kind_of(joint.get("type", ""), TYPES, file, key)
    pose, axis = joint.find("pose"), joint.find("axis")
    xyz, rpy = np.split(np.array(_words(pose, 6, "0 0 0 0 0 0", file, f"{key}: pose")), 2)
    frame = _frame(pose, zero, file, f"{key}: pose") or child
    place = zero[frame] * pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)
    ends = {f"{name}_{i}": keys.at(link, zero[link].actInv(place)) for i, link in ((1, parent), (2, child))}
    along = None if axis is None else _axis(axis, place, zero, file, f"{key}: axis")
    return keys.closure(name, kind, ends, along if kind == "revolute" else None)


def _axis(axis: Element, place: pin.SE3, zero: dict[str, pin.SE3], file: Path, key: str) -> list[float]:
    """The axis in the joint's frame."""
    xyz = axis.find("xyz")
    direction, frame = np.array(_words(xyz, 3, Z, file, key)), _frame(xyz, zero, file, key)
    if _is(axis.find("use_parent_model_frame")):
        frame = next(iter(zero))
    if frame is not None:
        direction = place.rotation.T @ zero[frame].rotation @ direction
    return [float(x) for x in direction]


def _link(element: Element | None, zero: dict[str, pin.SE3], base: str, file: Path, key: str) -> str:
    """A link by its name, which may have the model's before it; the world is the base."""
    name = "" if element is None else (element.get("link") or element.text or "").strip()
    return base if name == WORLD and name not in zero else _known(name, zero, file, key)


def _known(name: str, zero: dict[str, pin.SE3], file: Path, key: str) -> str:
    name = name.rpartition("::")[2]
    if name not in zero:
        raise NameNotFound("link", name, list(zero), file=file, key=key)
    return name


def _frame(element: Element | None, zero: dict[str, pin.SE3], file: Path, key: str) -> str | None:
    """The link in whose frame numbers are given; None where the file leaves that to SDF's rules."""
    stated = {} if element is None else dict(element.attrib)
    named = [stated.pop(attribute) for attribute in FRAMES if attribute in stated]
    if stated:
        raise MechanismError(
            "This attribute is not read.", "Give plain numbers in m and rad.", file=file, key=key, value=stated
        )
    if not named or not named[0]:
        return None
    return next(iter(zero)) if named[0] == MODEL else _known(named[0], zero, file, key)


def _words(element: Element | None, count: int, default: str, file: Path, key: str) -> list[float]:
    """The numbers of an element's text, or of its attribute `value`, as older files write it."""
    text = default if element is None else (element.get("value") or element.text or "").strip()
    return numbers({"value": text or default}, "value", count, file, key)


def _is(element: Element | None) -> bool:
    return element is not None and (element.get("value") or element.text or "").strip().lower() in TRUE
