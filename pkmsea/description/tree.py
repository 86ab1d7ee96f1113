"""Is a URDF a tree that pkmsea can model? Every fault names its link or joint, before Pinocchio sees the file."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pkmsea.description.limits import joint_limits
from pkmsea.description.xml import Element, axis, number, numbers
from pkmsea.errors import MechanismError, NameNotFound

TYPES = ("revolute", "continuous", "prismatic", "fixed")
MOMENTS = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
SIZES = {"box": {"size": 3}, "cylinder": {"radius": 1, "length": 1}, "sphere": {"radius": 1}, "mesh": {}}
HOME = {  # where an element stands; elsewhere, or for the second time, it would be overlooked
    "link": ("robot",),
    "joint": ("robot",),
    "visual": ("link",),
    "inertial": ("link",),
    "mass": ("inertial",),
    "inertia": ("inertial",),
    "parent": ("joint",),
    "child": ("joint",),
    "axis": ("joint",),
    "limit": ("joint",),
    "mimic": ("joint",),
    "origin": ("joint", "inertial", "visual", "collision", "link"),
}
PRIVATE = ("self_filter", "collision_checking", "sensor", "surface", "contact")  # have elements of their own
MANY = ("link", "joint", "visual")
NEGATIVE = -1e-9  # smallest principal moment that rounding explains, relative to the largest


def check(root: Element, file: Path) -> None:
    """Refuse what is no tree of links on revolute, prismatic and fixed joints with finite numbers.

    Raises
    ------
    MechanismError, NameNotFound : names file, link or joint, value and remedy.
    """
    if root.tag != "robot":
        raise MechanismError(f"The root element is <{root.tag}>, not <robot>.", "Give a URDF file.", file=file)
    links, joints = _named(root, "link", file), _named(root, "joint", file)
    for top in root:
        inside = [child for child in top if child.tag not in PRIVATE] if top.tag in ("link", "joint") else []
        for element in (*([top] if top.tag in HOME else []), *(e for child in inside for e in child.iter(*HOME))):
            _check_place(element, file)
    parent_of = {}
    for name, joint in joints.items():
        parent, child = (_end(joint, name, end, links, file) for end in ("parent", "child"))
        if child in parent_of:
            raise MechanismError(
                f"The link '{child}' has two parents.",
                "A URDF is a tree: remove this joint, and close the loop by two frames under 'closures'.",
                file=file,
                key=f"joint '{name}': child",
            )
        parent_of[child] = parent
        _check_joint(joint, f"joint '{name}':", file)
    _check_connected(list(links), parent_of, file)
    for name, link in links.items():
        _check_link_origin(link, f"link '{name}':", file)
        _check_inertia(link, f"link '{name}':", file)
        for visual in link.findall("visual"):
            _check_visual(visual, f"link '{name}': visual", file)


def neutral(root: Element, file: Path) -> dict[str, pin.SE3]:
    """Placement of each link in the base, which comes first, with all joints at zero; of a checked tree."""
    joints = root.findall("joint")
    children = {joint.find("child").get("link") for joint in joints}
    names = (link.get("name", "") for link in root.findall("link"))
    placed = {name: pin.SE3.Identity() for name in names if name not in children}
    while len(placed) <= len(joints):
        for joint in joints:
            parent, child = (joint.find(end).get("link") for end in ("parent", "child"))
            if parent in placed and child not in placed:
                placed[child] = placed[parent] * placement(joint, file)
    return placed


def placement(joint: Element, file: Path) -> pin.SE3:
    """Of a joint's frame in its parent."""
    key, origin = f"joint '{joint.get('name')}': origin", joint.find("origin")
    xyz, rpy = (np.array(numbers(origin, attribute, 3, file, key, "0 0 0")) for attribute in ("xyz", "rpy"))
    return pin.SE3(pin.rpy.rpyToMatrix(rpy), xyz)


def _named(root: Element, tag: str, file: Path) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for i, element in enumerate(root.findall(tag)):
        name = element.get("name", "")
        if not name or name in found or not name.isprintable():
            cause = f"Two {tag}s have this name." if name in found else f"A {tag} has no name that can be printed."
            raise MechanismError(cause, "Give each its own name.", file=file, key=f"{tag} {i + 1}: name", value=name)
        found[name] = element
    return found


def _check_place(element: Element, file: Path) -> None:
    holder, tag = element.getparent(), str(element.tag)
    name = next((e.get("name") for e in element.iterancestors() if e.tag in ("link", "joint")), "robot")
    where: dict[str, Any] = {"file": file, "key": f"'{name}': {tag}"}
    if holder.tag not in HOME[tag]:
        raise MechanismError(
            f"<{tag}> does not belong into <{holder.tag}>.", f"Put it into its <{HOME[tag][0]}>.", **where
        )
    if tag not in MANY and len(holder.findall(tag)) > 1:
        raise MechanismError(f"There are two <{tag}> elements.", "Remove one of them.", **where)


def _end(joint: Element, name: str, end: str, links: dict[str, Element], file: Path) -> str:
    element = joint.find(end)
    link = "" if element is None else element.get("link", "")
    if link not in links:
        raise NameNotFound("link", link, list(links), file=file, key=f"joint '{name}': {end}")
    return link


def _check_joint(joint: Element, key: str, file: Path) -> None:
    kind = joint.get("type", "")
    if kind not in TYPES:
        raise MechanismError(
            "pkmsea models revolute, prismatic and fixed joints.",
            "Replace it by a chain of revolute and prismatic joints with light links between them.",
            file=file,
            key=f"{key} type",
            value=kind,
        )
    _check_origin(joint, key, file)
    if kind == "fixed":
        return
    if not any(axis(joint, file, key)):
        raise MechanismError("The axis is zero.", "Give a direction, such as 0 0 1.", file=file, key=f"{key} axis")
    joint_limits(joint, file)


def _check_connected(links: list[str], parent_of: dict[str, str], file: Path) -> None:
    roots = [link for link in links if link not in parent_of]
    if len(roots) > 1:
        raise MechanismError(
            f"The links do not hang together: {', '.join(roots[:5])} have no parent.",
            "Connect them by joints, so that one base link remains.",
            file=file,
            key="joint",
        )
    reached, open_ = set(roots), list(roots)
    children: dict[str, list[str]] = {}
    for child, parent in parent_of.items():
        children.setdefault(parent, []).append(child)
    while open_:
        below = children.get(open_.pop(), [])
        reached.update(below)
        open_ += below
    if circle := [link for link in links if link not in reached]:
        raise MechanismError(
            f"The links {', '.join(circle[:5])} are each other's parents, in a circle.",
            "A URDF is a tree: remove one joint, and close the loop by two frames under 'closures'.",
            file=file,
            key="joint",
        )


def _check_origin(element: Element, key: str, file: Path) -> None:
    origin = element.find("origin")
    for attribute in ("xyz", "rpy"):
        numbers(origin, attribute, 3, file, f"{key} origin", "0 0 0")


def _check_link_origin(link: Element, key: str, file: Path) -> None:
    """The frame of a link is that of its joint; exporters write that as an origin without effect."""
    origin = link.find("origin")
    values = [x for attribute in ("xyz", "rpy") for x in numbers(origin, attribute, 3, file, f"{key} origin", "0 0 0")]
    if any(values):
        raise MechanismError(
            "A link has no origin of its own.",
            "Put it into the origin of the joint whose child the link is.",
            file=file,
            key=f"{key} origin",
            value=values,
        )


def _check_inertia(link: Element, key: str, file: Path) -> None:
    inertial = link.find("inertial")
    if inertial is None:
        return
    mass = number(inertial.find("mass"), "value", file, f"{key} mass")
    if mass < 0:
        raise MechanismError(
            "A mass cannot be negative.", "Give the link's mass in kg.", file=file, key=f"{key} mass", value=mass
        )
    _check_origin(inertial, f"{key} inertial", file)
    xx, yy, zz, xy, xz, yz = (number(inertial.find("inertia"), m, file, f"{key} inertia") for m in MOMENTS)
    if mass == 0 and any((xx, yy, zz, xy, xz, yz)):
        raise MechanismError(
            "The mass is zero, the inertia is not.",
            "Give the mass in kg; or remove <inertial>, so that the link counts as massless.",
            file=file,
            key=f"{key} mass",
            value=mass,
        )
    principal = np.linalg.eigvalsh([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    if principal[0] < NEGATIVE * max(principal[-1], 0.0) or principal[-1] < 0:
        raise MechanismError(
            "A principal moment of inertia is negative.",
            "Give the tensor in kg m^2 about the centre of mass.",
            file=file,
            key=f"{key} inertia",
            value=[xx, yy, zz, xy, xz, yz],
        )


def _check_visual(visual: Element, key: str, file: Path) -> None:
    _check_origin(visual, key, file)
    for shape in visual.findall("geometry/*"):
        for attribute, count in SIZES.get(str(shape.tag), {}).items():
            numbers(shape, attribute, count, file, f"{key} {shape.tag}")
