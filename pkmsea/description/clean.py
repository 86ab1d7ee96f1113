"""Cleaning a URDF: what CAD exporters write and Pinocchio reads otherwise becomes plain, and each change is noted."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
from lxml import etree

from pkmsea.description import meshes
from pkmsea.description.limits import ENDLESS, LARGEST, POSITIONS
from pkmsea.description.tree import SIZES, placement
from pkmsea.description.units import slips
from pkmsea.description.xml import Element, axis, number, numbers, text
from pkmsea.errors import MechanismError, NameNotFound

KEPT = {
    "robot": ("link", "joint", "material"),
    "link": ("inertial", "visual"),
    "joint": ("parent", "child", "origin", "axis", "limit"),
}
SWITCHES = {"gravity": "1", "kinematic": "0"}  # of links, for simulators
GYRATION = 100.0  # a radius of gyration that many times the size of the mechanism is a wrong unit
TRIANGLE = 1e-6  # how far the largest moment may exceed the sum of the others, relative to it


def clean(root: Element, file: Path, locked: dict[str, float]) -> list[str]:
    """Mend a checked URDF in place, and return a note on every change that matters.

    Every moving joint gets a whole <limit>; `locked` joints become fixed; meshes that are not found or damaged are left
    out; elements that are not of the tree (sensors, transmissions, collisions) go.

    Raises
    ------
    MechanismError : an inertia that no link of this size has.
    NameNotFound : a locked joint does not exist.
    """
    notes = [*slips(root, file), *_switched(root)]
    joints = {joint.get("name", ""): joint for joint in root.findall("joint")}
    for name, value in locked.items():
        if name not in joints or joints[name].get("type") == "fixed":
            moving = [other for other, joint in joints.items() if joint.get("type") != "fixed"]
            raise NameNotFound("moving joint", name, moving, file=file, key="locked")
        _lock(joints[name], value, file)
    if lossy := [f"'{name}'" for name, joint in joints.items() if _has_dynamics(joint)]:
        which = f"joint {lossy[0]}" if len(lossy) == 1 else f"joints {', '.join(lossy)}"
        notes.append(f"{which}: friction, damping and armature are not read; drives state theirs in the task")
    for joint in joints.values():
        _complete_limit(joint)
    notes += _inertia_notes(root, file)
    for element in [root, *root.findall("link"), *root.findall("joint")]:
        for child in list(element):
            if child.tag not in KEPT[str(element.tag)]:
                element.remove(child)
    return notes + _shape_notes(root) + meshes.shown(root, file.parent)[1]


def _has_dynamics(joint: Element) -> bool:
    values = [value for element in joint.findall("dynamics") for value in element.attrib.values()]
    return any(float(value) for value in values if _is_number(value))


def _switched(root: Element) -> list[str]:
    """Switches of simulators that this model does not have."""
    notes = []
    for link in root.findall("link"):
        gravity, kinematic = (link.findtext(tag, default).strip().lower() for tag, default in SWITCHES.items())
        if gravity in ("0", "false"):
            notes.append(f"link '{link.get('name')}': its gravity is switched off; here it has weight")
        if kinematic in ("1", "true"):
            notes.append(f"link '{link.get('name')}': it is kinematic for simulators; here forces move it")
    return notes


def _shape_notes(root: Element) -> list[str]:
    """Leave out visuals of shapes that are not drawn."""
    notes = []
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            if other := [str(shape.tag) for shape in visual.findall("geometry/*") if shape.tag not in SIZES]:
                link.remove(visual)
                notes.append(f"link '{link.get('name')}': <{other[0]}> is not drawn")
    return notes


def _lock(joint: Element, value: float, file: Path) -> None:
    """Make a joint fixed at a position: T_fixed = T_origin exp(axis value)."""
    direction = np.array(axis(joint, file, f"joint '{joint.get('name')}':"))
    moved = direction / np.linalg.norm(direction) * value
    sliding = joint.get("type") == "prismatic"
    motion = pin.Motion(moved, np.zeros(3)) if sliding else pin.Motion(np.zeros(3), moved)
    place = placement(joint, file) * pin.exp6(motion)
    for element in joint.findall("origin") + joint.findall("axis") + joint.findall("limit"):
        joint.remove(element)
    etree.SubElement(joint, "origin", xyz=text(place.translation), rpy=text(pin.rpy.matrixToRpy(place.rotation)))
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


def _is_number(word: str) -> bool:
    try:
        return bool(np.isfinite(float(word)))
    except ValueError:
        return False
