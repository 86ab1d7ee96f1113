"""Planes: a declared one is put right where its numbers were rounded; an undeclared one is found where a loop needs it.

A loop is planar where its joints turn about one direction, the normal, or slide at right angles to it.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import pinocchio as pin
from lxml import etree

from pkmsea.bridge import frame_id, joint_axis
from pkmsea.description import Closure, Description, Plane, xml
from pkmsea.errors import MechanismError

LIMIT = 1e-3  # [rad] off the plane, which rounded numbers explain
EXACT = 1e-9  # [rad] off the plane, which moves nothing by more than a nanometre per metre
CLOSED = 1e-9  # [m] across the plane

Axis = tuple[np.ndarray, bool]  # unit vector in the world at the neutral pose, whether the joint turns about it


def put_right(description: Description, model: pin.Model) -> Description:
    """The description with its declared plane made exact: the normal along most of the joints' axes, then each axis of
    the loops along the normal. Nothing else moves at the neutral pose. A note tells each tilt over EXACT.

    Raises
    ------
    MechanismError : a joint or closure is off the plane by more than LIMIT; names it.
    """
    if description.plane is None:
        return description
    declared = _unit(description.plane.normal)
    axes = _axes(model, _in_loops(model, description.closures))
    carrying = _axes(model, _carriers(model, description.closures))
    axes |= {i: axis for i, axis in carrying.items() if axis[1]}
    _check(axes, declared, model, description)
    normal = _middle([declared, *(direction for direction, turns in axes.values() if turns)])
    off = {i: axis for i, axis in axes.items() if _tilt(axis, normal) > EXACT}
    tilts = {f"the axis of joint '{model.names[i]}'": _tilt(axis, normal) for i, axis in off.items()}
    plane = description.plane
    if (tilt := _tilt((declared, True), normal)) > EXACT:
        tilts = {"its normal": tilt} | tilts
        plane = Plane(normal=tuple(normal.tolist()))
    tilts |= _check_closures(normal, model, description)
    told = ", ".join(f"{what} was {tilt:.1e} rad off" for what, tilt in tilts.items())
    return description.model_copy(update={
        "plane": plane,
        "tree": _with_axes(description, model, {i: _exact(axis, normal) for i, axis in off.items()}),
        "notes": (*description.notes, *([f"plane: made exact; {told}"] if told else [])),
    })  # fmt: skip


def found(model: pin.Model, closure: Closure) -> tuple[np.ndarray, float] | None:
    """Normal of the plane in which a loop moves, and how far apart its ends lie along it [m]; None of a spatial one."""
    axes = _axes(model, _in_loops(model, [closure])).values()
    turning = [direction for direction, turns in axes if turns]
    if not turning or any(_tilt(axis, turning[0]) > LIMIT for axis in axes):
        return None
    data, normal = _neutral(model), turning[0] * np.sign(turning[0][np.abs(turning[0]).argmax()])
    first, second = (data.oMf[frame_id(model, name)].translation for name in closure.frames)
    return normal, float(normal @ (second - first))


def open_across(model: pin.Model, description: Description) -> MechanismError | None:
    """The error of a loop that no pose can close, because its ends lie apart across the plane in which it moves."""
    for i, closure in enumerate(description.closures if description.plane is None else ()):
        planar = found(model, closure)
        if planar and abs(planar[1]) > CLOSED:
            direction = short(planar[0])
            return MechanismError(
                f"No pose closes the loop '{closure.label}': it moves in the plane with normal {direction}, and its "
                f"ends lie {abs(planar[1]) * 1e3:.3g} mm apart along that direction.",
                f"Where its links lie in layers beside each other, add 'plane: {{normal: {direction}}}'; else correct "
                "the placements.",
                **description.where("closures", f"closures.{i}.frames", list(closure.frames)),
            )
    return None


def remedy(model: pin.Model, description: Description) -> str | None:
    """What to declare where all loops move in one plane, and none is declared."""
    planes = [found(model, closure) for closure in description.closures if description.plane is None]
    normals = [plane[0] for plane in planes if plane]
    if not normals or len(normals) < len(planes):
        return None
    return f"All moves in one plane: add 'plane: {{normal: {short(normals[0])}}}'."


def short(direction: np.ndarray) -> str:
    """A direction with digits that `put_right` completes."""
    return "[" + ", ".join(f"{x + 0.0:.6g}" for x in direction.round(6)) + "]"


def _check(axes: dict[int, Axis], normal: np.ndarray, model: pin.Model, description: Description) -> None:
    """No joint is off the plane by more than rounding explains."""
    tilts = {i: _tilt(axis, normal) for i, axis in axes.items()}
    worst = max(tilts, key=lambda i: tilts[i], default=0)
    if worst and tilts[worst] > LIMIT:
        raise MechanismError(
            f"The joint '{model.names[worst]}' does not move in the declared plane: its axis is {tilts[worst]:.2g} rad "
            f"off; {LIMIT:g} rad at most are put right.",
            "Correct its axis or the normal; or remove 'plane', so that point closures keep three rows.",
            **description.where("plane", "plane.normal", list(normal.tolist())),
        )


def _check_closures(normal: np.ndarray, model: pin.Model, description: Description) -> dict[str, float]:
    """Closures that ask for an orientation stand in the plane; tilts [rad] that are left out as rounding."""
    data, tilts = _neutral(model), {}
    for i, closure in enumerate(description.closures):
        R1, R2 = (data.oMf[frame_id(model, name)].rotation for name in closure.frames)
        if closure.type == "point":
            continue
        if closure.type == "frame":
            tilt = float(np.linalg.norm(np.cross(R1.T @ normal, R2.T @ normal)))
        else:
            tilt = max(_tilt((R @ _unit(closure.axis), True), normal) for R in (R1, R2))
        if tilt > LIMIT:
            raise MechanismError(
                f"The closure '{closure.label}' does not stand in the declared plane: it is {tilt:.2g} rad off; "
                f"{LIMIT:g} rad at most are put right.",
                "Correct the frames, or use type point.",
                **description.where("closures", f"closures.{i}.type", closure.type),
            )
        if tilt > EXACT:
            tilts[f"closure '{closure.label}'"] = tilt
    return tilts


def _middle(directions: list[np.ndarray]) -> np.ndarray:
    """The one of several directions from which the others are least off, with the sign of the first."""
    totals = [sum(_tilt((other, True), direction) for other in directions) for direction in directions]
    best = directions[int(np.argmin(totals))]
    return best * np.sign(best @ directions[0])


def _exact(axis: Axis, normal: np.ndarray) -> np.ndarray:
    """The direction along the normal, or in the plane, that an axis nearly has."""
    direction, turns = axis
    along = normal * (direction @ normal)
    return _unit(along if turns else direction - along)


def _tilt(axis: Axis, normal: np.ndarray) -> float:
    """Angle between an axis and the normal, or between the axis of a slider and the plane [rad]."""
    direction, turns = axis
    along, across = abs(float(direction @ normal)), float(np.linalg.norm(np.cross(direction, normal)))
    return float(np.arctan2(across, along) if turns else np.arctan2(along, across))


def _with_axes(description: Description, model: pin.Model, axes: dict[int, np.ndarray]) -> str:
    """The tree with some axes replaced, which are given in the world at the neutral pose."""
    if not axes:
        return description.tree
    root = xml.parse_text(description.tree.encode(), description.origin.tree)
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    data = _neutral(model)
    for i, axis in axes.items():
        joint = joints[model.names[i]]
        element = joint.find("axis")
        element = etree.SubElement(joint, "axis") if element is None else element
        element.set("xyz", xml.text(data.oMi[i].rotation.T @ axis))
    return etree.tostring(root, encoding="unicode")


def _axes(model: pin.Model, joints: Iterable[int]) -> dict[int, Axis]:
    data, found = _neutral(model), {}
    for i in sorted(joints):
        axis, turns = joint_axis(model, i)
        found[i] = data.oMi[i].rotation @ _unit(axis), turns
    return found


def _neutral(model: pin.Model) -> pin.Data:
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.zeros(model.nq))
    return data


def _in_loops(model: pin.Model, closures: Iterable[Closure]) -> set[int]:
    """Joints between the two frames of a closure."""
    return {i for closure in closures for i in set.symmetric_difference(*_supports(model, closure))}


def _carriers(model: pin.Model, closures: Iterable[Closure]) -> set[int]:
    """Joints that move a loop as a whole."""
    return {i for closure in closures for i in set.intersection(*_supports(model, closure)) if i}


def _supports(model: pin.Model, closure: Closure) -> list[set[int]]:
    return [set(model.supports[model.frames[frame_id(model, name)].parentJoint]) for name in closure.frames]


def _unit(vector: Iterable[float]) -> np.ndarray:
    values = np.asarray(tuple(vector), float)
    return values / np.linalg.norm(values)
