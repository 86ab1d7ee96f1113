"""MJCF (MuJoCo): Pinocchio's parser reads the tree and its equality constraints; the tree becomes URDF."""

from __future__ import annotations

import copy
import tempfile
from pathlib import Path
from typing import Any

import pinocchio as pin
from lxml import etree

from pkmsea.description import xml
from pkmsea.description.conventions.mjcf_mend import WORLD, mend
from pkmsea.description.conventions.to_urdf import body_frame, to_urdf
from pkmsea.description.xml import Element, numbers
from pkmsea.errors import MechanismError, NameNotFound

SUFFIXES: tuple[str, ...] = (".mjcf",)
LABEL = "MJCF"
MARKED = False
GRAVITY = "0 0 -9.81"


def speaks(root: Element, file: Path) -> bool:
    """Whether this is a MuJoCo model, whatever the file's name."""
    return bool(root.tag == "mujoco")


def read(root: Element, file: Path) -> tuple[Element, dict[str, Any]]:
    """The tree as URDF, and closures, couplings, gravity, drives and a seed as sidecar keys.

    Raises
    ------
    MechanismError : something that would change the motion and is not read here.
    """
    root = copy.deepcopy(root)
    mend(root, file)
    couplings, locked = _joint_equalities(root, file)
    names = _keep_closures(root, file)
    model, points, welds = _parse(root, file)
    said: dict[str, Any] = {"frames": {}, "closures": []}
    kinds = [("point", list(points), names["connect"]), ("frame", list(welds), names["weld"])]
    for kind, constraints, labels in kinds:
        for constraint, label in zip(constraints, labels, strict=True):
            ends = {
                f"{label}_1": _placement(model, constraint.joint1_id, constraint.joint1_placement),
                f"{label}_2": _placement(model, constraint.joint2_id, constraint.joint2_placement),
            }
            said["frames"] |= ends
            said["closures"].append({"name": label, "frames": tuple(ends), "type": kind})
    option = root.find("option")
    said["gravity"] = tuple(numbers(option, "gravity", 3, file, "option", GRAVITY))
    said |= {"couplings": couplings} if couplings else {}
    said |= {"locked": locked} if locked else {}
    said |= _drives_and_seed(root, model, file)
    return to_urdf(model, root.get("model") or "mjcf"), said


def _placement(model: pin.Model, joint: int, placement: pin.SE3) -> dict[str, Any]:
    rpy = pin.rpy.matrixToRpy(placement.rotation)
    return {"link": body_frame(model, joint), "xyz": tuple(placement.translation), "rpy": tuple(rpy)}


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
                "Only linear couplings are read.",
                "Set the last three coefficients to 0.",
                file=file,
                key=f"{key} polycoef",
                value=a,
            )
        first, second = equality.get("joint1", ""), equality.get("joint2")
        if second is None:
            locked[first] = a[0]
        else:
            couplings.append({"joint": first, "of": second, "ratio": a[1], "offset": a[0]})
    return couplings, locked


def _keep_closures(root: Element, file: Path) -> dict[str, list[str]]:
    """Leave active connects and welds for Pinocchio; returns their labels. Other equalities are refused."""
    bodies = [body.get("name", "") for body in root.findall("worldbody//body")]
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
