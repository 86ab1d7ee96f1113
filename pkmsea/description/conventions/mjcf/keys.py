"""Equalities, gravity, actuators and the first keyframe of a compiled model as keys of a sidecar."""

from __future__ import annotations

from typing import Any

import mujoco
import pinocchio as pin
from mujoco import mjtDisableBit, mjtEq, mjtObj

from pkmsea.description.conventions.keys import at
from pkmsea.description.conventions.mjcf.active import actuators, disabled, equalities
from pkmsea.description.conventions.mjcf.compiled import pose
from pkmsea.description.conventions.mjcf.names import Names, name_of

TORQUESCALE = 10  # where a weld's data hold it; with 0 it leaves the orientation free


def keys(model: mujoco.MjModel, names: Names) -> dict[str, Any]:
    """What a compiled model says beside its tree."""
    couplings, locked = _joint_equalities(model, names)
    said: dict[str, Any] = _closures(model, names)
    heavy = not disabled(model, mjtDisableBit.mjDSBL_GRAVITY)
    said["gravity"] = tuple(model.opt.gravity.tolist()) if heavy else (0.0, 0.0, 0.0)
    said |= {"couplings": couplings} if couplings else {}
    said |= {"locked": locked} if locked else {}
    driven = dict.fromkeys(names.joints[model.actuator_trnid[i, 0]] for i in actuators(model))
    actuated = tuple(name for name in driven if name not in locked)
    said |= {"actuated": actuated} if actuated else {}
    start = model.key_qpos[0] if model.nkey else model.qpos0
    seed = {name: float(q) for name, q in zip(names.joints, start, strict=True) if name not in locked}
    return said | ({"seed": seed} if model.nkey or start.any() else {})


def _closures(model: mujoco.MjModel, names: Names) -> dict[str, Any]:
    """<connect> and <weld> between sites, or between points of bodies that become frames."""
    frames: dict[str, Any] = {}
    closures = []
    for i in equalities(model, mjtEq.mjEQ_CONNECT, mjtEq.mjEQ_WELD):
        label = name_of(model, mjtObj.mjOBJ_EQUALITY, i)
        ends = [int(model.eq_obj1id[i]), int(model.eq_obj2id[i])]
        if model.eq_objtype[i] == mjtObj.mjOBJ_SITE:
            pair = [names.sites[end] for end in ends]
        else:
            pair = [names.frame(f"{label}_{side}") for side in (1, 2)]
            for frame, body, placement in zip(pair, ends, _anchors(model, i), strict=True):
                frames[frame] = at(names.bodies[body], placement)
        welded = model.eq_type[i] == mjtEq.mjEQ_WELD and model.eq_data[i, TORQUESCALE]
        closures.append({"name": label, "frames": tuple(pair), "type": "frame" if welded else "point"})
    return {"frames": frames, "closures": closures}


def _anchors(model: mujoco.MjModel, equality: int) -> tuple[pin.SE3, pin.SE3]:
    """Where the two bodies coincide; a weld says where the second one's anchor lies in the first, and how it turns."""
    data = model.eq_data[equality]
    if model.eq_type[equality] == mjtEq.mjEQ_CONNECT:
        return pose(data[:3]), pose(data[3:6])
    return pose(data[3:6], data[6:10]), pose(data[:3])


def _joint_equalities(model: mujoco.MjModel, names: Names) -> tuple[list[dict[str, Any]], dict[str, float]]:
    """q1 - r1 = a0 + a1 (q2 - r2) as couplings, q1 - r1 = a0 as locked joints; r is the joint's `ref`."""
    couplings: list[dict[str, Any]] = []
    locked: dict[str, float] = {}
    for i in equalities(model, mjtEq.mjEQ_JOINT):
        first, second = int(model.eq_obj1id[i]), int(model.eq_obj2id[i])
        offset, ratio = model.eq_data[i, :2].tolist()
        offset += float(model.qpos0[first])
        if second < 0:
            locked[names.joints[first]] = offset
        else:
            offset -= ratio * float(model.qpos0[second])
            joint, other = names.joints[first], names.joints[second]
            couplings.append({"joint": joint, "of": other, "ratio": ratio, "offset": offset})
    return couplings, locked
