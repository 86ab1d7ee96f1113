"""Mesh files of a URDF: found inside their package, or left out; never read from elsewhere."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote, urlsplit

from pkmsea.description.xml import Element
from pkmsea.files import is_file

FORMATS = (".stl", ".dae", ".obj")
MAX_BYTES = 100_000_000
PATH = "ROS_PACKAGE_PATH"


def drop_missing(root: Element, folder: Path) -> list[str]:
    """Leave out the visuals whose mesh is not found; returns the names of these meshes."""
    missing = []
    for visual in root.findall("link/visual"):
        for mesh in visual.findall("geometry/mesh"):
            name = mesh.get("filename", "")
            if resolve(name, folder) is None:
                missing.append(name)
                visual.getparent().remove(visual)
                break
    return missing


def resolve_all(root: Element, folder: Path) -> None:
    """Replace mesh names by absolute paths; visuals whose mesh is not found are left out."""
    drop_missing(root, folder)
    for mesh in root.findall("link/visual/geometry/mesh"):
        mesh.set("filename", str(resolve(mesh.get("filename", ""), folder)))


def resolve(name: str, folder: Path) -> Path | None:
    """The file that a mesh name means: `package://NAME/REST`, `file://PATH`, or a path relative to the tree's folder.

    It must lie in that package, or in the tree's folder, links followed.
    """
    for root, rest in _candidates(name, folder):
        path = (root / rest).resolve()
        if (
            path.suffix.lower() in FORMATS
            and path.is_relative_to(root.resolve())
            and is_file(path)
            and path.stat().st_size <= MAX_BYTES
        ):
            return path
    return None


def relative(name: str) -> str:
    """Where a copy of the mesh belongs beside a copy of the tree, so that `resolve` finds it."""
    parts = urlsplit(name)
    if parts.scheme == "package":
        return f"{parts.netloc}/{unquote(parts.path).lstrip('/')}".lstrip("/")
    return unquote(parts.path)


def _candidates(name: str, folder: Path) -> Iterator[tuple[Path, str]]:
    try:
        parts = urlsplit(name)
    except ValueError:
        return
    rest = unquote(parts.path)
    if "\0" in rest:
        return
    if parts.scheme == "package":
        package, rest = parts.netloc, rest.lstrip("/")
        if package not in ("", ".", ".."):
            yield folder, f"{package}/{rest}"
            yield from ((parent, rest) for parent in folder.resolve().parents if parent.name == package)
            yield from ((Path(p) / package, rest) for p in os.environ.get(PATH, "").split(os.pathsep) if p)
        yield folder, rest
    elif parts.scheme in ("", "file"):
        yield folder, rest
