"""ROS `<transmission>` elements, also those of ros2_control: which joints have drives, with which gears and rotors."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from pkmsea.description.xml import Element, number

LABEL = "<transmission> elements"
TAGS: tuple[str, ...] = ("transmission",)
REDUCTIONS = ("mechanicalReduction", "mechanical_reduction", "gear_ratio")
ROTORS = ("rotor_inertia", "rotorInertia", "inertia")


class Gear(NamedTuple):
    """What a transmission of one joint tells: motor turns per output turn, rotor inertia at the motor [kg m^2] or 0."""

    reduction: float
    rotor: float

    @property
    def plain(self) -> bool:
        """Whether it tells nothing."""
        return abs(self.reduction) == 1.0 and self.rotor == 0.0

    def __str__(self) -> str:
        return f"{self.reduction:g}:1" + (f" with a rotor of {self.rotor:g} kg m^2" if self.rotor else "")


def read(root: Element, file: Path) -> dict[str, Any]:
    """The joints of the transmissions as `actuated`; empty where there are none."""
    joints = {joint.get("name") for joint in root.findall("joint") if joint.get("type") != "fixed"}
    named = [joint.get("name") for joint in root.findall("transmission/joint")]
    actuated = tuple(dict.fromkeys(name for name in named if name in joints))
    told = [f"'{name}' {gear}" for name, gear in gears(root, file).items() if name in joints and not gear.plain]
    several = [f"'{t.get('name')}'" for t in root.findall("transmission") if len(t.findall("joint")) > 1]
    notes = {
        "gears of transmissions belong to the task, where 'pkmsea new' writes them": told,
        "transmissions of several joints count as one drive per joint": several,
    }
    said = {
        "actuated": actuated,
        "notes": tuple(f"{note}: {', '.join(named)}" for note, named in notes.items() if named),
    }
    return {key: value for key, value in said.items() if value}


def gears(root: Element, file: Path) -> dict[str, Gear]:
    """By joint, what its transmission tells, where that has one joint and one actuator at most."""
    found = {}
    for transmission in (*root.findall("transmission"), *root.findall("ros2_control/transmission")):
        joints, actuators = transmission.findall("joint"), transmission.findall("actuator")
        if len(joints) != 1 or len(actuators) > 1:
            continue
        name = joints[0].get("name", "")
        inside = {str(e.tag).rpartition("}")[2]: e for e in transmission.iter() if e is not transmission}
        found[name] = Gear(_value(inside, REDUCTIONS, "1", file, name), _value(inside, ROTORS, "0", file, name))
    return found


def _value(inside: dict[str, Element], tags: tuple[str, ...], default: str, file: Path, joint: str) -> float:
    element = next((inside[name] for name in tags if name in inside), None)
    text = default if element is None else (element.get("value") or element.text or "").strip()
    return number({"value": text}, "value", file, f"transmission of '{joint}':")
