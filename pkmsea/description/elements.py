"""Elements of a URDF: those that are read, those that change no motion, and all others, which are refused by name."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pkmsea.description.xml import Element, tag
from pkmsea.errors import MechanismError

READ = {
    "robot": ("link", "joint"),
    "link": ("inertial", "visual", "origin"),
    "joint": ("parent", "child", "origin", "axis", "limit", "mimic"),
    "inertial": ("origin", "mass", "inertia"),
}
NOTED = {"joint": ("dynamics",), "link": ("gravity", "kinematic")}
HARMLESS = {  # looks, contact, sensors, control and simulators: nothing of the free motion follows from them
    "robot": (
        "material", "sensor", "ros2_control", "fixed_frame", "frame", "mujoco", "verbose", "self_collision_checking",
        "collision_filter_group", "drake:collision_filter_group", "disable_collisions", "collision_pairs",
    ),
    "link": (
        "collision", "contact", "surface", "sensor", "material", "verbose", "self_collide", "self_filter",
        "collision_checking", "drake:proximity_properties",
    ),
    "joint": ("calibration", "safety_controller", "joint_properties", "hardwareInterface"),
    "inertial": (),
}  # fmt: skip


def refuse_unknown(root: Element, file: Path, loops: Iterable[str]) -> None:
    """Refuse elements that might change the motion and are not read; conventions read `loops` and others of <robot>.

    Raises
    ------
    MechanismError : names the element and where it stands.
    """
    for holder in root.iter(*READ):
        kind = str(holder.tag)
        if kind != "robot" and holder.getparent().tag not in READ:
            continue
        known = {*READ[kind], *NOTED.get(kind, ()), *HARMLESS[kind], *(loops if kind == "robot" else ())}
        for element in holder:
            if tag(element) not in known:
                name = next((e.get("name") for e in (holder, *holder.iterancestors()) if e.get("name")), "")
                raise MechanismError(
                    f"<{tag(element)}> in <{kind}> is not known, and the motion may depend on it.",
                    "Remove it if it does not. Loops are read from "
                    f"{', '.join(f'<{loop}>' for loop in loops)}, and from 'closures' of a mechanism.yaml.",
                    file=file,
                    key=f"{kind} '{name}': {tag(element)}",
                )
