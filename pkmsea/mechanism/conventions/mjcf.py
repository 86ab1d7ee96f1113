"""MJCF (MuJoCo): Pinocchio's parser reads the tree and its equality constraints; the tree becomes URDF.

Pinocchio 4.1.0 drops what it does not know without a word (second bodies of the world, <frame>, sites of a connect,
bodies without a name, inertias of meshes); here this is mended before it parses, or refused.
"""

from __future__ import annotations

import copy
import tempfile
from pathlib import Path
from typing import Any

import pinocchio as pin
from lxml import etree

from pkmsea.errors import MechanismError, NameNotFound
from pkmsea.mechanism import xml
from pkmsea.mechanism.conventions.to_urdf import body_frame, to_urdf
from pkmsea.mechanism.xml import Element, number, numbers

LABEL = "MJCF"
IN_BODY = ("body", "joint", "freejoint", "inertial", "geom", "site", "camera", "light")
SHAPES = ("sphere", "capsule", "ellipsoid", "cylinder", "box")
WORLD = "world"
GRAVITY = "0 0 -9.81"


def speaks(root: Element) -> bool:
    return bool(root.tag == "mujoco")


def read(root: Element, file: Path) -> tuple[Element, dict[str, Any]]:
    """The tree as URDF, and closures, couplings, gravity, drives and a seed as sidecar keys.

    Raises
    ------
    MechanismError : something that would change the motion and is not read here.
    """
    root = copy.deepcopy(root)
    _refuse(root, file)
    _gather_world(root, file)
    couplings, locked = _joint_equalities(root, file)
    names = _keep_closures(root, file)
    model, points, welds = _parse(root, file)
    said: dict[str, Any] = {"frames": {}, "closures": []}
    kinds = [("point", list(points), names["connect"]), ("frame", list(welds), names["weld"])]
    for kind, constraints, labels in kinds:
        for constraint, label in zip(constraints, labels, strict=True):
            frames = [f"{label}_{i}" for i in (1, 2)]
            for frame, joint, placement in (
                (frames[0], constraint.joint1_id, constraint.joint1_placement),
                (frames[1], constraint.joint2_id, constraint.joint2_placement),
            ):
                said["frames"][frame] = {
                    "link": body_frame(model, joint), "xyz": tuple(placement.translation),
                    "rpy": tuple(pin.rpy.matrixToRpy(placement.rotation)),
                }  # fmt: skip
            said["closures"].append({"name": label, "frames": tuple(frames), "type": kind})
    option = root.find("option")
    said["gravity"] = tuple(numbers(option, "gravity", 3, file, "option", GRAVITY))
    said |= {"couplings": couplings} if couplings else {}
    said |= {"locked": locked} if locked else {}
    said |= _drives_and_seed(root, model, file)
    return to_urdf(model, root.get("model") or "mjcf"), said


def _refuse(root: Element, file: Path) -> None:
    for element in root.iter("include", "frame", "replicate", "attach", "composite", "flexcomp"):
        raise MechanismError(
            f"<{element.tag}> is not read.", "Save the model once from MuJoCo (mj_saveLastXML), which expands it.",
            file=file, key=str(element.tag),
        )  # fmt: skip
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
                "A spring at a joint is not read.", "Remove it; springs belong to the drives of the task.",
                file=file, key=f"{key} stiffness",
            )  # fmt: skip
    for element in root.iter("freejoint", "joint"):
        if element.tag == "freejoint" or element.get("type") in ("free", "ball"):
            raise MechanismError(
                "pkmsea models hinge and slide joints.", "Replace it by hinges and slides with light bodies between.",
                file=file, key=f"joint '{element.get('name', '')}': type",
            )  # fmt: skip
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
        for child in body:
            if child.tag not in IN_BODY:
                raise MechanismError(
                    f"<{child.tag}> in a body is not read.", "Remove it, or save the model once from MuJoCo.",
                    file=file, key=f"body '{body.get('name', '')}': {child.tag}",
                )  # fmt: skip
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
                f"The inertia of a {geom.get('type')} is not computed.", "Give the body an <inertial>.",
                file=file, key=f"body '{name}': geom",
            )  # fmt: skip
        elif geom.get("mesh") is not None:
            raise MechanismError(
                "The inertia of a mesh is not computed.", "Give the body an <inertial>.",
                file=file, key=f"body '{name}': geom",
            )  # fmt: skip


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


def _active(root: Element, *tags: str) -> list[Element]:
    return [e for tag in tags for e in root.findall(f"equality/{tag}") if e.get("active", "true") != "false"]


def _joint_equalities(root: Element, file: Path) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """Joint equalities q1 = a0 + a1 q2 as couplings, q1 = a0 as locked joints."""
    couplings: list[dict[str, Any]] = []
    locked: dict[str, float] = {}
    for i, equality in enumerate(_active(root, "joint")):
        key = f"equality joint {i + 1}:"
        a = numbers(equality, "polycoef", 5, file, key, "0 1 0 0 0")
        if any(a[2:]):
            raise MechanismError(
                "Only linear couplings are read.", "Set the last three coefficients to 0.",
                file=file, key=f"{key} polycoef", value=a,
            )  # fmt: skip
        first, second = equality.get("joint1", ""), equality.get("joint2")
        if second is None:
            locked[first] = a[0]
        else:
            couplings.append({"joint": first, "of": second, "ratio": a[1], "offset": a[0]})
    return couplings, locked


def _keep_closures(root: Element, file: Path) -> dict[str, list[str]]:
    """Leave active connects and welds for Pinocchio; returns their labels. Other equalities are refused."""
    bodies = [body.get("name", "") for body in root.iter("body")]
    kept = _active(root, "connect", "weld")
    names: dict[str, list[str]] = {"connect": [], "weld": []}
    for i, equality in enumerate(kept):
        label = equality.get("name") or f"{equality.tag}{i + 1}"
        key = f"equality '{label}'"
        if equality.get("body1") is None or (equality.tag == "connect" and equality.get("anchor") is None):
            raise MechanismError(
                "A closure between sites is not read.", "Give body1, body2 and anchor.", file=file, key=key
            )
        for end in ("body1", "body2"):
            if equality.get(end, WORLD) not in bodies:
                raise NameNotFound("body", equality.get(end, ""), bodies, file=file, key=f"{key}: {end}")
        if label in names["connect"] + names["weld"]:
            raise MechanismError("Two closures have this name.", "Give each its own.", file=file, key=key)
        names[str(equality.tag)].append(label)
    for equality in _active(root, "tendon", "flex", "distance"):
        raise MechanismError(
            f"An equality of type {equality.tag} is not read.", "Remove it.", file=file, key="equality"
        )
    for section in root.findall("equality"):
        for element in list(section):
            if element not in kept:
                section.remove(element)
    return names


def _parse(root: Element, file: Path) -> tuple[pin.Model, Any, Any]:
    with tempfile.TemporaryDirectory() as folder:
        mended = Path(folder) / "model.xml"
        mended.write_bytes(etree.tostring(root))
        try:
            model, points, welds = pin.buildModelAndConstraintsFromMJCF(str(mended))
        except Exception as error:
            raise MechanismError(f"Pinocchio cannot read this MJCF ({error}).", "Mend it.", file=file) from error
    return model, points, welds


def _drives_and_seed(root: Element, model: pin.Model, file: Path) -> dict[str, Any]:
    joints = list(model.names)[1:]
    driven = [a.get("joint") for a in root.findall("actuator/*") if a.get("joint") in joints]
    said: dict[str, Any] = {"actuated": tuple(driven)} if driven else {}
    key = root.find("keyframe/key")
    if key is not None and key.get("qpos") is not None:
        values = xml.numbers(key, "qpos", model.nq, file, "keyframe key")
        said["seed"] = dict(zip(joints, values, strict=True))
    return said
