"""`<constraint>`, as proposed for urdfdom in 2026 (ros/urdfdom 264, ros/urdfdom_headers 108): a loop cut at a joint or
link, with a parent frame and a child frame that coincide."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pkmsea.description.conventions import keys
from pkmsea.description.xml import Element, numbers
from pkmsea.errors import MechanismError

LABEL = "<constraint> elements of urdfdom"
TAGS: tuple[str, ...] = ("constraint",)
TYPES = {"revolute": "revolute", "spherical": "point", "link": "frame"}
TYPES |= {"revolute_joint": "revolute", "spherical_joint": "point"}
SIDES = ("parent", "child")
PARALLEL = 1e-6  # sine of the angle up to which two axes are one
TINY = 1e-300  # keeps an axis of zero finite, which is refused elsewhere


def read(root: Element, file: Path) -> dict[str, Any]:
    """Constraints as closures between two new frames; empty where there are none."""
    said: dict[str, Any] = {}
    for i, constraint in enumerate(root.findall("constraint")):
        name = constraint.get("name") or f"constraint{i + 1}"
        key = f"constraint '{name}'"
        kind = keys.kind_of(constraint.get("type", ""), TYPES, file, key)
        ends = {f"{name}_{side}": _end(constraint, side, keys.names(root), file, key) for side in SIDES}
        axis = _axis(constraint, file, key) if kind == "revolute" else None
        said = keys.joined(said, keys.closure(name, kind, ends, axis), file)
    return said


def _end(constraint: Element, side: str, links: list[str], file: Path, key: str) -> dict[str, Any]:
    element = constraint.find(side)
    link = None if element is None else element.get("link")
    return keys.placement(link, constraint.find(f"{side}_origin"), links, file, f"{key}: {side}")


def _axis(constraint: Element, file: Path, key: str) -> list[float] | None:
    """The axis, whose numbers count in both frames; None where it is not stated."""
    axes = [
        numbers(element, "xyz", 3, file, f"{key}: {side}_axis")
        for side in SIDES
        if (element := constraint.find(f"{side}_axis")) is not None
    ]
    if len(axes) == len(SIDES):
        parent, child = (np.array(axis) / max(float(np.linalg.norm(axis)), TINY) for axis in axes)
        if np.abs(np.cross(parent, child)).max() > PARALLEL:
            raise MechanismError(
                "The axes of parent and child differ; the one axis of a revolute constraint counts in both frames.",
                "Turn one of the frames by the rpy of its origin until they are the same.",
                file=file,
                key=f"{key}: child_axis",
                value=axes[1],
            )
    return axes[0] if axes else None
