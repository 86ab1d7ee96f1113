"""`<loop_joint>` of Isaac Sim, and of Drake before 2018: two links with a place on each, and an axis in Drake's."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pkmsea.description.conventions import keys
from pkmsea.description.xml import Element, axis
from pkmsea.errors import MechanismError

LABEL = "<loop_joint> elements"
TAGS: tuple[str, ...] = ("loop_joint",)
TYPES = {"spherical": "point", "ball": "point", "revolute": "revolute", "continuous": "revolute", "fixed": "frame"}
ENDS = ("link1", "link2")  # Isaac Sim's documentation writes link1 twice


def read(root: Element, file: Path) -> dict[str, Any]:
    """Loop joints as closures between two new frames; empty where there are none."""
    said: dict[str, Any] = {}
    for i, loop in enumerate(root.findall("loop_joint")):
        name = loop.get("name") or f"loop_joint{i + 1}"
        key = f"loop_joint '{name}'"
        ends = [element for element in loop if element.tag in ENDS]
        if len(ends) != len(ENDS):
            raise MechanismError(
                f"A loop joint has two ends, not {len(ends)}.", f"Give {' and '.join(ENDS)}.", file=file, key=key
            )
        kind, links = keys.kind_of(loop.get("type", ""), TYPES, file, key), keys.names(root)
        placements = {
            f"{name}_{j}": keys.placement(end.get("link"), end, links, file, f"{key}: {end.tag}")
            for j, end in enumerate(ends, 1)
        }
        along = axis(loop, file, f"{key}:") if loop.find("axis") is not None else None
        said = keys.joined(said, keys.closure(name, kind, placements, along), file)
    return said
