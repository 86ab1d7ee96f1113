"""Cleaning a URDF: what CAD exporters write and Pinocchio reads otherwise becomes plain, and each change is noted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from pkmsea.description import meshes
from pkmsea.description.limits import ENDLESS, LARGEST, POSITIONS
from pkmsea.description.xml import Element, number, numbers, text
from pkmsea.errors import MechanismError, NameNotFound

KEPT = {
    "robot": ("link", "joint", "material"),
    "link": ("inertial", "visual"),
    "joint": ("parent", "child", "origin", "axis", "limit"),
}
GYRATION = 100.0  # a radius of gyration that many times the size of the mechanism is a wrong unit
TRIANGLE = 1e-6  # how far the largest moment may exceed the sum of the others, relative to it


def clean(root: Element, file: Path, locked: dict[str, float]) -> list[str]:
    """Mend a checked URDF in place, and return a note on every change that matters.

    Every moving joint gets a whole <limit>; `locked` joints become fixed; meshes that are not found are left out;
    elements that are not of the tree (sensors, transmissions, collisions) go.

    Raises
    ------
    MechanismError : an inertia that no link of this size has.
    NameNotFound : a locked joint does not exist.
    """
    notes: list[str] = []
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    for name, value in locked.items():
        if name not in joints or joints[name].get("type") == "fixed":
            moving = [other for other, joint in joints.items() if joint.get("type") != "fixed"]
            raise NameNotFound("moving joint", name, moving, file=file, key="locked")
        _lock(joints[name], value, file)
    for name, joint in joints.items():
        if any(float(v) for element in joint.findall("dynamics") for v in element.attrib.values() if _is_number(v)):
            notes.append(
                f"joint '{name}': friction, damping and armature are not read; drives state theirs in the task"
            )
        _complete_limit(joint)
    notes += _inertia_notes(root, file)
    for element in [root, *root.findall("link"), *root.findall("joint")]:
        for child in list(element):
            if child.tag not in KEPT[str(element.tag)]:
                element.remove(child)
    return notes + _mesh_notes(meshes.drop_missing(root, file.parent))


def _lock(joint: Element, value: float, file: Path) -> None:
    """Make a joint fixed at a position: T_fixed = T_origin exp(axis value)."""
    key = f"joint '{joint.get('name')}': origin"
    origin = joint.find("origin")
    xyz, rpy = (np.array(numbers(origin, a, 3, file, key, "0 0 0")) for a in ("xyz", "rpy"))
    axis = np.array(numbers(joint.find("axis"), "xyz", 3, file, key, "1 0 0"))
    axis /= np.linalg.norm(axis)
    sliding = joint.get("type") == "prismatic"
    motion = pin.Motion(axis * value, np.zeros(3)) if sliding else pin.Motion(np.zeros(3), axis * value)
    placement = pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz) * pin.exp6(motion)
    for element in joint.findall("origin") + joint.findall("axis") + joint.findall("limit"):
        joint.remove(element)
    moved = pin.rpy.matrixToRpy(placement.rotation)
    etree.SubElement(joint, "origin", xyz=text(placement.translation), rpy=text(moved))
    joint.set("type", "fixed")


def _complete_limit(joint: Element) -> None:
    """All four numbers of a moving joint's <limit>, finite, as parsers ask for them; what is no limit stays none."""
    if joint.get("type") == "fixed":
        return
    limit = joint.find("limit")
    if limit is None:
        limit = etree.SubElement(joint, "limit")
    for key in (*POSITIONS, *LARGEST):
        number = float(limit.get(key, "").strip() or "0")
        limit.set(key, text([min(max(number, -ENDLESS), ENDLESS)]))


def _inertia_notes(root: Element, file: Path) -> list[str]:
    """Links that move without mass or with an impossible inertia; a wrong unit is refused."""
    notes = []
    moving = [joint.find("child").get("link") for joint in root.findall("joint") if joint.get("type") != "fixed"]
    origins = [joint.find("origin") for joint in root.findall("joint")]
    size = sum(float(np.linalg.norm(numbers(o, "xyz", 3, file, "origin", "0 0 0"))) for o in origins)
    for link in root.findall("link"):
        name, inertial = link.get("name"), link.find("inertial")
        if inertial is None:
            if name in moving:
                notes.append(f"link '{name}': moves, but has no <inertial>; it counts as massless")
            continue
        key = f"link '{name}':"
        mass = number(inertial.find("mass"), "value", file, f"{key} mass")
        moments = sorted(number(inertial.find("inertia"), m, file, f"{key} inertia") for m in ("ixx", "iyy", "izz"))
        if moments[2] > mass * (GYRATION * size) ** 2 and moments[2] > 0 and size > 0:
            raise MechanismError(
                f"The inertia is that of a body {GYRATION:g} times larger than the mechanism.",
                "Give it in kg m^2, and the mass in kg.",
                file=file,
                key=f"{key} inertia",
                value=moments[2],
            )
        if moments[2] > (moments[0] + moments[1]) * (1 + TRIANGLE):
            notes.append(f"link '{name}': no rigid body has this inertia, one moment exceeds the sum of the others")
    return notes


def _mesh_notes(missing: list[str]) -> list[str]:
    """One note for all meshes that are not found."""
    if not missing:
        return []
    names = ", ".join(sorted(set(missing))[:3])
    return [f"{len(set(missing))} mesh file(s) are not beside the tree and are not drawn: {names}"]


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False
