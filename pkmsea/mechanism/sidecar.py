"""The sidecar `mechanism.yaml`: what a URDF tree cannot say about a mechanism with closed loops."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from pkmsea.files import Name, Printable, Record
from pkmsea.mechanism.xml import LARGEST

Number = Annotated[float, Field(ge=-LARGEST, le=LARGEST)]
Vector3 = tuple[Number, Number, Number]


def _not_zero(vector: Vector3) -> Vector3:
    if not any(vector):
        raise ValueError("this direction is zero")
    return vector


class Placement(Record):
    """A frame that the tree lacks, fixed to one of its links."""

    link: Name = Field(description="link (or joint) of the tree that carries the frame")
    xyz: Vector3 = Field((0.0, 0.0, 0.0), description="position in that link [m]")
    rpy: Vector3 = Field((0.0, 0.0, 0.0), description="roll, pitch, yaw in that link [rad], as in a URDF")


class Closure(Record):
    """Two frames that coincide: in their origins (`point`), in origin and `axis` (`revolute`), or fully (`frame`)."""

    frames: tuple[Name, Name] = Field(description="the two frames (links or joints of the tree) that coincide")
    type: Literal["point", "revolute", "frame"] = "point"
    axis: Vector3 = Field((0.0, 0.0, 1.0), description="common axis of a `revolute` closure, in both frames")
    name: Printable = ""

    _axis = field_validator("axis")(_not_zero)

    @property
    def label(self) -> str:
        return self.name or " = ".join(self.frames)


class Coupling(Record):
    """Two joints that move together: q_joint = ratio q_of + offset; a gear, or a mimic joint."""

    joint: Name
    of: Name
    ratio: Number = 1.0
    offset: Number = Field(0.0, description="[rad, m]")

    @model_validator(mode="after")
    def _two_joints(self) -> Coupling:
        if self.joint == self.of:
            raise ValueError(f"the joint '{self.joint}' is coupled to itself")
        return self

    @property
    def label(self) -> str:
        return f"{self.joint} = {self.ratio:g} {self.of}" + (f" {self.offset:+g}" if self.offset else "")


class Plane(Record):
    """The plane in which a planar mechanism moves; point closures keep their two in-plane rows."""

    normal: Vector3 = Field(description="normal of the plane in the world frame")

    _normal = field_validator("normal")(_not_zero)


class EndEffector(Record):
    """The task coordinates r_E: the origin of a frame along world axes, or `joints` where that does not fix the motion.

    The frame is also where a payload hangs and what the views trace.
    """

    frame: Name
    axes: tuple[Literal["x", "y", "z"], ...] = Field((), max_length=3)
    joints: tuple[Name, ...] = ()

    @model_validator(mode="after")
    def _one_kind(self) -> EndEffector:
        if bool(self.axes) == bool(self.joints):
            raise ValueError("give either axes or joints, as many as the mechanism has mobility")
        if len(set(self.coordinates)) < len(self.coordinates):
            raise ValueError("an axis or joint stands twice")
        return self

    @property
    def coordinates(self) -> tuple[str, ...]:
        """Names of the axes, or of the joints."""
        return self.axes or self.joints


class Draft(Record):
    """What the files of one mechanism say, in whatever convention; keys that nobody has said yet are None."""

    urdf: str | None = Field(
        None, description="file of the tree, or 'example-robot-data/FILE'; default: the only one of the folder"
    )
    frames: dict[Name, Placement] = Field(default_factory=dict, description="frames that the tree lacks, by name")
    closures: tuple[Closure, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    locked: dict[Name, Number] = Field(default_factory=dict, description="joints held at a position [rad, m]")
    plane: Plane | None = None
    gravity: Vector3 = Field((0.0, 0.0, -9.81), description="[m/s^2], world frame")
    actuated: tuple[Name, ...] | None = Field(None, min_length=1, description="joint of each drive, in drive order")
    independent: tuple[Name, ...] | None = Field(
        None, min_length=1, description="minimal coordinates q_A,ind; default: the best conditioned joints"
    )
    end_effector: EndEffector | None = None
    seed: dict[Name, Number] | None = Field(
        None, description="joint positions that declare the assembly mode [rad, m]; others are zero"
    )


class Sidecar(Draft):
    """Loop closures, drives, minimal coordinates, end effector and assembly mode of one tree: a complete draft."""

    actuated: tuple[Name, ...] = Field(min_length=1, description="joint of each drive, in drive order")
    independent: tuple[Name, ...] = Field(min_length=1, description="minimal coordinates q_A,ind")
    end_effector: EndEffector
    seed: dict[Name, Number] = Field(description="joint positions that declare the assembly mode [rad, m]")
