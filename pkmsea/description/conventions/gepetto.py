"""Gepetto's example-parallel-robots: `closed_loop`, `type` and `name_mot` in a robot.yaml beside the URDF."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pkmsea.errors import InputError

NAME = "robot.yaml"
LABEL = "robot.yaml of example-parallel-robots"
TYPES = {"3d": "point", "6d": "frame"}


def speaks(data: Any) -> bool:
    """Whether the content of a YAML file is of this convention."""
    return isinstance(data, dict) and "closed_loop" in data


def read(data: dict[str, Any], file: Path) -> dict[str, Any]:
    """The same as sidecar keys; other keys stay, so that a file may mix both."""
    data = dict(data)
    pairs, types = data.pop("closed_loop"), data.pop("type", None)
    if not isinstance(pairs, list):
        raise InputError(
            "This is not a list of frame pairs.", "Write [[frame, frame], ...].", file=file, key="closed_loop"
        )
    if types is None:
        types = ["3d"] * len(pairs)
    if not isinstance(types, list) or len(types) != len(pairs):
        raise InputError(
            f"There must be one type per closed loop, {len(pairs)}.",
            f"Use {' or '.join(TYPES)} for each.",
            file=file,
            key="type",
            value=types,
        )
    for i, kind in enumerate(types):
        if str(kind).lower() not in TYPES:
            raise InputError(
                "This type of closure is not known.",
                f"Use {' or '.join(TYPES)}.",
                file=file,
                key=f"type.{i}",
                value=kind,
            )
    data["closures"] = [
        {"frames": pair, "type": TYPES[str(kind).lower()]} for pair, kind in zip(pairs, types, strict=True)
    ]
    if "name_mot" in data:
        data["actuated"] = data.pop("name_mot")
    return data
