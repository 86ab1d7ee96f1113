"""The geoms of a compiled model as <visual>: those that MuJoCo's viewer shows at first, without the scenery."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import mujoco
import pinocchio as pin
from lxml import etree
from mujoco import mjtGeom

from pkmsea.description.conventions.mjcf.compiled import Mesh, pose
from pkmsea.description.xml import Element, origin, text

SHOWN = 2  # highest group that MuJoCo's viewer shows at first

Shape = tuple[pin.SE3, str, dict[str, str]]  # placement in the geom, element of a URDF, its attributes


def add_visuals(links: Sequence[Element], model: mujoco.MjModel, meshes: Mapping[int, Mesh]) -> None:
    """Draw each body's geoms at its link; floors and other geoms of the world itself are no part of a mechanism."""
    for geom in range(model.ngeom):
        body, material = model.geom_bodyid[geom], model.geom_matid[geom]
        color = model.mat_rgba[material] if material >= 0 else model.geom_rgba[geom]
        if body == 0 or model.geom_group[geom] > SHOWN or color[3] == 0:
            continue
        placement = pose(model.geom_pos[geom], model.geom_quat[geom])
        for at, shape, sizes in _shapes(model, geom, meshes):
            visual = etree.SubElement(links[body], "visual")
            origin(visual, placement * at)
            etree.SubElement(etree.SubElement(visual, "geometry"), shape, sizes)
            etree.SubElement(etree.SubElement(visual, "material", name=f"geom{geom}"), "color", rgba=text(color))


def _shapes(model: mujoco.MjModel, geom: int, meshes: Mapping[int, Mesh]) -> Iterator[Shape]:
    """Planes, height fields and ellipsoids have no shape of a URDF."""
    here, size, kind = pose(), model.geom_size[geom], mjtGeom(model.geom_type[geom])
    mesh = meshes.get(int(model.geom_dataid[geom])) if kind == mjtGeom.mjGEOM_MESH else None
    if kind == mjtGeom.mjGEOM_BOX:
        yield here, "box", {"size": text(2 * size)}
    if kind == mjtGeom.mjGEOM_SPHERE:
        yield here, "sphere", {"radius": text(size[:1])}
    if kind in (mjtGeom.mjGEOM_CYLINDER, mjtGeom.mjGEOM_CAPSULE):
        yield here, "cylinder", {"radius": text(size[:1]), "length": text(2 * size[1:2])}
    if kind == mjtGeom.mjGEOM_CAPSULE:
        for side in (-1, 1):
            yield pose([0.0, 0.0, side * size[1]]), "sphere", {"radius": text(size[:1])}
    if mesh:
        yield mesh.placement, "mesh", {"filename": mesh.file, "scale": text(mesh.scale)}
