"""Likely slips of unit in a URDF: degrees, millimetres and grams where radians, metres and kilograms are meant."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from pkmsea.description.limits import joint_limits
from pkmsea.description.xml import Element, number, numbers

TURN = 2 * np.pi  # [rad]
TURNS = 2  # a joint rarely makes more to one side
LONG = 20.0  # [m]; a link is rarely longer
LEAN = 0.02  # of a link's length; a slender rod has a radius of gyration of 0.29, one of 0.009 if its mass is in grams
MOMENTS = ("ixx", "iyy", "izz")


def slips(root: Element, file: Path) -> list[str]:
    """Notes on numbers of a checked tree that another unit would explain."""
    lengths = list(_lengths(root, file))
    return [*_angles(root, file), *_limits(root, file), *(lengths or _masses(root, file))]


def _origins(root: Element) -> Iterator[tuple[str, Element]]:
    for holder in (*root.findall("joint"), *root.findall("link/inertial")):
        named = holder if holder.get("name") else holder.getparent()
        if (origin := holder.find("origin")) is not None:
            yield f"{named.tag} '{named.get('name')}'", origin


def _angles(root: Element, file: Path) -> Iterator[str]:
    for where, origin in _origins(root):
        rpy = numbers(origin, "rpy", 3, file, where, "0 0 0")
        if max(map(abs, rpy)) > TURN:
            yield f"{where}: rpy = {origin.get('rpy')} is more than a turn; angles are in rad, are these degrees?"


def _limits(root: Element, file: Path) -> Iterator[str]:
    for joint in root.findall("joint[@type='revolute']"):
        at = joint_limits(joint, file)
        if TURNS * TURN < max(abs(at.lower), abs(at.upper)) < np.inf:
            yield (
                f"joint '{joint.get('name')}': limits {at.lower:g} to {at.upper:g} are many turns; angles are in rad, "
                "are these degrees?"
            )


def _lengths(root: Element, file: Path) -> Iterator[str]:
    for where, origin in _origins(root):
        length = float(np.linalg.norm(numbers(origin, "xyz", 3, file, where, "0 0 0")))
        if length > LONG:
            yield f"{where}: its origin is {length:.4g} m away; lengths are in m, are these mm?"


def _masses(root: Element, file: Path) -> Iterator[str]:
    """A radius of gyration far below the length of the link means too much mass for the inertia."""
    moved = {joint.find("child").get("link") for joint in root.findall("joint") if joint.get("type") != "fixed"}
    for link in root.findall("link"):
        if link.get("name") not in moved:
            continue
        inertial, where = link.find("inertial"), f"link '{link.get('name')}'"
        if inertial is None:
            continue
        mass = number(inertial.find("mass"), "value", file, where)
        moment = max(number(inertial.find("inertia"), m, file, where) for m in MOMENTS)
        radius, length = float(np.sqrt(moment / mass)) if mass else 0.0, _length(root, link, file)
        if 0 < radius < LEAN * length:
            yield (
                f"{where}: its radius of gyration is {radius:.2g} m, and it is {length:.2g} m long; masses are in kg, "
                "inertias in kg m^2: is one of them in another unit?"
            )


def _length(root: Element, link: Element, file: Path) -> float:
    """Distance to the farthest joint that the link carries [m]."""
    name = link.get("name")
    carried = [joint.find("origin") for joint in root.findall("joint") if joint.find("parent").get("link") == name]
    return max((float(np.linalg.norm(numbers(o, "xyz", 3, file, "", "0 0 0"))) for o in carried), default=0.0)
