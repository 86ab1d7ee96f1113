"""A URDF of any version as one of version 1.0: with a name, and orientations as roll, pitch and yaw."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin

from pkmsea.description.xml import Element, numbers, text
from pkmsea.errors import MechanismError


def make_plain(root: Element, file: Path) -> None:
    """Rewrite a URDF in place.

    Raises
    ------
    MechanismError : an orientation stands twice, or is none.
    """
    if not root.get("name"):
        root.set("name", file.stem)
    root.attrib.pop("version", None)
    for origin in root.iter("origin", "parent_origin", "child_origin"):
        if origin.get("quat_xyzw") is None:
            continue
        holder = next((e for e in origin.iterancestors() if e.get("name")), root)
        key = f"{holder.tag} '{holder.get('name')}': {origin.tag}"
        quaternion = np.array(numbers(origin, "quat_xyzw", 4, file, key))
        if origin.get("rpy") is not None or not quaternion.any():
            cause = "The quaternion is zero." if not quaternion.any() else "There are both rpy and quat_xyzw."
            raise MechanismError(cause, "Give one orientation.", file=file, key=key)
        rotation = pin.Quaternion(quaternion / np.linalg.norm(quaternion)).matrix()
        origin.set("rpy", text(pin.rpy.matrixToRpy(rotation)))
        del origin.attrib["quat_xyzw"]
