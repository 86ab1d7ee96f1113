"""The description of a mechanism: all that its Functions follow from, as plain data."""

from __future__ import annotations

import hashlib
from pathlib import Path
from typing import Any, Self

from pydantic import Field, model_validator

from pkmsea.description import tree, xml
from pkmsea.description.limits import JointLimits, joint_limits
from pkmsea.description.parts import Closure, Coupling, EndEffector, Frame, Number, Plane, Vector3
from pkmsea.files import Name, Record

Positions = tuple[tuple[Name, Number], ...]  # of joints, by name [rad, m]

WIDEST = 180  # characters of a repr
NOT_MOTION = {"name", "notes", "origin"}  # fields that change no Function


class Origin(Record):
    """Where a description comes from.

    Attributes
    ----------
    folder : where the mechanism lies.
    tree, sidecar : the file of links and joints; the YAML file beside it, None where there is none.
    meshes : the folder from which mesh names of the tree count, from the root of the file system.
    urdf : the tree as a sidecar names it.
    conventions : labels of those that were met.
    in_sidecar, in_tree : the keys that each file says; what a sidecar says goes before what the tree says.
    proposed : the keys that no file says, and that were guessed or found once the loops were closed.
    seed : what a task says in place of the files; None where it says nothing.
    """

    folder: Path
    tree: Path
    sidecar: Path | None = None
    meshes: Path
    urdf: str
    conventions: tuple[str, ...] = ()
    in_sidecar: tuple[str, ...] = ()
    in_tree: tuple[str, ...] = ()
    proposed: tuple[str, ...] = ()
    seed: Positions | None = None

    def file(self, key: str) -> Path:
        """The file to blame for a key: the one that says it, else the one in which it is missing."""
        return self.tree if key in self.in_tree or self.sidecar is None else self.sidecar


class Description(Record):
    """A tree of links and joints with the loops, drives and end effector that it cannot state itself.

    Equal where all fields are, origin included; `digest` compares the motion alone. To and from JSON by
    `model_dump_json` and `model_validate_json`. Keys that no file says are None; `pkmsea.mechanism` completes them once
    the loops are closed.

    Attributes
    ----------
    tree : the cleaned URDF; locked joints are fixed in it, meshes keep the names that the file gives them.
    frames : what the tree lacks.
    closures, couplings, plane : what closes the loops, see `pkmsea.mechanism.closures`.
    locked : joints held at a position [rad, m].
    gravity : in the world frame [m/s^2].
    actuated : joint of each drive, in drive order (m).
    independent : joints of the minimal coordinates q_A,ind (delta).
    end_effector : what r_E follows.
    seed : joint positions that declare the assembly mode [rad, m]; others are zero.
    notes : what was changed or left out in cleaning.

    Raises
    ------
    MechanismError : the tree is none that pkmsea can model; names link or joint.
    """

    name: str
    tree: str = Field(max_length=xml.MAX_BYTES)
    frames: tuple[Frame, ...] = ()
    closures: tuple[Closure, ...] = ()
    couplings: tuple[Coupling, ...] = ()
    locked: Positions = ()
    plane: Plane | None = None
    gravity: Vector3 = (0.0, 0.0, -9.81)
    actuated: tuple[Name, ...] | None = Field(None, min_length=1)
    independent: tuple[Name, ...] | None = Field(None, min_length=1)
    end_effector: EndEffector | None = None
    seed: Positions | None = None
    notes: tuple[str, ...] = ()
    origin: Origin

    @model_validator(mode="after")
    def _is_a_tree(self) -> Self:
        tree.check(xml.parse_text(self.tree.encode(), self.origin.tree), self.origin.tree)
        return self

    @property
    def limits(self) -> dict[str, JointLimits]:
        """What the tree says of each moving joint's limits, by its name."""
        joints = xml.parse_text(self.tree.encode(), self.origin.tree).findall("joint")
        moving = (joint for joint in joints if joint.get("type") != "fixed")
        return {joint.get("name", ""): joint_limits(joint, self.origin.tree) for joint in moving}

    @property
    def digest(self) -> str:
        """Of all that the Functions follow from; the same wherever the files lie."""
        return hashlib.sha256(self.model_dump_json(exclude=NOT_MOTION).encode()).hexdigest()[:16]

    def fits(self, other: Description) -> bool:
        """Whether all that another one says of the motion is said here, too; this one may say more."""
        said = {key: value for key, value in other if key not in NOT_MOTION and value is not None}
        return all(getattr(self, key) == value for key, value in said.items())

    def seeded(self, seed: Positions | None) -> Description:
        """The same in the assembly mode that a task names; as it is where it names none."""
        if seed is None:
            return self
        return self.model_copy(update={"seed": seed, "origin": self.origin.model_copy(update={"seed": seed})})

    def where(self, key: str, place: str | None = None, value: Any = None) -> dict[str, Any]:
        """File, key and value of an error, no file where a task says it; `place` says where below `key` it is."""
        of_task = key == "seed" and self.origin.seed is not None
        return {"file": None if of_task else self.origin.file(key), "key": place or key, "value": value}

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Description) and dict(self) == dict(other)

    def __hash__(self) -> int:
        return hash((self.tree, self.closures, self.actuated, self.seed))

    def __repr__(self) -> str:
        drives = " ".join(self.actuated or ["open"])
        tip = f"{self.end_effector.frame} ({' '.join(self.end_effector.coordinates)})" if self.end_effector else "open"
        closures = f"{len(self.closures)} closure" + "s" * (len(self.closures) != 1)
        text = f"{self.name!r}, {closures}, drives {drives}, end effector {tip}"
        return f"Description({text if len(text) <= WIDEST else text[: WIDEST - 3] + '...'})"

    __str__ = __repr__


class CompleteDescription(Description):
    """A description that leaves nothing open: that of a `Mechanism`."""

    actuated: tuple[Name, ...] = Field(min_length=1)
    independent: tuple[Name, ...] = Field(min_length=1)
    end_effector: EndEffector
    seed: Positions
