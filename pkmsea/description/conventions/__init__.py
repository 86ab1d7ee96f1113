"""The table of conventions in which people write a mechanism with loops.

A convention is one module, which reads it into the keys of our own mechanism.yaml, and one entry here:

BESIDE    YAML files beside the tree     gepetto        robot.yaml of example-parallel-robots
FORMATS   files of links and joints      mjcf           compiled by MuJoCo
          other than URDF                xacro          expanded first
MARKS     marks in a URDF                urdfplus       <loop> and independent= of a URDF+
                                         constraint     <constraint> as proposed for urdfdom in 2026
                                         loop_joint     <loop_joint> of Isaac Sim and of old Drake
                                         drake          <drake:ball_constraint>
                                         gazebo         <gazebo><joint>
                                         onshape        closing_*_1/_2 frames of onshape-to-robot
                                         mimic          <mimic> joints
                                         transmission   <transmission> elements: which joints have drives

Where two say the same key, the sidecar goes before the tree, and an earlier mark before a later one; loops, frames and
couplings of several marks come together.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Protocol

from pkmsea.description.conventions import (
    constraint,
    drake,
    gazebo,
    gepetto,
    loop_joint,
    mimic,
    mjcf,
    onshape,
    transmission,
    urdfplus,
    xacro,
)
from pkmsea.description.xml import Element


class Beside(Protocol):
    """A convention of YAML files; `read` returns sidecar keys, and leaves those of ours that it finds."""

    NAME: str  # of the file that is looked for
    LABEL: str

    def speaks(self, data: Any) -> bool: ...
    def read(self, data: Any, file: Path) -> dict[str, Any]: ...


class Format(Protocol):
    """A format of files of links and joints; `read` returns the tree as URDF, and sidecar keys, `files` the other files
    that a copy of the tree needs beside it."""

    SUFFIXES: tuple[str, ...]
    LABEL: str
    MARKED: bool  # whether the URDF that it becomes may carry marks

    def speaks(self, root: Element, file: Path) -> bool: ...
    def files(self, root: Element, file: Path) -> Sequence[Path]: ...
    def read(self, root: Element, file: Path) -> tuple[Element, dict[str, Any]]: ...


class Mark(Protocol):
    """What a URDF may say beyond the tree; `read` returns sidecar keys and `notes`, none where the URDF is plain.

    TAGS are the elements of <robot> that it reads; others are refused, see `pkmsea.description.elements`.
    """

    LABEL: str
    TAGS: tuple[str, ...]

    def read(self, root: Element, file: Path) -> dict[str, Any]: ...


BESIDE: tuple[Beside, ...] = (gepetto,)
FORMATS: tuple[Format, ...] = (mjcf, xacro)
MARKS: tuple[Mark, ...] = (urdfplus, constraint, loop_joint, drake, gazebo, onshape, mimic, transmission)
