"""The sidecar `mechanism.yaml`: what a URDF tree cannot say about a mechanism with closed loops."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from pkmsea.files import Record

Name = Annotated[str, Field(min_length=1, max_length=200)]
Vector3 = tuple[float, float, float]


class Closure(Record):
    """Two frames that coincide: in their origins (`point`), or in origin and orientation (`frame`)."""

    frames: tuple[Name, Name] = Field(description="the two frames (links or joints of the URDF) that coincide")
    type: Literal["point", "frame"] = "point"
    name: str = ""

    @property
    def label(self) -> str:
        return self.name or " = ".join(self.frames)


class Plane(Record):
    """The plane in which a planar mechanism moves; point closures keep their two in-plane rows."""

    normal: Vector3 = Field(description="normal of the plane in the world frame")

    @field_validator("normal")
    @classmethod
    def _not_zero(cls, normal: Vector3) -> Vector3:
        if not any(normal):
            raise ValueError("the normal of the plane is zero")
        return normal


class EndEffector(Record):
    """The task-space point r_E: the origin of a frame, along world axes."""

    frame: Name
    axes: tuple[Literal["x", "y", "z"], ...] = Field(min_length=1, max_length=3)

    @field_validator("axes")
    @classmethod
    def _distinct(cls, axes: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(axes)) < len(axes):
            raise ValueError("an axis stands twice")
        return axes


class Sidecar(Record):
    """Loop closures, drives, minimal coordinates, end effector and assembly mode of one URDF tree.

    The keys `closed_loop`, `type` and `name_mot` of Gepetto's example-parallel-robots are read, too, and become
    `closures` and `actuated`.
    """

    urdf: str | None = Field(None, description="file of the tree; default: the only *.urdf of the folder")
    closures: tuple[Closure, ...] = ()
    plane: Plane | None = None
    gravity: Vector3 = Field((0.0, 0.0, -9.81), description="[m/s^2], world frame")
    actuated: tuple[Name, ...] = Field(min_length=1, description="joint of each drive, in drive order")
    independent: tuple[Name, ...] = Field(min_length=1, description="minimal coordinates q_A,ind")
    end_effector: EndEffector
    seed: dict[Name, float] = Field(
        default_factory=dict, description="joint positions that declare the assembly mode [rad, m]; others are zero"
    )

    @model_validator(mode="before")
    @classmethod
    def _read_gepetto(cls, data: Any) -> Any:
        if not isinstance(data, dict) or "closed_loop" not in data:
            return data
        data = dict(data)
        pairs, types = data.pop("closed_loop"), data.pop("type", [])
        if not isinstance(pairs, list) or not isinstance(types, list) or len(types) not in (0, len(pairs)):
            raise ValueError("closed_loop and type must be lists of equal length")
        kinds = {"3d": "point", "6d": "frame"}
        data["closures"] = [
            {"frames": pair, "type": kinds.get(str(kind).lower(), kind)}
            for pair, kind in zip(pairs, types or ["3d"] * len(pairs), strict=True)
        ]
        if "name_mot" in data:
            data["actuated"] = data.pop("name_mot")
        return data
