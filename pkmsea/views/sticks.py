"""Sticks for links that have nothing to draw."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from lxml import etree

from pkmsea.description.xml import Element, text

THICKNESS = 0.04  # of a stick, relative to the longest
COLOR = "0.45 0.55 0.65 1"


def add(root: Element, model: pin.Model) -> None:
    """Add cylinders to each moving link without <visual>: from its origin to the joints and frames it carries."""
    ends: dict[str, list[np.ndarray]] = {}
    drawn = {link.get("name") for link in root.findall("link") if link.find("visual") is not None}
    for joint in range(1, model.njoints):
        at = [model.jointPlacements[i].translation for i in range(1, model.njoints) if model.parents[i] == joint]
        frames = [frame for frame in model.frames if frame.parentJoint == joint]
        if not drawn & {frame.name for frame in frames}:
            ends[_link(root, model, joint)] = at + [frame.placement.translation for frame in frames]
    lengths = [float(np.linalg.norm(end)) for each in ends.values() for end in each]
    longest = max(lengths, default=0.0)
    for link in root.findall("link"):
        for end in _distinct(ends.get(link.get("name", ""), []), longest):
            link.append(_stick(end, THICKNESS * longest / 2))


def _link(root: Element, model: pin.Model, joint: int) -> str:
    """The link whose frame is the joint's."""
    named = {element.get("name"): element for element in root.findall("joint")}
    return str(named[model.names[joint]].find("child").get("link"))


def _distinct(ends: list[np.ndarray], longest: float) -> list[np.ndarray]:
    kept: list[np.ndarray] = []
    for end in ends:
        if np.linalg.norm(end) > THICKNESS * longest and all(np.linalg.norm(end - k) > 1e-9 for k in kept):
            kept.append(end)
    return kept


def _stick(end: np.ndarray, radius: float) -> Element:
    length = float(np.linalg.norm(end))
    z = end / length
    x = np.cross(np.eye(3)[int(np.abs(z).argmin())], z)
    x /= np.linalg.norm(x)
    rpy = pin.rpy.matrixToRpy(np.column_stack([x, np.cross(z, x), z]))
    visual = etree.Element("visual")
    etree.SubElement(visual, "origin", xyz=text(end / 2), rpy=text(rpy))
    shape = etree.SubElement(etree.SubElement(visual, "geometry"), "cylinder")
    shape.set("radius", repr(radius))
    shape.set("length", repr(length))
    material = etree.SubElement(visual, "material", name="stick")
    etree.SubElement(material, "color", rgba=COLOR)
    return visual
