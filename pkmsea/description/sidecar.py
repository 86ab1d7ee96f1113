"""The sidecar `mechanism.yaml`: its keys, as its user writes them."""

from __future__ import annotations

from pydantic import Field

from pkmsea.description.parts import Closure, Coupling, EndEffector, Number, Placement, Plane, Vector3
from pkmsea.files import Name, Record

SIDECAR = "mechanism.yaml"


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
