"""Changing a mechanism: places, lengths and masses in its URDF, and any number of its sidecar.

joint.NAME.origin.x | y | z | roll | pitch | yaw      where the joint sits on its parent [m, rad]
link.NAME.mass, link.NAME.com.x | y | z               [kg], [m]
link.NAME.inertia.ixx | iyy | izz | ixy | ixz | iyz   about the centre of mass [kg m^2]
link.NAME.length                                      distance to its farthest child [m]; the link is stretched as a
                                                      slender rod: mass grows with length, inertia with its cube
seed.JOINT, gravity.I and so on                       keys of mechanism.yaml
"""

from __future__ import annotations

import hashlib
import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from lxml import etree

from pkmsea.description import xml
from pkmsea.description.sidecar import SIDECAR
from pkmsea.description.source import read_source
from pkmsea.errors import InputError, Unwritable
from pkmsea.files import read_yaml
from pkmsea.study.keys import Missing, assign

XYZ, RPY = ("x", "y", "z"), ("roll", "pitch", "yaw")
INERTIA = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
OF_LINK = ["mass", "length", *(f"com.{x}" for x in XYZ), *(f"inertia.{x}" for x in INERTIA)]


def changed_mechanism(source: Path, numbers: Mapping[str, float], folder: Path) -> tuple[Path, dict[str, Missing]]:
    """A copy of a mechanism with numbers replaced, in a folder of its own below `folder`, named by its content; and the
    keys that lead nowhere in it.

    Raises
    ------
    InputError : the mechanism is not a folder with a URDF and a mechanism.yaml. Unwritable : the disk is full, say.
    """
    said = read_source(source)
    if said.tree.suffix != ".urdf" or said.sidecar is None or said.sidecar.name != SIDECAR:
        raise InputError(
            "Only a URDF with a mechanism.yaml can be varied.",
            "Write one with 'pkmsea check --write' or by hand.",
            file=source,
        )
    tree, sidecar = xml.parse(said.tree), read_yaml(said.sidecar)
    missing = {}
    for key, number in numbers.items():
        kind, _, rest = key.partition(".")
        try:
            if kind in ("joint", "link"):
                (_change_joint if kind == "joint" else _change_link)(tree, sidecar, rest, number)
            else:
                assign(sidecar, key.split("."), number)
        except Missing as found:
            missing[key] = found
    sidecar["urdf"] = said.tree.name
    contents = {said.tree.name: etree.tostring(tree), SIDECAR: yaml.safe_dump(sidecar).encode()}
    digest = hashlib.sha256(b"".join(contents.values())).hexdigest()[:16]
    return _write(folder / f"{said.folder.resolve().name}-{digest}", contents), missing


def _write(folder: Path, contents: Mapping[str, bytes]) -> Path:
    """Write files into a new folder, whole or not at all."""
    if folder.is_dir():
        return folder
    written = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        written = Path(tempfile.mkdtemp(dir=folder.parent))
        for name, content in contents.items():
            (written / name).write_bytes(content)
        written.chmod(0o755)
        written.rename(folder)
    except OSError as error:
        if not folder.is_dir():  # else another process was first
            raise Unwritable(
                f"The changed mechanism cannot be written ({error.strerror or error}).",
                "Make room on the disk, or choose another output folder.",
                file=folder,
            ) from error
    finally:
        if written is not None:
            shutil.rmtree(written, ignore_errors=True)
    return folder


def _named(tree: xml.Element, kind: str, rest: str) -> tuple[xml.Element, str]:
    """The element whose name `rest` begins with, and what follows it."""
    elements = {element.get("name", ""): element for element in tree.iterfind(kind)}
    for name in sorted(elements, key=len, reverse=True):
        if rest.startswith(f"{name}."):
            return elements[name], rest[len(name) + 1 :]
    raise Missing([f"{kind}.{name}" for name in elements])


def _change_joint(tree: xml.Element, sidecar: Any, rest: str, number: float) -> None:
    joint, what = _named(tree, "joint", rest)
    known = [f"origin.{name}" for name in XYZ + RPY]
    if what not in known:
        raise Missing(known)
    _set(_child(joint, "origin"), what.removeprefix("origin."), number)


def _change_link(tree: xml.Element, sidecar: Any, rest: str, number: float) -> None:
    link, what = _named(tree, "link", rest)
    inertial = link.find("inertial")
    if what not in OF_LINK or (inertial is None and what != "length"):
        raise Missing(OF_LINK)
    if what == "length":
        _stretch(tree, sidecar, link, number)
    elif what == "mass":
        _child(inertial, "mass").set("value", repr(number))
    elif what.startswith("com."):
        _set(_child(inertial, "origin"), what.removeprefix("com."), number)
    else:
        _child(inertial, "inertia").set(what.removeprefix("inertia."), repr(number))


def _child(element: Any, tag: str) -> xml.Element:
    found = element.find(tag)
    return etree.SubElement(element, tag) if found is None else found


def _set(origin: xml.Element, coordinate: str, number: float) -> None:
    """Replace one number of an <origin>."""
    attribute, names = ("xyz", XYZ) if coordinate in XYZ else ("rpy", RPY)
    values = _vector(origin, attribute)
    values[names.index(coordinate)] = number
    origin.set(attribute, xml.text(values))


def _vector(element: xml.Element, attribute: str) -> np.ndarray:
    return np.array([float(word) for word in element.get(attribute, "0 0 0").split()])


def _stretch(tree: xml.Element, sidecar: Any, link: xml.Element, length: float) -> None:
    """Stretch a link with all that sits on it, frames of the sidecar included."""
    name = link.get("name")
    joints = [joint for joint in tree.iterfind("joint") if joint.find("parent").get("link") == name]
    origins = [_child(joint, "origin") for joint in joints]
    frames = [frame for frame in (sidecar.get("frames") or {}).values() if frame.get("link") == name]
    reached = [_vector(origin, "xyz") for origin in origins] + [
        np.array(frame.get("xyz", [0, 0, 0])) for frame in frames
    ]
    present = max((float(np.linalg.norm(place)) for place in reached), default=0.0)
    if present == 0 or length <= 0:
        raise Missing([])
    factor = length / present
    for frame in frames:
        frame["xyz"] = [float(x) * factor for x in frame.get("xyz", [0, 0, 0])]
    inertial = link.find("inertial")
    bodies = [element for tag in ("inertial", "visual") for element in link.iterfind(tag)]
    for origin in origins + [_child(element, "origin") for element in bodies]:
        origin.set("xyz", xml.text(_vector(origin, "xyz") * factor))
    for box in link.iterfind("visual/geometry/box"):
        sides = _vector(box, "size")
        sides[sides.argmax()] *= factor
        box.set("size", xml.text(sides))
    if inertial is not None:
        mass, inertia = _child(inertial, "mass"), _child(inertial, "inertia")
        mass.set("value", repr(float(mass.get("value", "0")) * factor))
        for key in INERTIA:
            inertia.set(key, repr(float(inertia.get(key, "0")) * factor**3))
