"""A `pin.Model` of revolute and prismatic joints as URDF, so that every convention goes one way from here."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from lxml import etree

from pkmsea.bridge import joint_axis
from pkmsea.description.xml import Element, text

BASE = "universe"
FRAMES = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)


def body_frame(model: pin.Model, joint: int) -> str:
    """Name of the link that moves with a joint."""
    return f"moved_by_{model.names[joint]}" if joint else BASE


def to_urdf(model: pin.Model, name: str) -> Element:
    """Links named after the joints that move them, and the model's bodies and sites as links fixed to these."""
    root = etree.Element("robot", name=name)
    for i in range(model.njoints):
        link = etree.SubElement(root, "link", name=body_frame(model, i))
        _inertial(link, model.inertias[i])
        if i:
            _joint(root, model, i)
    taken = {link.get("name") for link in root.findall("link")}
    for frame in model.frames:
        if frame.type not in FRAMES or frame.name in taken:
            continue
        taken.add(frame.name)
        etree.SubElement(root, "link", name=frame.name)
        joint = etree.SubElement(root, "joint", name=f"{frame.name}_fixed", type="fixed")
        etree.SubElement(joint, "parent", link=body_frame(model, frame.parentJoint))
        etree.SubElement(joint, "child", link=frame.name)
        _origin(joint, frame.placement)
    return root


def _joint(root: Element, model: pin.Model, i: int) -> None:
    axis, turning = joint_axis(model, i)
    joint = etree.SubElement(root, "joint", name=model.names[i], type="revolute" if turning else "prismatic")
    etree.SubElement(joint, "parent", link=body_frame(model, model.parents[i]))
    etree.SubElement(joint, "child", link=body_frame(model, i))
    _origin(joint, model.jointPlacements[i])
    etree.SubElement(joint, "axis", xyz=text(axis))
    at = model.joints[i].idx_q
    lower, upper = float(model.lowerPositionLimit[at]), float(model.upperPositionLimit[at])
    if np.isfinite([lower, upper]).all():
        etree.SubElement(joint, "limit", lower=repr(lower), upper=repr(upper), effort="0", velocity="0")
    if model.armature[at] or model.damping[at]:
        etree.SubElement(joint, "dynamics", damping=text([model.damping[at]]), armature=text([model.armature[at]]))


def _inertial(link: Element, inertia: pin.Inertia) -> None:
    if inertia.mass == 0:
        return
    inertial = etree.SubElement(link, "inertial")
    _origin(inertial, pin.SE3(np.eye(3), inertia.lever))
    etree.SubElement(inertial, "mass", value=repr(float(inertia.mass)))
    moments = {f"i{'xyz'[r]}{'xyz'[c]}": repr(float(inertia.inertia[r, c])) for r in range(3) for c in range(r, 3)}
    etree.SubElement(inertial, "inertia", **moments)


def _origin(element: Element, placement: pin.SE3) -> None:
    rpy = pin.rpy.matrixToRpy(placement.rotation)
    etree.SubElement(element, "origin", xyz=text(placement.translation), rpy=text(rpy))
