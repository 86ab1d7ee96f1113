"""From a source to a `pin.Model`: checked, cleaned, and with the frames that the sidecar adds."""

from __future__ import annotations

import io
import logging
import os
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import yourdfpy
from lxml import etree

from pkmsea.bridge import frame_id
from pkmsea.errors import InputError, MechanismError, NameNotFound
from pkmsea.files import is_file
from pkmsea.mechanism import robots, sticks, tree
from pkmsea.mechanism.clean import clean
from pkmsea.mechanism.conventions import Source

PACKAGED = Path(__file__).parents[1] / "urdf"  # the mechanisms that pkmsea ships
CHECKOUT = Path(__file__).parents[2] / "urdf"


def find(source: str | Path) -> Path:
    """A mechanism's folder or file: a path, the name of one that pkmsea ships ('pkm_2rrr', 'urdf/pkm_2rrr'), or of a
    robot of example-robot-data ('example-robot-data/ur5_robot.urdf')."""
    path = Path(source)
    for candidate in (path, PACKAGED / path.name, CHECKOUT / path.name):
        if os.path.isdir(candidate):
            return candidate
    if is_file(path):
        return path
    if robots.is_robot(path):
        return robots.find_robot(path)
    raise InputError(
        "There is no mechanism of this name.",
        "Give a folder with a URDF and a mechanism.yaml, a file of links and joints, a robot of example-robot-data "
        f"('{robots.PACKAGE}/ur5_robot.urdf'), or one that pkmsea ships: {', '.join(shipped())}.",
        file=source,
    )


def shipped() -> list[str]:
    """Names of the mechanisms that pkmsea ships."""
    return sorted({folder.name for root in (PACKAGED, CHECKOUT) if root.is_dir() for folder in root.iterdir()})


def build_model(source: Source) -> tuple[pin.Model, str, list[str]]:
    """The tree as a `pin.Model` with gravity, the cleaned URDF text for the views, and notes on what was cleaned.

    Raises
    ------
    MechanismError : the file is no tree that pkmsea can model; names link or joint.
    """
    file, draft = source.tree, source.draft
    tree.check(source.root, file)
    notes = clean(source.root, file, draft.locked)
    text = etree.tostring(source.root, encoding="unicode")
    _validate(text, file)
    model = _pinocchio(text, file)
    model.gravity.linear = np.array(draft.gravity)
    for name, placement in draft.frames.items():
        _add_frame(model, name, placement.link, pin.SE3(
            pin.rpy.rpyToMatrix(np.array(placement.rpy)), np.array(placement.xyz)), source)  # fmt: skip
    sticks.add(source.root, model)
    return model, etree.tostring(source.root, encoding="unicode"), notes


def _validate(text: str, file: Path) -> None:
    """What yourdfpy finds wrong with a cleaned tree."""
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)  # it logs what the error below says
    try:
        robot = yourdfpy.URDF.load(
            io.BytesIO(text.encode()), build_scene_graph=False, load_meshes=False, build_collision_scene_graph=False
        )
        valid, faults = robot.validate(), robot.errors
    except Exception as error:
        raise MechanismError(f"The URDF cannot be read: {error!r}.", "Mend that element.", file=file) from error
    if not valid:
        raise MechanismError(f"The URDF is not valid: {faults[0]}.", "Mend that element.", file=file)


def _pinocchio(text: str, file: Path) -> pin.Model:
    try:
        model = pin.buildModelFromXML(text)
    except Exception as error:
        raise MechanismError(f"Pinocchio cannot model this URDF ({error}).", "Mend the URDF.", file=file) from error
    if model.nq == 0:
        raise MechanismError("The tree has no moving joint.", "Add a revolute or prismatic joint.", file=file)
    return model


def _add_frame(model: pin.Model, name: str, on: str, placement: pin.SE3, source: Source) -> None:
    where: dict[str, Any] = {"file": source.where("frames"), "key": f"frames.{name}"}
    if model.existFrame(name):
        raise MechanismError("The tree has a frame of this name already.", "Choose another name.", **where)
    if not model.existFrame(on):
        raise NameNotFound("frame", on, sorted({frame.name for frame in model.frames}), **where)
    parent = model.frames[frame_id(model, on)]
    model.addFrame(pin.Frame(name, parent.parentJoint, frame_id(model, on), parent.placement * placement,
                             pin.FrameType.OP_FRAME), False)  # fmt: skip
