"""MJCF: MuJoCo compiles the file, and the tree of the compiled model becomes URDF, its equalities sidecar keys."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pkmsea.description.conventions.mjcf.named import named_files
from pkmsea.description.xml import Element
from pkmsea.errors import MechanismError

SUFFIXES: tuple[str, ...] = (".mjcf",)
LABEL = "MJCF"
MARKED = False


def speaks(root: Element, file: Path) -> bool:
    """Whether this is a MuJoCo model, whatever the file's name."""
    return bool(root.tag == "mujoco")


def files(root: Element, file: Path) -> Sequence[Path]:
    """What the model includes, attaches and draws."""
    return list(dict.fromkeys(path for paths in named_files(root, file).values() for path in paths))


def read(root: Element, file: Path) -> tuple[Element, dict[str, Any]]:
    """The tree as URDF, and closures, couplings, locked joints, gravity, drives and a seed as sidecar keys.

    Raises
    ------
    MechanismError : mujoco is not installed or does not compile the file; a file lies outside the folder; the model
        has something that pkmsea does not model: all of it is named.
    """
    try:
        import mujoco  # noqa: F401
    except ImportError:
        raise MechanismError(
            "This is an MJCF file, and mujoco, which compiles it, is not installed.",
            "Install it: pip install 'pkmsea[mjcf]'.",
            file=file,
        ) from None
    from pkmsea.description.conventions.mjcf.compiled import compile_model
    from pkmsea.description.conventions.mjcf.keys import keys
    from pkmsea.description.conventions.mjcf.links import to_urdf
    from pkmsea.description.conventions.mjcf.names import Names
    from pkmsea.description.conventions.mjcf.unmodelled import refuse

    model, meshes = compile_model(file, named_files(root, file))
    refuse(model, file)
    names = Names(model)
    return to_urdf(model, names, meshes), keys(model, names)
