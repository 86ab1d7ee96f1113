"""Gepetto's example-parallel-robots: a robot.yaml with `closed_loop`, `type`, `name_mot` and `joint_type`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pkmsea.errors import InputError

NAME = "robot.yaml"
LABEL = "robot.yaml of example-parallel-robots"
FIXED = "FIXED"
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
    if fixed := _types(data, file):
        data["locked"] = fixed | data.get("locked", {})
    if "name_mot" in data:
        data["actuated"] = data.pop("name_mot")
    return data


def _types(data: dict[str, Any], file: Path) -> dict[str, float]:
    """Joints that the loader of this convention fixes. Those that it makes balls of may not stay hinges unnoticed.

    Raises
    ------
    InputError : a joint becomes one of several coordinates; names it.
    """
    names, types = (data.pop(key, None) or [] for key in ("joint_name", "joint_type"))
    if not (isinstance(names, list) and isinstance(types, list) and len(names) == len(types)):
        raise InputError(
            "There must be one type per name.", "Give two lists.", file=file, key="joint_type", value=types
        )
    for i, (name, kind) in enumerate(zip(names, types, strict=True)):
        if kind != FIXED:
            raise InputError(
                f"The joint '{name}' is of type {kind}, of which the URDF has one hinge only; read as that hinge this "
                "would be another mechanism. Ball and universal joints are not read yet.",
                "Write it into the URDF as hinges with light links between, and take both keys out.",
                file=file,
                key=f"joint_type.{i}",
                value=kind,
            )
    return dict.fromkeys(names, 0.0)
