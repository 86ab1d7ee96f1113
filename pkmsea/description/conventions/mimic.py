"""URDF `<mimic>`: q_joint = multiplier q_other + offset, as a coupling."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pkmsea.description.xml import Element, number
from pkmsea.errors import NameNotFound

LABEL = "<mimic> joints"


def read(root: Element, file: Path) -> dict[str, Any]:
    """Mimic joints as couplings; empty where there are none."""
    moving = {joint.get("name", ""): joint for joint in root.findall("joint") if joint.get("type") != "fixed"}
    couplings = []
    for name, joint in moving.items():
        mimic = joint.find("mimic")
        if mimic is None:
            continue
        key, other = f"joint '{name}': mimic", mimic.get("joint", "")
        if other not in moving:
            raise NameNotFound("moving joint", other, list(moving), file=file, key=key)
        ratio, offset = (number(mimic, a, file, key, d) for a, d in (("multiplier", "1"), ("offset", "0")))
        couplings.append({"joint": name, "of": other, "ratio": ratio, "offset": offset})
    return {"couplings": couplings} if couplings else {}
