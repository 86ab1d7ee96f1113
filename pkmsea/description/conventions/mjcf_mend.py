"""What Pinocchio 4.1.0 drops from an MJCF file without a word is mended before it parses, or refused.

That is: bodies of the world after the first, bodies without a name, <frame> and its like, reference positions, springs,
inertias of meshes; and several joints of one body, which would become one joint of several coordinates.
"""

from __future__ import annotations

from pathlib import Path

from lxml import etree

from pkmsea.description.xml import Element, number, numbers
from pkmsea.errors import MechanismError

IN_BODY = ("body", "joint", "freejoint", "inertial", "geom", "site", "camera", "light")
SHAPES = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
WORLD = "world"
COUNTS = {
    "pos": 3,
    "quat": 4,
    "axis": 3,
    "euler": 3,
    "axisangle": 4,
    "xyaxes": 6,
    "zaxis": 3,
    "fromto": 6,
    "range": 2,
    "mass": 1,
    "density": 1,
    "diaginertia": 3,
    "fullinertia": 6,
    "anchor": 3,
    "relpose": 7,
    "armature": 1,
    "damping": 1,
}
NUMBERED = ("body", "joint", "inertial", "geom", "site", "connect", "weld")


def mend(root: Element, file: Path) -> None:
    """Make an MJCF file say the same to Pinocchio as to MuJoCo, in place.

    Raises
    ------
    MechanismError : it holds something that would change the motion and cannot be mended; names element and remedy.
    """
    _check_numbers(root, file)
    _refuse(root, file)
    _gather_world(root, file)


def _check_numbers(root: Element, file: Path) -> None:
    for element in root.iter(*NUMBERED):
        for attribute in COUNTS.keys() & element.keys():
            numbers(element, attribute, COUNTS[attribute], file, f"{element.tag} '{element.get('name', '')}':")
        if element.get("size") is not None:
            key = f"{element.tag} '{element.get('name', '')}':"
            numbers(element, "size", len(element.get("size", "").split()), file, key)
        if element.tag == "body" and len(element.findall("inertial")) > 1:
            raise MechanismError(
                "There are two <inertial> elements.",
                "Remove one of them.",
                file=file,
                key=f"body '{element.get('name', '')}': inertial",
            )
        if element.tag == "inertial" and element.get("mass") is None:
            raise MechanismError("The mass is missing.", "Give it in kg.", file=file, key="inertial mass")


def _refuse(root: Element, file: Path) -> None:
    for element in root.iter("include", "frame", "replicate", "attach", "composite", "flexcomp"):
        raise MechanismError(
            f"<{element.tag}> is not read.",
            "Save the model once from MuJoCo (mj_saveLastXML), which expands it.",
            file=file,
            key=str(element.tag),
        )
    for element in root.iter("body", "inertial"):
        if element.getparent().tag not in ("body", "worldbody"):
            raise MechanismError(
                f"<{element.tag}> does not belong into <{element.getparent().tag}>.",
                "Put it into its body.",
                file=file,
                key=f"{element.getparent().tag}: {element.tag}",
            )
    for joint in root.iter("joint"):
        key = f"joint '{joint.get('name', '')}':"
        if joint.get("ref") is not None and number(joint, "ref", file, key) != 0:
            raise MechanismError(
                "A reference position is not read.",
                "Set ref='0' and turn the body instead.",
                file=file,
                key=f"{key} ref",
            )
        if joint.get("stiffness") is not None and number(joint, "stiffness", file, key) != 0:
            raise MechanismError(
                "A spring at a joint is not read.",
                "Remove it; springs belong to the drives of the task.",
                file=file,
                key=f"{key} stiffness",
            )
    for element in root.iter("freejoint", "joint"):
        if element.tag == "freejoint" or element.get("type") in ("free", "ball"):
            raise MechanismError(
                "pkmsea models hinge and slide joints.",
                "Replace it by hinges and slides with light bodies between.",
                file=file,
                key=f"joint '{element.get('name', '')}': type",
            )
    if root.find("worldbody") is None:
        raise MechanismError("There is no <worldbody>.", "Give a complete MJCF model.", file=file, key="worldbody")


def _gather_world(root: Element, file: Path) -> None:
    """One body around all others, each body and joint named, one joint per body, masses stated."""
    world = root.find("worldbody")
    around = etree.Element("body", name=WORLD)
    around.extend(list(world))
    world.append(around)
    taken = {element.get("name") for element in root.iter("body", "joint")}
    fresh = (f"{kind}{i}" for i in range(1, 10_000_000) for kind in ("unnamed",) if f"{kind}{i}" not in taken)
    for body in list(around.iter("body")):
        for child in body.iterdescendants():
            if child.tag not in IN_BODY or (child.getparent().tag != "body"):
                raise MechanismError(
                    f"<{child.tag}> at this place is not read.",
                    "Remove it, or save the model once from MuJoCo.",
                    file=file,
                    key=f"body '{body.get('name', '')}': {child.tag}",
                )
        for element in (body, *body.findall("joint")):
            if element.get("name") is None:
                element.set("name", next(fresh))
        _state_mass(body, file)
        _split(body, next(fresh))


def _state_mass(body: Element, file: Path) -> None:
    """Geometry goes where the inertia is stated; else it must be of shapes whose inertia is known."""
    stated, name = body.find("inertial") is not None, body.get("name")
    for geom in body.findall("geom"):
        if stated:
            body.remove(geom)
        elif geom.get("type") is not None and geom.get("type") not in SHAPES:
            raise MechanismError(
                f"The inertia of a {geom.get('type')} is not computed.",
                "Give the body an <inertial>.",
                file=file,
                key=f"body '{name}': geom",
            )
        elif geom.get("mesh") is not None:
            raise MechanismError(
                "The inertia of a mesh is not computed.",
                "Give the body an <inertial>.",
                file=file,
                key=f"body '{name}': geom",
            )


def _split(body: Element, name: str) -> None:
    """Several joints of one body become a chain of massless bodies, in the same order."""
    joints = body.findall("joint")
    if len(joints) < 2:
        return
    rest = [child for child in body if child is not joints[0]]
    inner = etree.SubElement(body, "body", name=body.get("name", ""))
    inner.extend(rest)
    body.set("name", name)
    _split(inner, f"{name}_")
