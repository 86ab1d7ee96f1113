"""Where a mechanism lies: by path, or by the name of one that pkmsea or example-robot-data ships."""

from __future__ import annotations

import os
from pathlib import Path

from pkmsea.description import robots
from pkmsea.errors import InputError
from pkmsea.files import is_file

PACKAGED = Path(__file__).parents[1] / "urdf"  # the mechanisms that pkmsea ships
CHECKOUT = Path(__file__).parents[2] / "urdf"


def find(source: str | Path) -> Path:
    """A mechanism's folder or file: a path, the name of one that pkmsea ships ('pkm_2rrr', 'urdf/pkm_2rrr'), or of a
    robot of example-robot-data ('example-robot-data/ur5_robot.urdf')."""
    path = Path(source)
    for candidate in (path, PACKAGED / path.name, CHECKOUT / path.name):
        if os.path.isdir(candidate):
            return candidate
    if is_file(path):
        return path
    if robots.is_robot(path):
        return robots.find_robot(path)
    raise InputError(
        "There is no mechanism of this name.",
        "Give a folder with a URDF and a mechanism.yaml, a file of links and joints, a robot of example-robot-data "
        f"('{robots.PACKAGE}/ur5_robot.urdf'), or one that pkmsea ships: {', '.join(shipped())}.",
        file=source,
    )


def shipped() -> list[str]:
    """Names of the mechanisms that pkmsea ships."""
    return sorted({folder.name for root in (PACKAGED, CHECKOUT) if root.is_dir() for folder in root.iterdir()})
