"""The limits of a URDF's joints, without the numbers that only stand in place of one."""

from __future__ import annotations

import math
from collections.abc import Container
from dataclasses import dataclass
from pathlib import Path

from pkmsea.description.xml import Element
from pkmsea.errors import MechanismError

ENDLESS = 1e3  # [rad, m, rad/s, m/s, N m, N]; exporters write 0, or a number from here on, where nobody set a limit
POSITIONS, LARGEST = ("lower", "upper"), ("velocity", "effort")


@dataclass(frozen=True)
class JointLimits:
    """What a joint's <limit> says [rad, m, rad/s, m/s, N m, N]; infinite where it sets none.

    `continuous` says that the joint may turn without end.
    """

    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf
    continuous: bool = False


def joint_limits(joint: Element, file: Path) -> JointLimits:
    """Of a moving joint.

    Raises
    ------
    MechanismError : a limit is no number or negative, or leaves the joint no room; names joint, value and remedy.
    """
    said, continuous = _said(joint, file), joint.get("type") == "continuous"
    at = {} if continuous else _positions(said)
    if at and at["lower"] >= at["upper"]:
        raise MechanismError(
            "The limits leave the joint no room.",
            "Correct them; or make the joint type='fixed', or name it under 'locked'.",
            file=file,
            key=f"joint '{joint.get('name')}': limit",
            value=list(at.values()),
        )
    ends = {key: x for key, x in at.items() if abs(x) < ENDLESS}
    most = {key: said[key] for key in LARGEST if 0 < said.get(key, 0) < ENDLESS}
    return JointLimits(**ends, **most, continuous=continuous)


def placeholder_notes(root: Element, locked: Container[str], actuated: Container[str] | None, file: Path) -> list[str]:
    """A note on the numbers that stand for no limit of the joints that move, those of effort at `actuated` joints."""
    found: dict[str, list[str]] = {}
    for joint in root.findall("joint"):
        name, said = joint.get("name", ""), _said(joint, file)
        if joint.get("type") == "fixed" or name in locked:
            continue
        dropped = [f"{key} {said[key]:g}" for key in LARGEST if key in said and not 0 < said[key] < ENDLESS]
        if actuated is not None and name not in actuated:
            dropped = [text for text in dropped if not text.startswith("effort")]
        if joint.get("type") != "continuous" and set(said) & set(POSITIONS):
            at = _positions(said)
            dropped += [f"{key} {x:g}" for key, x in at.items() if abs(x) >= ENDLESS] if at else ["lower 0, upper 0"]
        for text in dropped:
            found.setdefault(text, []).append(name)
    listed = "; ".join(f"{text} ({', '.join(names)})" for text, names in found.items())
    return [f"numbers that stand for no limit are not taken for one: {listed}"] if listed else []


def _said(joint: Element, file: Path) -> dict[str, float]:
    """The numbers that stand in <limit>."""
    limit, said = joint.find("limit"), {}
    for key in (*POSITIONS, *LARGEST) if limit is not None else ():
        if not (text := limit.get(key, "").strip()):
            continue
        try:
            said[key] = float(text)
        except ValueError:
            said[key] = math.nan
        if math.isnan(said[key]) or (key in LARGEST and said[key] < 0):
            what = "a number" if math.isnan(said[key]) else "a magnitude, which cannot be negative"
            raise MechanismError(
                f"This is not {what}.",
                "Give it in rad, m, s, N and kg, or leave it out.",
                file=file,
                key=f"joint '{joint.get('name')}': limit {key}",
                value=text,
            )
    return said


def _positions(said: dict[str, float]) -> dict[str, float]:
    """Lower and upper position; one that is left out is zero, and none are said where both are."""
    at = {key: said.get(key, 0.0) for key in POSITIONS}
    return at if any(at.values()) else {}
