"""From a description to a `pin.Model`: the tree, gravity, and the frames that the tree lacks."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from lxml import etree

from pkmsea.bridge import frame_id
from pkmsea.description import Description, Frame
from pkmsea.errors import MechanismError, NameNotFound


def build_model(description: Description) -> pin.Model:
    """The open tree as Pinocchio has it.

    Raises
    ------
    MechanismError : Pinocchio cannot model the tree, nothing moves in it, or a frame has no place; names file and key.
    """
    file = description.origin.tree
    try:
        model = pin.buildModelFromXML(_of_plain_joints(description.tree))
    except Exception as error:
        raise MechanismError(f"Pinocchio cannot model this URDF ({error}).", "Mend the URDF.", file=file) from error
    if model.nq == 0:
        raise MechanismError("The tree has no moving joint.", "Add a revolute or prismatic joint.", file=file)
    model.gravity.linear = np.array(description.gravity)
    limits = description.limits
    own = [limits[name] for name in list(model.names)[1:]]
    model.lowerPositionLimit, model.upperPositionLimit = np.array([(each.lower, each.upper) for each in own]).T
    for frame in description.frames:
        _add_frame(model, frame, description)
    return model


def _of_plain_joints(tree: str) -> str:
    """A tree whose continuous joints have an angle as coordinate, like the others, not a point of the circle."""
    root = etree.fromstring(tree.encode())
    for joint in root.iterfind("joint[@type='continuous']"):
        joint.set("type", "revolute")
    return str(etree.tostring(root, encoding="unicode"))


def _add_frame(model: pin.Model, frame: Frame, description: Description) -> None:
    where = description.where("frames", f"frames.{frame.name}")
    if model.existFrame(frame.name):
        raise MechanismError("The tree has a frame of this name already.", "Choose another name.", **where)
    if not model.existFrame(frame.link):
        raise NameNotFound("frame", frame.link, sorted({known.name for known in model.frames}), **where)
    on = frame_id(model, frame.link)
    parent = model.frames[on]
    placement = parent.placement * pin.SE3(pin.rpy.rpyToMatrix(np.array(frame.rpy)), np.array(frame.xyz))
    model.addFrame(pin.Frame(frame.name, parent.parentJoint, on, placement, pin.FrameType.OP_FRAME), False)
