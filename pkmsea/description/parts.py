"""The parts of a description: frames, closures, couplings, plane and end effector, as small frozen records."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from pkmsea.description.xml import LARGEST
from pkmsea.files import Name, Printable, Record

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


class Frame(Placement):
    """Such a frame with its name."""

    name: Name


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
