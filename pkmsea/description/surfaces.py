"""What a mesh file shows, from its content alone: it can name no other file."""

from __future__ import annotations

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from lxml import etree

from pkmsea.description.xml import parse_text
from pkmsea.errors import PkmseaError, one_line

FORMATS = (".stl", ".dae", ".obj")
GREY = "0.7 0.7 0.7 1"
COLORED = ".dae"  # the others have no colours, or have them in another file


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles of one material.

    Attributes
    ----------
    vertices : (points, 3) [m].
    triangles : (triangles, 3), indices of vertices.
    color : red, green, blue, opacity, from 0 to 1; None where the file says none.
    """

    vertices: np.ndarray
    triangles: np.ndarray
    color: tuple[float, ...] | None

    def scaled(self, scale: np.ndarray) -> Surface:
        return Surface(self.vertices * scale, self.triangles, self.color)


def read_surfaces(file: Path) -> list[Surface]:
    """The surfaces of a mesh file, where it says its unit in metres.

    Raises
    ------
    ValueError : it is damaged, or shows nothing.
    """
    kind = file.suffix.lower()
    try:
        content = file.read_bytes()
        if kind == COLORED:
            content = _without_images(content, file)
        scene = trimesh.load_scene(io.BytesIO(content), file_type=kind.removeprefix("."), process=False)
        unit = trimesh.units.unit_conversion(scene.units, "meters") if scene.units else 1.0
        parts = [part for part in scene.dump() if isinstance(part, trimesh.Trimesh) and len(part.faces)]
        found = [_surface(part, unit, kind == COLORED) for part in parts]
    except PkmseaError as error:
        raise ValueError(error.cause) from error
    except Exception as error:  # whatever a damaged file makes of the parsers
        raise ValueError(one_line(f"it is damaged: {error}")) from error
    if not found:
        raise ValueError("it shows nothing")
    if not all(np.isfinite(part.vertices).all() for part in found):
        raise ValueError("it has vertices that are no numbers")
    return found


def _without_images(content: bytes, file: Path) -> bytes:
    """A Collada file whose textures are grey, and which declares no document type."""
    root = parse_text(content, file)
    for element in [*root.iter("{*}texture")]:
        color = etree.Element(element.tag.replace("texture", "color"))
        color.text = GREY
        element.getparent().replace(element, color)
    for element in [*root.iter("{*}library_images", "{*}newparam")]:
        if element.find("{*}float4") is None:  # a colour
            element.getparent().remove(element)
    return etree.tostring(root)


def _surface(part: Any, unit: float, colored: bool) -> Surface:
    color = None
    if colored:
        color = tuple((np.asarray(getattr(part.visual, "material", part.visual).main_color) / 255).tolist())
    return Surface(np.asarray(part.vertices) * unit, np.asarray(part.faces), color)
