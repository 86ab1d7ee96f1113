"""The planar five-bar of `pkm_2rrr` from one description, written in every convention and in many equivalent ways."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from pkmsea.mechanism import load_mechanism

LENGTH = 0.2
MASS = {"upper": 0.1104, "lower": 0.0448}
MOMENT = {"upper": (1.9872e-06, 0.000368), "lower": (8.064e-07, 0.0001493333333)}
BASES = {"A": (0.0, 0.2309401077), "B": (-0.2, -0.1154700538)}
LOOP = [  # body, joint, next body, ... around the loop, back to the base
    ("base", "A", "upper_A"),
    ("upper_A", "elbow_A", "lower_A"),
    ("lower_A", "tips", "lower_B"),
    ("lower_B", "elbow_B", "upper_B"),
    ("upper_B", "B", "base"),
]
POINTS = {  # of each joint in each body; a body's own frame lies at its end towards the base
    **{("base", arm): np.array([*BASES[arm], 0.0]) for arm in "AB"},
    **{(f"upper_{arm}", arm): np.zeros(3) for arm in "AB"},
    **{(f"upper_{arm}", f"elbow_{arm}"): np.array([LENGTH, 0, 0]) for arm in "AB"},
    **{(f"lower_{arm}", f"elbow_{arm}"): np.zeros(3) for arm in "AB"},
    **{(f"lower_{arm}", "tips"): np.array([LENGTH, 0, 0]) for arm in "AB"},
}
PLAIN = {"plane": {"normal": [0, 0, 1]}, "gravity": [0, 0, 0]}


def angles() -> dict[str, float]:
    """Absolute angles of the bodies at the shipped mechanism's seed, closed to rounding."""
    mechanism = load_mechanism("pkm_2rrr")
    q = dict(zip(mechanism.joints, mechanism.seed.tolist(), strict=True))
    turned = {"base": 0.0}
    for arm in "AB":
        turned[f"upper_{arm}"] = q[arm]
        turned[f"lower_{arm}"] = q[arm] + q[f"elbow_{arm}"]
    return turned


@dataclass(frozen=True)
class Variant:
    """One of many equivalent descriptions: where the loop is open, which axes are flipped, names, order of drives."""

    open_at: str = "tips"
    flipped: frozenset[str] = frozenset()
    names: Mapping[str, str] = field(default_factory=dict)
    drives: tuple[str, ...] = ("A", "B")

    def name(self, joint: str) -> str:
        return self.names.get(joint, joint)

    @property
    def tree(self) -> list[tuple[str, str, str]]:
        """(parent, joint, child) from the base outwards on both sides of the opening."""
        cut = [joint for _, joint, _ in LOOP].index(self.open_at)
        return LOOP[:cut] + [(after, joint, before) for before, joint, after in reversed(LOOP[cut + 1 :])]

    @property
    def seed(self) -> dict[str, float]:
        at = angles()
        sign = {joint: -1.0 if joint in self.flipped else 1.0 for _, joint, _ in self.tree}
        return {self.name(joint): sign[joint] * (at[child] - at[parent]) for parent, joint, child in self.tree}


def urdf(variant: Variant, ends: tuple[str, str] = ("tip_1", "tip_2"), more: str = "", marks: str = "") -> str:
    """The tree; the ends of the opening are links of these names, unless empty. `marks` goes into each joint."""
    origin = {child: POINTS[child, joint] for _, joint, child in variant.tree} | {"base": np.zeros(3)}
    text = ['<robot name="five_bar">', '<link name="base"/>']
    for parent, joint, child in variant.tree:
        sign = -1 if joint in variant.flipped else 1
        text.append(
            f'<joint name="{variant.name(joint)}" type="revolute" {marks if joint not in variant.drives else ""}>'
            f'<parent link="{parent}"/><child link="{child}"/><axis xyz="0 0 {sign}"/>'
            f'<origin xyz="{_xyz(POINTS[parent, joint] - origin[parent])}"/>'
            '<limit lower="-6.3" upper="6.3" effort="900" velocity="900"/></joint>'
        )
        text.append(f'<link name="{child}">{_inertial(child, origin[child])}</link>')
    sides = [body for pair in LOOP if pair[1] == variant.open_at for body in (pair[0], pair[2])]
    for end, body in zip(ends, sides, strict=True):
        text += _mounted(end, body, POINTS[body, variant.open_at] - origin[body]) if end else []
    text += _mounted("tool", "lower_A", POINTS["lower_A", "tips"] - origin["lower_A"])
    return "\n".join([*text, more, "</robot>"])


def _mounted(link: str, body: str, at: np.ndarray) -> list[str]:
    return [
        f'<link name="{link}"/><joint name="{link}_mount" type="fixed"><parent link="{body}"/><child link="{link}"/>'
        f'<origin xyz="{_xyz(at)}"/></joint>'
    ]


def _inertial(body: str, origin: np.ndarray) -> str:
    kind = body.split("_")[0]
    thin, thick = MOMENT[kind]
    return (
        f'<inertial><origin xyz="{_xyz(np.array([LENGTH / 2, 0, 0]) - origin)}"/><mass value="{MASS[kind]}"/>'
        f'<inertia ixx="{thin}" iyy="{thick}" izz="{thick}" ixy="0" ixz="0" iyz="0"/></inertial>'
    )


def _xyz(vector: np.ndarray) -> str:
    return " ".join(repr(float(x) + 0.0) for x in vector)


def sidecar(variant: Variant) -> dict:
    """What every convention leaves to our own keys: drives, end effector, seed, plane and gravity."""
    drives = [variant.name(joint) for joint in variant.drives]
    return {
        "actuated": drives, "end_effector": {"frame": "tool", "axes": ["x", "y"]}, "seed": variant.seed, **PLAIN
    }  # fmt: skip


def write(folder: Path, name: str, tree: str, keys: dict | None) -> Path:
    """A mechanism's folder with one tree, and one YAML file unless `keys` is None."""
    folder.mkdir()
    (folder / name).write_text(tree)
    if keys is not None:
        (folder / ("robot.yaml" if "closed_loop" in keys else "mechanism.yaml")).write_text(yaml.safe_dump(keys))
    return folder


def native(folder: Path, variant: Variant = Variant()) -> Path:
    closures = [{"frames": ["tip_1", "tip_2"]}]
    return write(folder, "robot.urdf", urdf(variant), sidecar(variant) | {"closures": closures})


def gepetto(folder: Path) -> Path:
    keys = sidecar(Variant())
    loops = {"closed_loop": [["tip_1", "tip_2"]], "type": ["3d"], "name_mot": keys.pop("actuated")}
    return write(folder, "robot.urdf", urdf(Variant()), keys | loops)


def urdfplus(folder: Path) -> Path:
    end = '<origin xyz="0.2 0 0"/>'
    loop = (
        f'<loop name="tips" type="revolute"><predecessor link="lower_A">{end}</predecessor>'
        f'<successor link="lower_B">{end}</successor><axis xyz="0 0 1"/></loop>'
    )
    tree = urdf(Variant(), ends=("", ""), more=loop, marks='independent="false"')
    return write(folder, "robot.urdf", tree, sidecar(Variant()))


def onshape(folder: Path) -> Path:
    return write(folder, "robot.urdf", urdf(Variant(), ends=("closing_tips_1", "closing_tips_2")), sidecar(Variant()))


END = ("lower_A", "lower_B")  # links whose ends at 0.2 m are the tips


def _open(folder: Path, closing: str, head: str = '<robot name="five_bar">') -> Path:
    tree = urdf(Variant(), ends=("", ""), more=closing).replace('<robot name="five_bar">', head)
    return write(folder, "robot.urdf", tree, sidecar(Variant()))


def constraint(folder: Path) -> Path:
    """The child's frame is turned about the axis, and given by a quaternion."""
    return _open(folder, (
        '<constraint name="tips" type="revolute"><parent link="lower_A"/><parent_origin xyz="0.2 0 0" rpy="0 0 0.4"/>'
        '<parent_axis xyz="0 0 2"/><child link="lower_B"/><child_origin xyz="0.2 0 0" quat_xyzw="0 0 0.6 0.8"/>'
        '<child_axis xyz="0 0 1"/></constraint>'
    ))  # fmt: skip


def loop_joint(folder: Path) -> Path:
    """As Isaac Sim's documentation writes it, with two ends of the same name."""
    ends = "".join(f'<link1 link="{link}" rpy="0 0 0" xyz="0.2 0 0"/>' for link in END)
    return _open(folder, f'<loop_joint name="tips" type="spherical">{ends}</loop_joint>')


def drake(folder: Path) -> Path:
    parts = {
        "body_A": 'name="lower_A"',
        "p_AP": 'value="0.2 0 0"',
        "body_B": 'name="lower_B"',
        "p_BQ": 'value="0.2 0 0"',
    }
    inside = "".join(f"<drake:ball_constraint_{part} {said}/>" for part, said in parts.items())
    head = '<robot name="five_bar" xmlns:drake="http://drake.mit.edu">'
    return _open(folder, f"<drake:ball_constraint>{inside}</drake:ball_constraint>", head)


def gazebo(folder: Path) -> Path:
    """SDF closes the loop with all joints at zero, so that they count from the seed."""
    turns = iter(Variant().seed.values())
    axis = '<axis xyz="0 0 1"/><origin '
    pieces = urdf(Variant(), ends=("", ""), more=(
        '<gazebo><joint name="tips" type="revolute"><parent>five_bar::lower_A</parent><child>lower_B</child>'
        "<pose>0.2 0 0 0 0 0.3</pose><axis><xyz>0 0 1</xyz></axis></joint></gazebo>"
    )).split(axis)  # fmt: skip
    tree = pieces[0] + "".join(f'{axis}rpy="0 0 {next(turns)!r}" {piece}' for piece in pieces[1:])
    return write(folder, "robot.urdf", tree, sidecar(Variant()) | {"seed": {}})


def mjcf(folder: Path) -> Path:
    """MuJoCo closes the loop where it starts, so its joints count from the seed."""
    at = angles()
    arms = []
    for i, arm in enumerate("AB"):
        bodies = [(f"upper_{arm}", arm, BASES[arm], at[f"upper_{arm}"])]
        bodies.append((f"lower_{arm}", f"elbow_{arm}", (LENGTH, 0.0), at[f"lower_{arm}"] - at[f"upper_{arm}"]))
        text = '<site name="tool" pos="0.2 0 0"/>' if i == 0 else ""
        for body, joint, (x, y), turned in reversed(bodies):
            kind = body.split("_")[0]
            thin, thick = MOMENT[kind]
            text = (
                f'<body name="{body}" pos="{x!r} {y!r} 0" quat="{math.cos(turned / 2)!r} 0 0 {math.sin(turned / 2)!r}">'
                f'<joint name="{joint}" axis="0 0 1"/><inertial pos="{LENGTH / 2} 0 0" mass="{MASS[kind]}" '
                f'diaginertia="{thin} {thick} {thick}"/>{text}</body>'
            )
        arms.append(text)
    tree = (
        f'<mujoco model="five_bar"><option gravity="0 0 0"/><worldbody>{"".join(arms)}</worldbody>'
        '<equality><connect name="tips" body1="lower_A" body2="lower_B" anchor="0.2 0 0"/></equality>'
        '<actuator><motor joint="A"/><motor joint="B"/></actuator></mujoco>'
    )
    keys = {"end_effector": {"frame": "tool", "axes": ["x", "y"]}, "plane": PLAIN["plane"], "seed": {}}
    return write(folder, "robot.xml", tree, keys)


def xacro(folder: Path) -> Path:
    text = urdf(Variant()).replace('<robot name="five_bar">', (
        '<robot name="five_bar" xmlns:xacro="http://www.ros.org/wiki/xacro">'
        f'<xacro:property name="upper" value="{MASS["upper"]}"/>'
    )).replace(f'value="{MASS["upper"]}"/><inertia', 'value="${upper}"/><inertia')  # fmt: skip
    keys = sidecar(Variant()) | {"closures": [{"frames": ["tip_1", "tip_2"]}]}
    return write(folder, "robot.urdf.xacro", text, keys)


CONVENTIONS = {f.__name__: f for f in (native, gepetto, urdfplus, onshape, mjcf, constraint, loop_joint, drake, gazebo)}
