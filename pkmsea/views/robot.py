"""The robot in Meshcat: the shapes of its tree, the triangles of its mesh files, sticks for links without either."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import meshcat.geometry
import pinocchio as pin
from lxml import etree
from pinocchio.visualize import MeshcatVisualizer

from pkmsea.description import meshes
from pkmsea.description.xml import parse_text
from pkmsea.mechanism import Mechanism
from pkmsea.views import sticks


class Robot(MeshcatVisualizer):
    """Pinocchio's visualizer with meshes as plain triangles, one buffer per material; it reads no file itself."""

    def __init__(self, mechanism: Mechanism, folder: Path) -> None:
        """The mesh files lie in `folder`."""
        description = mechanism.description
        root = parse_text(description.tree.encode(), description.origin.tree)
        shown, _ = meshes.shown(root, folder)
        sticks.add(root, mechanism.model)
        self._surfaces = {}
        for link in root.findall("link"):
            for i, visual in enumerate(link.findall("visual")):
                if visual in shown:
                    own = visual.find("material") is not None
                    self._surfaces[f"{link.get('name')}_{i}"] = shown[visual], own  # as Pinocchio names them
                    visual.find("geometry")[:] = [etree.Element("sphere", radius="1")]
        text = etree.tostring(root, encoding="unicode")
        shapes = pin.buildGeomFromUrdfString(mechanism.model, text, pin.VISUAL)
        super().__init__(mechanism.model, pin.GeometryModel(), shapes)

    def loadViewerGeometryObject(self, geometry_object: Any, geometry_type: Any, color: Any = None) -> None:
        """Draw one shape; its URDF material goes before the mesh file's colours."""
        if geometry_object.name not in self._surfaces:
            super().loadViewerGeometryObject(geometry_object, geometry_type, color)
            return
        node = self.viewer[self.getViewerNodeName(geometry_object, geometry_type)]
        surfaces, own = self._surfaces[geometry_object.name]
        for i, surface in enumerate(surfaces):
            *rgb, opacity = geometry_object.meshColor if own or surface.color is None else surface.color
            red, green, blue = (round(255 * x) for x in rgb)
            material = meshcat.geometry.MeshPhongMaterial(
                color=red << 16 | green << 8 | blue, opacity=float(opacity), flatShading=True
            )
            triangles = meshcat.geometry.TriangularMeshGeometry(surface.vertices, surface.triangles)
            node[str(i)].set_object(triangles, material)
