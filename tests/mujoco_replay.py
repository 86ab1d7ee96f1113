"""The replay of a result in MuJoCo: another engine, with soft constraints and small steps of its own."""

from __future__ import annotations

from dataclasses import dataclass
from xml.etree import ElementTree

import mujoco
import numpy as np
import pinocchio as pin

from pkmsea.bridge import frame_id
from pkmsea.verification.dynamics import Robot
from pkmsea.verification.reference import Reference
from pkmsea.verification.replay import feedback_of

STEPS = 10_000  # per period
CYCLES = 2
STIFF = {"solref": "0.0005 1", "solimp": "0.9999 0.9999 0.001 0.5 2"}  # of the closures; 0.5 ms to settle
SMALLEST = 1e-12  # mass [kg] and inertia [kg m^2] of a rotor's body, which MuJoCo asks for; the armature is added to it
COMPILER = {"angle": "radian", "boundmass": "1e-12", "boundinertia": "1e-12", "balanceinertia": "true"}


@dataclass(frozen=True)
class Replay:
    """Energy of the last cycle [J], end effector's largest deviation [m], loops' largest opening [m], and the largest
    torque of the feedback relative to the peak torque."""

    energy: float
    end_effector: float
    closure: float
    feedback: float


def mjcf(robot: Robot) -> str:
    """The mechanism as MJCF: bodies, inertias and joints of the tree, rotors behind tendons, loops as constraints.

    Only for what this replay covers: point and frame closures, linear springs in series, viscous friction.
    """
    root = ElementTree.Element("mujoco")
    _add(root, "compiler", **COMPILER)
    option = {"integrator": "RK4", "tolerance": "1e-14", "gravity": _text(robot.model.gravity.linear)}
    _add(_add(root, "option", **option), "flag", contact="disable")
    world = _add(root, "worldbody")
    bodies = [world]
    for i in range(1, robot.model.njoints):
        bodies.append(_link(robot, i, bodies[robot.model.parents[i]]))
    description = robot.mechanism.description
    for name in {
        description.end_effector.frame,
        *(name for closure in description.closures for name in closure.frames),
    }:
        frame = robot.model.frames[frame_id(robot.model, name)]
        _add(bodies[frame.parentJoint], "site", name=f"site {name}", **_at(frame.placement))
    _rotors(robot, root, world)
    equality = _add(root, "equality")
    for closure in description.closures:
        first, second = (f"site {name}" for name in closure.frames)
        _add(equality, "weld" if closure.type == "frame" else "connect", site1=first, site2=second, **STIFF)
    return ElementTree.tostring(root, encoding="unicode")


def _link(robot: Robot, i: int, parent: ElementTree.Element) -> ElementTree.Element:
    """One joint of the tree and the body behind it; rotors of rigid drives are its armature."""
    model, inertia = robot.model, robot.model.inertias[i]
    body = _add(parent, "body", **_at(model.jointPlacements[i]))
    joint, armature = {"name": f"joint {i - 1}", **_joint(robot, i)}, robot.rotors_on_joints[i - 1, i - 1]
    rigid = np.where(robot.drives.elastic, 0.0, robot.drives.losses[0])
    _add(body, "joint", **joint, armature=_text(armature), damping=_text((robot.on_joints @ rigid)[i - 1]))
    J = inertia.inertia
    full = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
    _add(body, "inertial", pos=_text(inertia.lever), mass=_text(inertia.mass), fullinertia=_text(full))
    return body


def _joint(robot: Robot, i: int) -> dict[str, str]:
    joint = robot.model.joints[i]
    data = joint.createData()
    joint.calc(data, np.zeros(robot.n))
    linear, angular = np.asarray(data.S).reshape(2, 3)
    turning = bool(angular.any())
    return {"type": "hinge" if turning else "slide", "axis": _text(angular if turning else linear)}


def _rotors(robot: Robot, root: ElementTree.Element, world: ElementTree.Element) -> None:
    tendons = _add(root, "tendon")
    for i in np.flatnonzero(robot.drives.elastic):
        body = _add(world, "body")
        numbers = {"armature": _text(robot.drives.inertia[i]), "damping": _text(robot.drives.losses[0][i])}
        _add(body, "joint", name=f"motor {i}", **_joint(robot, robot.at[i] + 1), **numbers)
        _add(body, "inertial", pos="0 0 0", mass=_text(SMALLEST), diaginertia=_text([SMALLEST] * 3))
        spring = _add(tendons, "fixed", stiffness=_text(robot.drives.c[i]), springlength="0")
        _add(spring, "joint", joint=f"motor {i}", coef="1")
        _add(spring, "joint", joint=f"joint {robot.at[i]}", coef="-1")


def replay(robot: Robot, reference: Reference) -> Replay:
    """CYCLES cycles from the stored state under the stored torque and the small feedback.

    The torque of a step is that of its middle; its power is taken with the mean of the speeds at both ends.
    """
    model = mujoco.MjModel.from_xml_string(mjcf(robot))
    model.opt.timestep = step = reference.period / STEPS
    data, motors = mujoco.MjData(model), _start(robot, reference.states[0], model)
    data.qpos, data.qvel = motors.q, motors.v
    kappa, feedback = robot.drives.actuation.numbers("copper_loss"), feedback_of(robot, reference)
    tip, axes = model.site(f"site {robot.mechanism.description.end_effector.frame}").id, robot.axes
    grid = np.arange(CYCLES * STEPS + 1) * step
    ahead, middle = reference.drive(grid), reference.drive(grid + step / 2)[:, : len(motors.dofs)]
    follow = reference.motion.flat_output(grid)[:, : len(axes)]
    power, added, off, closure = np.zeros((4, CYCLES * STEPS))
    for k in range(CYCLES * STEPS):
        v_M = data.qvel[motors.dofs]
        extra = feedback.torque(ahead[k], data.qpos[motors.dofs], v_M)
        tau = middle[k] + extra
        data.qfrc_applied[:] = 0
        np.add.at(data.qfrc_applied, motors.dofs, tau)
        mujoco.mj_step(model, data)
        mujoco.mj_kinematics(model, data)
        power[k] = tau @ (v_M + data.qvel[motors.dofs]) / 2 + kappa @ tau**2
        added[k] = np.abs(extra).max()
        off[k] = np.abs(data.site_xpos[tip][axes] - follow[k + 1]).max()
        closure[k] = np.abs(data.efc_pos[: data.ne]).max(initial=0.0)
    energy = np.maximum(power[-STEPS:], 0).sum() * step
    peak = np.abs(reference.series["tau"]).max()
    return Replay(float(energy), float(off.max()), float(closure.max()), float(added.max() / peak))


@dataclass(frozen=True)
class _Start:
    """MuJoCo's coordinates at the start, and the coordinate of each drive's motor (m)."""

    q: np.ndarray
    v: np.ndarray
    dofs: list[int]


def _start(robot: Robot, x: np.ndarray, model: mujoco.MjModel) -> _Start:
    """Every joint has one coordinate, so that positions and velocities share their indices."""
    q, v, q_M, v_M = robot.split(x)
    elastic = robot.drives.elastic
    names = [f"motor {i}" if elastic[i] else f"joint {robot.at[i]}" for i in range(elastic.size)]
    order = [f"joint {i}" for i in range(robot.n)] + [f"motor {i}" for i in np.flatnonzero(elastic)]
    at = [int(model.joint(name).qposadr[0]) for name in order]
    position, velocity = np.zeros((2, model.nv))
    position[at], velocity[at] = np.concatenate([q, q_M]), np.concatenate([v, v_M])
    return _Start(position, velocity, [int(model.joint(name).qposadr[0]) for name in names])


def _add(parent: ElementTree.Element, tag: str, **attributes: str) -> ElementTree.Element:
    return ElementTree.SubElement(parent, tag, attributes)


def _at(placement: pin.SE3) -> dict[str, str]:
    x, y, z, w = pin.Quaternion(placement.rotation).coeffs()
    return {"pos": _text(placement.translation), "quat": _text([w, x, y, z])}


def _text(numbers: object) -> str:
    return " ".join(repr(float(x)) for x in np.atleast_1d(np.asarray(numbers, float)))
