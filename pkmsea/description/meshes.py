"""Mesh files of a URDF: found inside their package, or left out; never read from elsewhere."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from urllib.parse import unquote, urlsplit

import numpy as np

from pkmsea.description import xml
from pkmsea.description.description import Description
from pkmsea.description.surfaces import FORMATS, Surface, read_surfaces
from pkmsea.description.xml import Element
from pkmsea.files import is_file

MAX_BYTES = 100_000_000
PATH = "ROS_PACKAGE_PATH"


def shown(root: Element, folder: Path) -> tuple[dict[Element, list[Surface]], list[str]]:
    """What the visuals of a tree that have a mesh show [m]; those whose mesh is not found or shows nothing are left
    out, and noted."""
    found: dict[Element, list[Surface]] = {}
    missing, notes = dict[str, None](), dict[str, None]()
    for visual in root.findall("link/visual"):
        mesh = visual.find("geometry/mesh")
        if mesh is None:
            continue
        name = mesh.get("filename", "")
        if (path := resolve(name, folder)) is None:
            missing[name] = None
        else:
            try:
                found[visual] = [surface.scaled(_scale(mesh)) for surface in read_surfaces(path)]
            except ValueError as error:
                notes[f"mesh '{name}' is not drawn: {error}"] = None
        if visual not in found:
            visual.getparent().remove(visual)
    if missing:
        names = ", ".join(sorted(missing)[:3])
        notes[f"{len(missing)} mesh file(s) are not beside the tree and are not drawn: {names}"] = None
    return found, list(notes)


def _scale(mesh: Element) -> np.ndarray:
    text = mesh.get("scale", "1 1 1")
    try:
        scale = np.array([float(word) for word in text.split()])
    except ValueError:
        scale = np.array([np.nan])
    if scale.shape != (3,) or not np.isfinite(scale).all():
        raise ValueError(f"its scale is '{text}'")
    return scale


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


def beside(name: str, folder: Path) -> Path | None:
    """Where a copy of the mesh belongs beside a copy of the tree, so that `resolve` finds it; None if outside."""
    parts = urlsplit(name)
    rest = unquote(parts.path)
    path = folder / (f"{parts.netloc}/{rest.lstrip('/')}".lstrip("/") if parts.scheme == "package" else rest)
    return path if path.resolve().is_relative_to(folder.resolve()) else None


def contents(description: Description) -> dict[str, bytes]:
    """The mesh files that a description's visuals show, by the names that its tree gives them."""
    root, folder = xml.parse_text(description.tree.encode(), description.origin.tree), description.origin.meshes
    names = dict.fromkeys(mesh.get("filename", "") for mesh in root.findall("link/visual/geometry/mesh"))
    files = {name: resolve(name, folder) for name in names}
    return {name: file.read_bytes() for name, file in files.items() if file is not None}


def unpack(files: Mapping[str, bytes], folder: Path) -> None:
    """Write what `contents` gave so that `resolve` finds it in a folder."""
    for name, content in files.items():
        path = beside(name, folder)
        if path is not None and path.suffix.lower() in FORMATS:
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content)


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
