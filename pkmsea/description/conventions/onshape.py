"""onshape-to-robot: a mate named closing_X becomes two links closing_X_1 and closing_X_2 that coincide."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from pkmsea.description.xml import Element
from pkmsea.errors import MechanismError

TAGS: tuple[str, ...] = ()
LABEL = "closing_*_1/_2 frames of onshape-to-robot"
FRAME = re.compile(r"(closing_.+)_([12])")


def read(root: Element, file: Path) -> dict[str, Any]:
    """The pairs of frames as point closures; empty where there are none."""
    matches = [FRAME.fullmatch(link.get("name", "")) for link in root.findall("link")]
    found = {(match[1], match[2]) for match in matches if match}
    names = sorted({name for name, _ in found})
    for name in names:
        for side in "12":
            if (name, side) not in found:
                raise MechanismError(
                    f"The closing frame has no partner '{name}_{side}'.",
                    "Export both frames, or rename this link if it closes no loop.",
                    file=file,
                    key=f"link '{name}_{'21'[int(side) - 1]}'",
                )
    if not names:
        return {}
    return {"closures": [{"name": name, "frames": (f"{name}_1", f"{name}_2"), "type": "point"} for name in names]}
