"""xacro files, by way of xacrodoc where it is installed; it needs no ROS."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pkmsea.description import xml
from pkmsea.description.xml import Element
from pkmsea.errors import MechanismError

SUFFIXES: tuple[str, ...] = (".xacro",)
LABEL = "xacro"
MARKED = True


def speaks(root: Element, file: Path) -> bool:
    """Whether the file's name says so, or elements are left that xacro has to expand."""
    return file.suffix in SUFFIXES or any(
        isinstance(e.tag, str) and e.tag.startswith("{") and "xacro" in e.tag for e in root.iter()
    )


def files(root: Element, file: Path) -> Sequence[Path]:
    """None: a copy is expanded."""
    return ()


def read(root: Element, file: Path) -> tuple[Element, dict[str, Any]]:
    """The URDF that a xacro file stands for. A xacro file may run expressions and include files: trust its source.

    Raises
    ------
    MechanismError : xacrodoc is not installed, or the file does not expand.
    """
    try:
        from xacrodoc import XacroDoc
    except ImportError:
        raise MechanismError(
            "This is a xacro file, and xacrodoc is not installed.",
            "Run 'pip install xacrodoc', or give the expanded URDF.",
            file=file,
        ) from None
    try:
        text = XacroDoc.from_file(str(file), resolve_packages=False).to_urdf_string()
    except Exception as error:
        raise MechanismError(f"The xacro file does not expand ({error}).", "Mend it.", file=file) from error
    return xml.parse_text(text.encode(), file), {}
