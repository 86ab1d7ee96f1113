"""A four-bar in the plane of x and z, opened at a pin: crank 0.1 m, coupler 0.2 m, rocker 0.16 m, ground 0.2 m."""

from __future__ import annotations

from pathlib import Path

import five_bar

HALF_PI = "1.5707963267948966"
SEED = {"j1": 1.44, "j2": -1.131, "j3": 1.548}
LINK = (
    '<link name="{}"><inertial><mass value="1"/><origin xyz="{} 0 0"/>'
    '<inertia ixx="1e-4" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{}" type="continuous"><parent link="{}"/><child link="{}"/><origin xyz="{} {} 0" rpy="{}"/>'
    '<axis xyz="{}"/></joint>'
)


def tree(
    turn: str = HALF_PI, layer: float = 0.0, size: float = 1.0, axes: tuple[str, ...] = ("0 0 1",) * 3, more: str = ""
) -> str:
    """The open chain: `turn` is the roll of the base joints, `layer` how far the rocker lies beside the coupler [m]."""
    base = f"{turn} 0 0"
    return "\n".join([
        '<robot name="four_bar"><link name="base"/>',
        *(LINK.format(name, at * size) for name, at in (("l1", 0.05), ("l2", 0.1), ("l3", 0.08))),
        JOINT.format("j1", "base", "l1", 0, 0, base, axes[0]),
        JOINT.format("j2", "l1", "l2", 0.1 * size, 0, "0 0 0", axes[1]),
        JOINT.format("j3", "base", "l3", 0.2 * size, layer, base, axes[2]),
        more,
        "</robot>",
    ])  # fmt: skip


def ends(size: float = 1.0) -> dict[str, dict]:
    """The frames that coincide."""
    return {"e2": {"link": "l2", "xyz": [0.2 * size, 0, 0]}, "e3": {"link": "l3", "xyz": [0.16 * size, 0, 0]}}


def four_bar(folder: Path, text: str | None = None, **keys: object) -> Path:
    """Tree and sidecar in a folder; keys of the sidecar are replaced, and left out where they are None."""
    sidecar: dict[str, object] = {
        "frames": ends(), "closures": [{"frames": ["e2", "e3"]}], "plane": {"normal": [0, 1, 0]}, "actuated": ["j1"],
        "end_effector": {"frame": "e2", "axes": ["x"]}, "seed": SEED,
    } | keys  # fmt: skip
    present = {key: value for key, value in sidecar.items() if value is not None}
    return five_bar.write(folder, "four_bar.urdf", tree() if text is None else text, present)
