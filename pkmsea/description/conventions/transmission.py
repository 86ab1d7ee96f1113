"""ROS `<transmission>` elements: the joints that they name have drives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pkmsea.description.xml import Element

LABEL = "<transmission> elements"


def read(root: Element, file: Path) -> dict[str, Any]:
    """The joints of the transmissions as `actuated`; empty where there are none."""
    joints = {joint.get("name") for joint in root.findall("joint") if joint.get("type") != "fixed"}
    named = [joint.get("name") for joint in root.findall("transmission/joint")]
    actuated = tuple(dict.fromkeys(name for name in named if name in joints))
    return {"actuated": actuated} if actuated else {}
