"""Robots of the package example-robot-data, by name: 'example-robot-data/ur5_robot.urdf', wherever it is installed."""

from __future__ import annotations

from pathlib import Path, PurePath
from typing import Any

import pinocchio as pin

from pkmsea.errors import InputError, NameNotFound

PACKAGE = "example-robot-data"
ROBOTS = Path(pin.__file__).parents[4] / "share" / PACKAGE / "robots"  # both are installed under one prefix


def is_robot(name: str | Path) -> bool:
    """Whether this names a robot of the package rather than a file."""
    return PurePath(name).parts[:1] == (PACKAGE,)


def find_robot(name: str | Path, **where: Any) -> Path:
    """The tree that 'example-robot-data/PATH' names, PATH being the end of its path in the package.

    Raises
    ------
    NameNotFound : lists the robots that there are. InputError : several have that name.
    """
    end = PurePath(name).parts[1:]
    trees = {tree.relative_to(ROBOTS).parts: tree for tree in sorted(ROBOTS.rglob("*.urdf"))}
    found = [parts for parts in trees if end and parts[-len(end) :] == end]
    if not found:
        raise NameNotFound(f"robot of {PACKAGE}", "/".join(end), sorted({parts[-1] for parts in trees}), **where)
    if len(found) > 1:
        names = ", ".join("/".join((PACKAGE, *parts)) for parts in found)
        raise InputError(f"{len(found)} robots have the name '{'/'.join(end)}'.", f"Use one of: {names}.", **where)
    return trees[found[0]]
