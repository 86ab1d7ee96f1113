"""URDF+ (generalized_rbda): `<loop>` elements with predecessor and successor, `independent` attributes of joints."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pkmsea.description.xml import Element, numbers
from pkmsea.errors import MechanismError, NameNotFound

LABEL = "URDF+"
TYPES = {"revolute": "revolute", "continuous": "revolute", "fixed": "frame", "spherical": "point", "ball": "point"}


def read(root: Element, file: Path) -> dict[str, Any]:
    """Loops as closures between two new frames, and the independent joints; empty where the file is plain URDF."""
    loops = root.findall("loop")
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
    said: dict[str, Any] = {"frames": {}, "closures": []}
    links = [link.get("name", "") for link in root.findall("link")]
    for i, loop in enumerate(loops):
        name = loop.get("name") or f"loop{i + 1}"
        pair = {end: f"{name}_{end}" for end in ("predecessor", "successor")}
        for end, frame in pair.items():
            said["frames"][frame] = _placement(loop.find(end), links, file, f"loop '{name}': {end}")
        kind = loop.get("type", "")
        if kind not in TYPES:
            raise MechanismError(
                "This type of loop joint is not read.",
                f"Use one of: {', '.join(TYPES)}.",
                file=file,
                key=f"loop '{name}': type",
                value=kind,
            )
        closure = {"name": name, "frames": tuple(pair.values()), "type": TYPES[kind]}
        if TYPES[kind] == "revolute":
            closure["axis"] = tuple(numbers(loop.find("axis"), "xyz", 3, file, f"loop '{name}': axis", "1 0 0"))
        said["closures"].append(closure)
    moving = [joint for joint in root.findall("joint") if joint.get("type") != "fixed"]
    independent = tuple(j.get("name", "") for j in moving if j.get("independent", "true").lower() != "false")
    return said | ({"independent": independent} if independent else {})


def _placement(end: Element | None, links: list[str], file: Path, key: str) -> dict[str, Any]:
    link = "" if end is None else end.get("link", "")
    if end is None or link not in links:
        raise NameNotFound("link", link, links, file=file, key=key)
    origin = end.find("origin")
    xyz, rpy = (tuple(numbers(origin, a, 3, file, f"{key} origin", "0 0 0")) for a in ("xyz", "rpy"))
    return {"link": link, "xyz": xyz, "rpy": rpy}
