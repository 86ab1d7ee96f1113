"""Joints that imitate another, q_joint = multiplier q_other + offset, as couplings: URDF's `<mimic>`, the parameters of
ros2_control, and the plugins that Gazebo needs for them."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pkmsea.description.xml import Element, number
from pkmsea.errors import NameNotFound

LABEL = "<mimic> joints"
TAGS: tuple[str, ...] = ()
PLUGIN = re.compile("mimic", re.IGNORECASE)


def read(root: Element, file: Path) -> dict[str, Any]:
    """Mimic joints as couplings; empty where there are none. What the tree says itself goes before simulators."""
    moving = {joint.get("name", ""): joint for joint in root.findall("joint") if joint.get("type") != "fixed"}
    couplings: dict[str, dict[str, Any]] = {}
    for name, said, key in (*_mimics(moving), *_parameters(root), *_plugins(root)):
        if name not in moving or name in couplings:
            continue
        other = said.get("joint", "")
        if other not in moving:
            raise NameNotFound("moving joint", other, list(moving), file=file, key=key)
        ratio, offset = (number(said, a, file, key, d) for a, d in (("multiplier", "1"), ("offset", "0")))
        couplings[name] = {"joint": name, "of": other, "ratio": ratio, "offset": offset}
    return {"couplings": tuple(couplings.values())} if couplings else {}


def _mimics(moving: Mapping[str, Element]) -> Iterator[tuple[str, Any, str]]:
    for name, joint in moving.items():
        if (mimic := joint.find("mimic")) is not None:
            yield name, mimic.attrib, f"joint '{name}': mimic"


def _parameters(root: Element) -> Iterator[tuple[str, Any, str]]:
    for joint in root.findall("ros2_control/joint"):
        said = {param.get("name", ""): (param.text or "").strip() for param in joint.findall("param")}
        if "mimic" in said:
            name = joint.get("name", "")
            yield name, said | {"joint": said["mimic"]}, f"ros2_control joint '{name}': mimic"


def _plugins(root: Element) -> Iterator[tuple[str, Any, str]]:
    for plugin in root.findall("gazebo/plugin"):
        said = {str(element.tag): (element.text or "").strip() for element in plugin}
        if PLUGIN.search(f"{plugin.get('name')} {plugin.get('filename')}") and "mimicJoint" in said:
            yield said["mimicJoint"], said, f"gazebo plugin '{plugin.get('name')}': joint"
