"""Playback of a cycle in Meshcat: live, or as one self-contained HTML page that needs no network."""

from __future__ import annotations

import base64
import html
from pathlib import Path
from typing import Any

import meshcat
import meshcat.animation
import meshcat.geometry
import numpy as np
import pinocchio as pin
import umsgpack

from pkmsea.bridge import frame_id
from pkmsea.files import write_whole
from pkmsea.solution import Solution
from pkmsea.solution.store import mesh_folder
from pkmsea.views.robot import Robot
from pkmsea.views.server import serve

FRAMES_PER_SECOND = 60
SLOW_MOTION = 2.0  # a cycle of a second or less is too quick for the eye
BEADS = 14  # of a drawn spring
SIDE = 0.38  # distance of a sliding rotor from its joint's axis, relative to the reach
ROTOR, SPRING, TRACE = 0x2E86C1, 0xF39C12, 0xD1495B
FOREVER = 1_000_000  # repetitions


class Recorder:
    """Stands in for Meshcat's window: keeps the commands instead of sending them to a server."""

    def __init__(self) -> None:
        self.commands: list[bytes] = []

    def send(self, command: Any) -> None:
        self.commands.append(umsgpack.packb(command.lower()))


def write_page(solution: Solution, path: str | Path) -> Path:
    """Write the playback as one HTML page."""
    path, recorder = Path(path), Recorder()
    draw(solution, meshcat.Visualizer(window=recorder))
    script = (Path(meshcat.__file__).parent / "viewer" / "dist" / "main.min.js").read_text(encoding="utf-8")
    commands = ",\n".join(f'"{base64.b64encode(command).decode()}"' for command in recorder.commands)
    page = _PAGE.format(
        title=html.escape(f"{solution.problem.title}: {solution.label}"), caption=_caption(solution),
        script=script.replace("</script", "<\\/script"), commands=commands,
    )  # fmt: skip
    write_whole(path, lambda temporary: temporary.write_text(page, encoding="utf-8"))
    return path


def play(solution: Solution) -> meshcat.Visualizer:
    """Start Meshcat's server on the loopback address and play the cycle there; returns the visualizer with its URL.

    The server lives as long as this process.
    """
    visualizer = meshcat.Visualizer(zmq_url=serve())
    draw(solution, visualizer)
    return visualizer


def draw(solution: Solution, visualizer: meshcat.Visualizer) -> None:
    """Robot, rotors, springs and the end effector's path, with the cycle as an endless animation.

    A rotor is a blue disc whose pointer turns with q_M; the orange spring runs from there to the joint, so that
    winding up shows as an angle between pointer and link.
    """
    mechanism = solution.problem.actuation.mechanism
    s = solution.series
    period = solution.problem.cycle.period
    count = max(60, round(period * SLOW_MOTION * FRAMES_PER_SECOND))
    frames = np.linspace(0, s.t.size, count + 1).astype(int) % s.t.size
    scene = visualizer["scene"]
    with mesh_folder(solution) as folder:
        robot = Robot(mechanism, folder)
        robot.initViewer(viewer=scene)
        robot.loadViewerModel(rootNodeName="robot")
    _furnish(solution, visualizer, scene)
    animation = meshcat.animation.Animation(default_framerate=FRAMES_PER_SECOND)
    data = mechanism.model.createData()
    _pose(solution, robot, data, scene, s.q[0], s.q_M[0])
    for frame, k in enumerate(frames):
        at = meshcat.animation.AnimationFrameVisualizer(animation, scene.path, frame)
        _pose(solution, robot, data, at, s.q[k], s.q_M[k])
    visualizer.set_animation(animation, play=True, repetitions=FOREVER)


def _pose(solution: Solution, robot: Any, data: Any, at: Any, q: np.ndarray, q_M: np.ndarray) -> None:
    """Put robot, rotors and springs of one instant into a visualizer or an animation frame."""
    actuation = solution.problem.actuation
    mechanism = actuation.mechanism
    pin.forwardKinematics(mechanism.model, data, q)
    pin.updateGeometryPlacements(mechanism.model, data, robot.visual_model, robot.visual_data)
    for i, shape in enumerate(robot.visual_model.geometryObjects):
        node = robot.getViewerNodeName(shape, pin.GeometryType.VISUAL)
        scale = np.diag([*np.asarray(shape.meshScale).flatten(), 1.0])
        at[node].set_transform(robot.visual_data.oMg[i].homogeneous @ scale)
    for i in solution.motion.springs:
        joint, angle = mechanism.actuated[i], q[mechanism.actuated[i]]
        placement, axis = _joint_frame(mechanism, data, joint, angle)
        reach = _reach(mechanism)
        lift = pin.SE3(np.eye(3), -axis * reach * (0.16 + 0.07 * i))
        if mechanism.revolute[joint]:
            turned = placement * lift * pin.SE3(pin.AngleAxis(q_M[i], axis).matrix(), np.zeros(3))
            at[f"rotor/{i}"].set_transform((turned * _along(axis)).homogeneous)
        else:
            side = pin.SE3(np.eye(3), _across(axis) * reach * SIDE * (1 if i % 2 else -1) + axis * q_M[i])
            at[f"rotor/{i}"].set_transform((placement * side * _along(axis)).homogeneous)
        for bead in range(BEADS):
            share = (bead + 0.5) / BEADS
            between = angle + (q_M[i] - angle) * share
            if mechanism.revolute[joint]:
                turn = pin.AngleAxis(between + 4 * np.pi * share, axis).matrix()
                local = lift.translation * share + turn @ _across(axis) * reach * (0.16 - 0.09 * share)
            else:
                wave = 0.02 * np.sin(6 * np.pi * share) * np.cross(axis, _across(axis))
                local = (
                    axis * between
                    + _across(axis) * reach * SIDE * (1 if i % 2 else -1) * (1 + share) / 2
                    + wave * reach
                )
            at[f"spring/{i}/{bead}"].set_transform(pin.SE3(np.eye(3), placement.act(local)).homogeneous)


def _joint_frame(mechanism: Any, data: Any, joint: int, angle: float) -> tuple[pin.SE3, np.ndarray]:
    """The joint's frame at angle zero in the world, and its axis there."""
    model = mechanism.model
    parent = data.oMi[model.parents[joint + 1]]
    jdata = model.joints[joint + 1].createData()
    model.joints[joint + 1].calc(jdata, np.zeros(model.nq))
    subspace = np.asarray(jdata.S).reshape(6)
    axis = subspace[3:] if subspace[3:].any() else subspace[:3]
    return parent * model.jointPlacements[joint + 1], axis / np.linalg.norm(axis)


def _across(axis: np.ndarray) -> np.ndarray:
    """A unit vector at right angles to an axis: x for the z axis, y for the x axis."""
    candidate = np.eye(3)[0 if abs(axis[0]) < 0.9 else 1]
    across = candidate - axis * (candidate @ axis)
    return np.asarray(across / np.linalg.norm(across))


def _along(axis: np.ndarray) -> pin.SE3:
    """Rotation that takes a body drawn along z, pointing to x, to an axis."""
    x = _across(axis)
    return pin.SE3(np.column_stack([x, np.cross(axis, x), axis]), np.zeros(3))


def _reach(mechanism: Any) -> float:
    """Size of rotors and springs: the longest placement of the tree, a third of a metre at most [m]."""
    longest = max(float(np.linalg.norm(p.translation)) for p in mechanism.model.jointPlacements)
    return min(max(longest, 0.05) if longest else 0.3, 0.33)


def _furnish(solution: Solution, visualizer: Any, scene: Any) -> None:
    """Rotors, springs, path, background and camera; the scene is shifted so that the camera's target is its middle."""
    actuation = solution.problem.actuation
    mechanism, reach = actuation.mechanism, _reach(actuation.mechanism)
    blue, orange = (meshcat.geometry.MeshLambertMaterial(color=color) for color in (ROTOR, SPRING))
    for i in solution.motion.springs:
        node = scene[f"rotor/{i}"]
        if mechanism.revolute[mechanism.actuated[i]]:
            to_z = np.array(
                [[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]]
            )  # Meshcat's cylinder is along y
            node["disc"].set_object(meshcat.geometry.Cylinder(0.05 * reach, 0.11 * reach), blue)
            node["disc"].set_transform(to_z)
            node["pointer"].set_object(meshcat.geometry.Box([0.3 * reach, 0.035 * reach, 0.05 * reach]), blue)
            node["pointer"].set_transform(_shift(0.15 * reach, 0, 0))
        else:
            node["body"].set_object(meshcat.geometry.Box([0.12 * reach, 0.12 * reach, 0.2 * reach]), blue)
        for bead in range(BEADS):
            scene[f"spring/{i}/{bead}"].set_object(meshcat.geometry.Sphere(0.018 * reach), orange)
    path = _world_path(solution)
    line = meshcat.geometry.Line(
        meshcat.geometry.PointsGeometry(path.T.astype(np.float32)), meshcat.geometry.LineBasicMaterial(color=TRACE)
    )
    scene["path"].set_object(line)
    visualizer["/Background"].set_property("top_color", [1.0, 1.0, 1.0])
    visualizer["/Background"].set_property("bottom_color", [0.88, 0.9, 0.93])
    visualizer["/Grid"].set_property("visible", False)
    visualizer["/Axes"].set_property("visible", False)
    scene.set_transform(_shift(*-(path.min(axis=0) + path.max(axis=0)) / 2))
    eye = _view_direction(mechanism) * (0.7 * float(np.ptp(path, axis=0).max()) + 1.8 * reach)
    # Meshcat's camera frame has y upwards
    visualizer["/Cameras/default/rotated/<object>"].set_property("position", [eye[0], eye[2], -eye[1]])


def _view_direction(mechanism: Any) -> np.ndarray:
    """From the scene to the camera: towards the plane's normal, from above or from the front."""
    normal = np.array(mechanism.description.plane.normal if mechanism.description.plane else (0.0, 0.0, 1.0))
    normal = normal / np.linalg.norm(normal)
    if abs(normal[2]) > 0.7:
        return np.array([0.0, -0.55, 1.0])
    return np.asarray(normal * (-1.0 if normal[1] > 0 else 1.0) + np.array([0.0, 0.0, 0.3]))


def _world_path(solution: Solution) -> np.ndarray:
    """Path of the end effector in the world (points, 3)."""
    mechanism, s = solution.problem.actuation.mechanism, solution.series
    frame = frame_id(mechanism.model, mechanism.description.end_effector.frame)
    data = mechanism.model.createData()
    points = []
    for q in s.q[:: max(1, s.t.size // 400)]:
        pin.framesForwardKinematics(mechanism.model, data, q)
        points.append(data.oMf[frame].translation.copy())
    return np.array([*points, points[0]])


def _shift(x: float, y: float, z: float) -> np.ndarray:
    result = np.eye(4)
    result[:3, 3] = x, y, z
    return result


def _caption(solution: Solution) -> str:
    actuation = solution.problem.actuation
    units = ["N m/rad" if actuation.mechanism.revolute[i] else "N/m" for i in actuation.mechanism.actuated]
    springs = ", ".join(f"{actuation.labels[i]} {c:.4g} {units[i]}" for i, c in solution.motion.springs.items())
    energy = solution.cost.show(solution.value)
    lines = [
        f"<b>{html.escape(solution.label)}</b>",
        f"{energy} per cycle of {solution.problem.cycle.period:g} s, {html.escape(solution.status)}",
        f"springs: {html.escape(springs)}" if springs else "rigid drives",
        f"played {SLOW_MOTION:g} times slower; blue: rotors, orange: springs",
    ]
    return "<br>".join(lines)


_PAGE = """<!DOCTYPE html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ margin: 0; }}
#meshcat-pane {{ width: 100vw; height: 100vh; overflow: hidden; }}
#caption {{ position: fixed; left: 16px; top: 12px; font: 14px/1.5 system-ui, sans-serif; color: #222;
  background: rgba(255, 255, 255, 0.85); padding: 8px 12px; border-radius: 6px; }}
</style>
</head>
<body>
<div id="meshcat-pane"></div>
<div id="caption">{caption}</div>
<script>{script}</script>
<script>
const viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
const commands = [{commands}];
for (const command of commands) {{
  viewer.handle_command_bytearray(Uint8Array.from(atob(command), c => c.charCodeAt(0)));
}}
</script>
</body>
</html>
"""
