"""Mesh files: drawn triangle by triangle where they are whole, else a note and a stick; they read no other file."""

from __future__ import annotations

from pathlib import Path

import five_bar
import meshcat
import numpy as np
import pytest
import trimesh
import umsgpack

from pkmsea.description import meshes
from pkmsea.description.surfaces import read_surfaces
from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.views.playback import Recorder
from pkmsea.views.robot import Robot

BOX = trimesh.creation.box((0.1, 0.2, 0.3))
TRIANGLE = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="{unit}"/><up_axis>Z_UP</up_axis></asset>
<library_images><image id="i"><init_from>{image}</init_from></image></library_images>
<library_effects><effect id="e"><profile_COMMON>
<newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
<newparam sid="t"><sampler2D><source>s</source></sampler2D></newparam>
<technique sid="c"><lambert><diffuse><texture texture="t" texcoord="u"/></diffuse></lambert></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="9">0 0 0 1 0 0 0 1 0</float_array><technique_common>
<accessor source="#pa" count="3" stride="3"><param name="X" type="float"/><param name="Y" type="float"/>
<param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="1" material="k"><input semantic="VERTEX" source="#v" offset="0"/><p>0 1 2</p></triangles>
</mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node id="n"><instance_geometry url="#g"><bind_material><technique_common>
<instance_material symbol="k" target="#m"/></technique_common></bind_material></instance_geometry></node></visual_scene>
</library_visual_scenes><scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
STL = BOX.export(file_type="stl")
BROKEN: dict[str, tuple[str, bytes]] = {
    "no STL": ("stl", bytes(range(256)) * 2),
    "an empty STL": ("stl", b""),
    "a cut STL": ("stl", STL[: len(STL) // 2]),
    "an STL of no numbers": ("stl", STL[:84] + np.full(12, np.nan, "<f4").tobytes() + STL[132:]),
    "an empty OBJ": ("obj", b"\n"),
    "an OBJ of points": ("obj", b"v 0 0 0\nv 1 0 0\n"),
    "an OBJ without its points": ("obj", b"f 1 2 3\n"),
    "no Collada": ("dae", b"garbage"),
    "a Collada without a scene": ("dae", TRIANGLE.partition("<library_vis")[0].encode() + b"</COLLADA>"),
    "a Collada of entities": ("dae", b'<!DOCTYPE C [<!ENTITY e SYSTEM "file:///etc/passwd">]>' + TRIANGLE.encode()),
}


def with_mesh(folder: Path, name: str, content: bytes, attributes: str = "") -> Mechanism:
    """The five-bar, its upper arm A drawn by a mesh."""
    robot = five_bar.native(folder)
    (robot / name).write_bytes(content)
    visual = f'<visual><geometry><mesh filename="{name}" {attributes}/></geometry></visual>'
    file = robot / "robot.urdf"
    file.write_text(file.read_text().replace('<link name="upper_A">', f'<link name="upper_A">{visual}'))
    return load_mechanism(robot)


def drawn(mechanism: Mechanism) -> dict[str, dict]:
    """What is sent to Meshcat: geometries by their path below the robot's visuals."""
    recorder = Recorder()
    robot = Robot(mechanism, mechanism.description.origin.meshes)
    robot.initViewer(viewer=meshcat.Visualizer(window=recorder)["scene"])
    robot.loadViewerModel(rootNodeName="robot")
    commands = [umsgpack.unpackb(command) for command in recorder.commands]
    return {
        command["path"].partition("/visuals/")[2]: command["object"]["geometries"][0]
        for command in commands
        if command["type"] == "set_object"
    }


@pytest.mark.parametrize("kind", sorted(BROKEN))
def test_a_broken_mesh_is_noted_and_drawn_as_a_stick(tmp_path: Path, kind: str) -> None:
    suffix, content = BROKEN[kind]
    mechanism = with_mesh(tmp_path / "robot", f"arm.{suffix}", content)
    (note,) = mechanism.description.notes
    assert note.startswith(f"mesh 'arm.{suffix}' is not drawn: ")
    assert drawn(mechanism)["upper_A_0"]["type"] == "CylinderGeometry"


@pytest.mark.parametrize("scale", ["1 2", "1 1 nan", "a b c"])
def test_a_scale_that_is_none_is_noted(tmp_path: Path, scale: str) -> None:
    mechanism = with_mesh(tmp_path / "robot", "arm.stl", STL, f'scale="{scale}"')
    assert f"its scale is '{scale}'" in mechanism.description.notes[0]


@pytest.mark.parametrize("suffix", ["stl", "obj", "dae"])
def test_meshes_are_drawn_as_they_are(tmp_path: Path, suffix: str) -> None:
    """All triangles, scaled; where the mesh has gone since, the link is a stick."""
    mechanism = with_mesh(tmp_path / "robot", f"arm.{suffix}", _bytes(BOX.export(file_type=suffix)), 'scale="1 2 3"')
    assert not mechanism.description.notes
    geometry = drawn(mechanism)["upper_A_0/0"]["data"]
    points = np.frombuffer(geometry["attributes"]["position"]["array"].data, np.float32).reshape(-1, 3)
    assert len(geometry["index"]["array"].data) == len(BOX.faces) * 3 * 4
    np.testing.assert_allclose(np.ptp(points, axis=0), [0.1, 0.4, 0.9], rtol=1e-6)
    (tmp_path / "robot" / f"arm.{suffix}").unlink()
    assert drawn(mechanism)["upper_A_0"]["type"] == "CylinderGeometry"


def _bytes(content: str | bytes) -> bytes:
    return content.encode() if isinstance(content, str) else content


@pytest.mark.parametrize("image", ["../secret.png", "/etc/passwd", "file:///etc/passwd", "http://host/a.png", ""])
def test_a_collada_file_reads_no_other_file(tmp_path: Path, image: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its image is a surface in grey; its unit is read."""
    (tmp_path / "secret.png").write_text("secret")
    (tmp_path / "a.dae").write_text(TRIANGLE.format(unit="0.001", image=image))
    opened: list[str] = []
    monkeypatch.setattr(Path, "read_bytes", lambda path: opened.append(path.name) or path.open("rb").read())
    (surface,) = read_surfaces(tmp_path / "a.dae")
    assert opened == ["a.dae"]
    assert np.ptp(surface.vertices, axis=0) == pytest.approx([1e-3, 1e-3, 0])
    assert surface.color == pytest.approx((0.7, 0.7, 0.7, 1.0), abs=1 / 255)


def test_meshes_are_looked_up_in_their_package(tmp_path: Path) -> None:
    mechanism = with_mesh(tmp_path / "robot", "arm.stl", STL)
    tree = mechanism.description.tree.replace('"arm.stl"', '"package://robot/arm.stl"')
    root = meshes.xml.parse_text(tree.encode(), Path())
    assert [len(surfaces) for surfaces in meshes.shown(root, tmp_path / "robot")[0].values()] == [1]
