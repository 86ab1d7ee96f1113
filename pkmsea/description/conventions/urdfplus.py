"""URDF+ (generalized_rbda): `<loop>` elements with predecessor and successor, `independent` attributes of joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pkmsea.description.conventions import keys
from pkmsea.description.xml import Element, axis
from pkmsea.errors import MechanismError

LABEL = "URDF+"
TAGS: tuple[str, ...] = ("loop", "coupling")
TYPES = {"revolute": "revolute", "continuous": "revolute", "fixed": "frame", "spherical": "point", "ball": "point"}
ENDS = ("predecessor", "successor")


def read(root: Element, file: Path) -> dict[str, Any]:
    """Loops as closures between two new frames, and the independent joints; empty where the file is plain URDF."""
    loops, links = root.findall("loop"), keys.names(root)
    marked = [joint for joint in root.findall("joint") if joint.get("independent") is not None]
    if root.find("coupling") is not None:
        raise MechanismError(
            "A <coupling> of two chains is not read.",
            "State it per pair of joints under 'couplings' instead.",
            file=file,
            key=f"coupling '{root.find('coupling').get('name')}'",
        )
    if not loops and not marked:
        return {}
    said: dict[str, Any] = {}
    for i, loop in enumerate(loops):
        name = loop.get("name") or f"loop{i + 1}"
        key = f"loop '{name}'"
        kind = keys.kind_of(loop.get("type", ""), TYPES, file, key)
        ends = {f"{name}_{end}": _placement(loop.find(end), links, file, f"{key}: {end}") for end in ENDS}
        along = axis(loop, file, f"{key}:") if kind == "revolute" else None
        said = keys.joined(said, keys.closure(name, kind, ends, along), file)
    moving = [joint for joint in root.findall("joint") if joint.get("type") != "fixed"]
    independent = tuple(j.get("name", "") for j in moving if j.get("independent", "true").lower() != "false")
    return said | ({"independent": independent} if independent else {})


def _placement(end: Element | None, links: list[str], file: Path, key: str) -> dict[str, Any]:
    if end is None:
        raise MechanismError("This end of the loop is missing.", "Name its link.", file=file, key=key)
    return keys.placement(end.get("link"), end.find("origin"), links, file, f"{key} origin")
