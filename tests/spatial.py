"""Spatial mechanisms with loops: a point-shaped delta robot of three arms, and a five-bar closed by a rigid weld."""

from __future__ import annotations

import math
from pathlib import Path

import five_bar

RADIUS, UPPER, LOWER, HEIGHT = 0.1, 0.15, 0.3, -0.25  # [m]
ARMS = "ABC"


def delta(folder: Path) -> Path:
    """Three arms, each a revolute at the base and a universal joint at the elbow; their tips meet in one point.

    9 joints, two point closures of 3 rows: mobility 3.
    """
    text, seed = ['<robot name="delta"><link name="base"/>'], {}
    for i, arm in enumerate(ARMS):
        turn = 2 * math.pi * i / 3
        base = f"{RADIUS * math.cos(turn)!r} {RADIUS * math.sin(turn)!r} 0"
        upper, cross, lower, tip = (f"{part}_{arm}" for part in ("upper", "cross", "lower", "tip"))
        text += [
            _joint(arm, "base", upper, base, "0 1 0", f"0 0 {turn!r}"), _rod(upper, UPPER, 0.2),
            _joint(f"{arm}_swing", upper, cross, f"{UPPER} 0 0", "0 1 0"), f'<link name="{cross}"/>',
            _joint(f"{arm}_tilt", cross, lower, "0 0 0", "0 0 1"), _rod(lower, LOWER, 0.05),
            f'<joint name="{tip}_mount" type="fixed"><parent link="{lower}"/><child link="{tip}"/>'
            f'<origin xyz="{LOWER} 0 0"/></joint><link name="{tip}"/>',
        ]  # fmt: skip
        seed |= {arm: 0.2, f"{arm}_swing": 2.0}
    keys = {
        "closures": [{"frames": ["tip_A", f"tip_{arm}"]} for arm in ARMS[1:]],
        "actuated": list(ARMS), "end_effector": {"frame": "tip_A", "axes": ["x", "y", "z"]}, "seed": seed,
    }  # fmt: skip
    return five_bar.write(folder, "delta.urdf", "\n".join([*text, "</robot>"]), keys)


def welded(folder: Path) -> Path:
    """The five-bar with arm B's forearm cut off behind its elbow and welded on again: 5 joints, 6 rows of rank 3."""
    variant = five_bar.Variant(open_at="elbow_B")
    at = five_bar.angles()
    stub = (
        '<link name="stub"/><joint name="elbow_B" type="revolute"><parent link="upper_B"/><child link="stub"/>'
        '<axis xyz="0 0 1"/><origin xyz="0.2 0 0"/></joint>'
    )
    tree = five_bar.urdf(variant, ends=("weld", ""), more=stub)
    keys = five_bar.sidecar(variant) | {"closures": [{"frames": ["weld", "stub"], "type": "frame"}]}
    keys["seed"] |= {"elbow_B": at["lower_B"] - at["upper_B"]}
    del keys["plane"]
    return five_bar.write(folder, "robot.urdf", tree, keys)


def _joint(name: str, parent: str, child: str, xyz: str, axis: str, rpy: str = "0 0 0") -> str:
    return (
        f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
        f'<origin xyz="{xyz}" rpy="{rpy}"/></joint>'
    )


def _rod(link: str, length: float, mass: float) -> str:
    moment = mass * length**2 / 12
    return (
        f'<link name="{link}"><inertial><origin xyz="{length / 2} 0 0"/><mass value="{mass}"/>'
        f'<inertia ixx="{moment / 100}" iyy="{moment}" izz="{moment}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )
