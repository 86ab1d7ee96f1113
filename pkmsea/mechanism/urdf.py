"""From a URDF file to a `pin.Model`: found, read and validated by yourdfpy, mended where URDF and Pinocchio differ."""

from __future__ import annotations

import logging
import math
from pathlib import Path

import pinocchio as pin
import yourdfpy
from lxml import etree

from pkmsea.errors import InputError, MechanismError

PACKAGED = Path(__file__).parents[1] / "urdf"  # the mechanisms that pkmsea ships
CHECKOUT = Path(__file__).parents[2] / "urdf"
WIDE = 1e3  # limit of a joint that turns without end [rad]


def find_folder(source: str | Path) -> Path:
    """The folder of a mechanism: a path, or the name of one that pkmsea ships ('pkm_2rrr', 'urdf/pkm_2rrr')."""
    path = Path(source)
    for candidate in (path, PACKAGED / path.name, CHECKOUT / path.name):
        if candidate.is_dir():
            return candidate
    if path.is_file():
        return path.parent
    raise InputError(
        "There is no mechanism folder of this name.",
        f"Give a folder with a URDF and a mechanism.yaml, or one that pkmsea ships: {', '.join(shipped())}.",
        file=source,
    )


def shipped() -> list[str]:
    """Names of the mechanisms that pkmsea ships."""
    return sorted({folder.name for root in (PACKAGED, CHECKOUT) if root.is_dir() for folder in root.iterdir()})


def find_urdf(folder: Path, named: str | None) -> Path:
    """The URDF that the sidecar names, else the only one of the folder."""
    if named is not None:
        path = (folder / named).resolve()
        if not path.is_relative_to(folder.resolve()) or not path.is_file():
            raise MechanismError(
                "The URDF that 'urdf' names is not in the mechanism's folder.", "Put it there or correct the name.",
                file=folder / "mechanism.yaml", key="urdf", value=named,
            )  # fmt: skip
        return path
    found = sorted(folder.glob("*.urdf"))
    if len(found) != 1:
        raise MechanismError(
            f"The folder holds {len(found)} files *.urdf.", "Name one in mechanism.yaml with the key 'urdf'.",
            file=folder, key="urdf",
        )  # fmt: skip
    return found[0]


def read_model(path: Path) -> tuple[pin.Model, str]:
    """The tree as a `pin.Model`, and the mended URDF text for the views.

    Continuous joints become revolute with wide limits, so that every joint has one coordinate.

    Raises
    ------
    MechanismError : the file does not parse, is no valid URDF, or has a mass or inertia that no body has.
    """
    root = _parse(path)
    _validate(path)
    for joint in root.iter("joint"):
        if joint.find("mimic") is not None:
            raise MechanismError(
                "Mimic joints are not supported.",
                "Remove <mimic>, or model the transmission by joints and a closure.",
                file=path,
                key=f"joint '{joint.get('name')}': mimic",
            )
        _mend(joint)
    _check_inertias(root, path)
    text = etree.tostring(root, encoding="unicode")
    try:
        model = pin.buildModelFromXML(text)
    except Exception as error:
        raise MechanismError(f"Pinocchio cannot model this URDF ({error}).", "Mend the URDF.", file=path) from error
    if model.nq == 0:
        raise MechanismError("The tree has no moving joint.", "Add a revolute or prismatic joint.", file=path)
    return model, text


def _parse(path: Path) -> etree._Element:
    parser = etree.XMLParser(resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True)
    try:
        root = etree.parse(str(path), parser).getroot()
    except (etree.XMLSyntaxError, OSError) as error:
        raise MechanismError(f"The URDF does not parse: {error}.", "Mend the XML at that line.", file=path) from error
    if root.tag != "robot":
        raise MechanismError(f"The root element is <{root.tag}>, not <robot>.", "Give a URDF file.", file=path)
    return root


def _validate(path: Path) -> None:
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)  # it logs what the error below says
    try:
        robot = yourdfpy.URDF.load(
            str(path), build_scene_graph=False, load_meshes=False, build_collision_scene_graph=False
        )
        valid, faults = robot.validate(), robot.errors
    except Exception as error:
        raise MechanismError(f"The URDF cannot be read: {error!r}.", "Mend that element.", file=path) from error
    if not valid:
        raise MechanismError(f"The URDF is not valid: {faults[0]}.", "Mend that element.", file=path)


def _mend(joint: etree._Element) -> None:
    if joint.get("type") != "continuous":
        return
    joint.set("type", "revolute")
    limit = joint.find("limit")
    if limit is None:
        limit = etree.SubElement(joint, "limit", effort="0", velocity="0")
    limit.set("lower", str(-WIDE))
    limit.set("upper", str(WIDE))


def _check_inertias(root: etree._Element, path: Path) -> None:
    for link in root.iter("link"):
        inertial = link.find("inertial")
        if inertial is None:
            continue
        name = link.get("name")
        mass = _number(inertial.find("mass"), "value", path, f"link {name}: mass")
        if mass < 0:
            raise MechanismError(
                "A mass cannot be negative.", "Give the link's mass in kg.",
                file=path, key=f"link '{name}': mass", value=mass,
            )  # fmt: skip
        inertia = inertial.find("inertia")
        if inertia is None:
            continue
        for axis in ("ixx", "iyy", "izz"):
            moment = _number(inertia, axis, path, f"link {name}: {axis}")
            if moment < 0:
                raise MechanismError(
                    "A moment of inertia cannot be negative.", "Give it in kg m^2 about the centre of mass.",
                    file=path, key=f"link '{name}': {axis}", value=moment,
                )  # fmt: skip


def _number(element: etree._Element | None, attribute: str, path: Path, key: str) -> float:
    text = "" if element is None else element.get(attribute, "")
    try:
        number = float(text)
    except ValueError:
        number = math.nan
    if not math.isfinite(number):
        raise MechanismError("This is not a finite number.", "Give a number.", file=path, key=key, value=text)
    return number
