"""What a compiled model has and pkmsea does not model: refused, all of it in one message."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
from mujoco import mjtDisableBit, mjtEq, mjtJoint, mjtObj, mjtTrn

from pkmsea.description.conventions.mjcf.active import actuators, disabled, equalities
from pkmsea.description.conventions.mjcf.compiled import ROOT
from pkmsea.description.conventions.mjcf.names import name_of
from pkmsea.errors import MechanismError

READ = (mjtEq.mjEQ_CONNECT, mjtEq.mjEQ_WELD, mjtEq.mjEQ_JOINT)
CHAIN = "use a chain of hinges and slides with light bodies between"
REMOVE = "remove it"


class Unmodelled(NamedTuple):
    kind: str
    names: list[str]
    remedy: str


def refuse(model: mujoco.MjModel, file: Path) -> None:
    """Contacts, sensors, cameras and fixed geometry change no motion that pkmsea computes, and are no fault.

    Raises
    ------
    MechanismError : names everything that would change the motion.
    """
    faults = [fault for part in (_joints, _tendons, _equalities, _others) for fault in part(model) if fault.names]
    if faults:
        listed = "; ".join(f"{kind} {', '.join(map(repr, names))} ({remedy})" for kind, names, remedy in faults)
        raise MechanismError(f"pkmsea does not model {listed}.", "Change all of these.", file=file, key=ROOT)


def _joints(model: mujoco.MjModel) -> Iterator[Unmodelled]:
    joint = mjtObj.mjOBJ_JOINT
    springs = _any(model.jnt_stiffness, model.jnt_stiffnesspoly) & (not disabled(model, mjtDisableBit.mjDSBL_SPRING))
    forces = model.jnt_actfrclimited & (model.jnt_actfrcrange.sum(axis=1) != 0)
    yield Unmodelled("free joint", _named(model, joint, model.jnt_type == mjtJoint.mjJNT_FREE), f"fix it, or {CHAIN}")
    yield Unmodelled("ball joint", _named(model, joint, model.jnt_type == mjtJoint.mjJNT_BALL), CHAIN)
    yield Unmodelled("stiffness of joint", _named(model, joint, springs), "springs belong to the drives of the task")
    yield Unmodelled("actuatorfrcrange of joint", _named(model, joint, forces), "make it symmetric")


def _tendons(model: mujoco.MjModel) -> Iterator[Unmodelled]:
    constraint = mjtDisableBit.mjDSBL_CONSTRAINT
    for key, flags, *values in (
        ("stiffness", [mjtDisableBit.mjDSBL_SPRING], model.tendon_stiffness, model.tendon_stiffnesspoly),
        ("damping", [mjtDisableBit.mjDSBL_DAMPER], model.tendon_damping, model.tendon_dampingpoly),
        ("frictionloss", [constraint, mjtDisableBit.mjDSBL_FRICTIONLOSS], model.tendon_frictionloss),
        ("armature", [], model.tendon_armature),
        ("limit", [constraint, mjtDisableBit.mjDSBL_LIMIT], model.tendon_limited),
    ):
        which = _any(*values) & (not disabled(model, *flags))
        yield Unmodelled(f"{key} of tendon", _named(model, mjtObj.mjOBJ_TENDON, which), REMOVE)


def _equalities(model: mujoco.MjModel) -> Iterator[Unmodelled]:
    for kind in [kind for kind in mjtEq.__members__.values() if kind not in READ]:
        label = f"{kind.name.removeprefix('mjEQ_').lower()} equality"
        yield Unmodelled(label, _numbered(model, mjtObj.mjOBJ_EQUALITY, equalities(model, kind)), REMOVE)
    curved = [i for i in equalities(model, mjtEq.mjEQ_JOINT) if model.eq_data[i, 2:5].any()]
    label = "joint equality of a higher degree"
    yield Unmodelled(label, _numbered(model, mjtObj.mjOBJ_EQUALITY, curved), "keep two coefficients of polycoef")
    led = [i for i in equalities(model, mjtEq.mjEQ_CONNECT, mjtEq.mjEQ_WELD) if _is_led(model, i)]
    label = "equality with a mocap body"
    yield Unmodelled(label, _numbered(model, mjtObj.mjOBJ_EQUALITY, led), "nothing leads that body; remove it")


def _others(model: mujoco.MjModel) -> Iterator[Unmodelled]:
    joints = (mjtTrn.mjTRN_JOINT, mjtTrn.mjTRN_JOINTINPARENT)
    elsewhere = [i for i in actuators(model) if mjtTrn(model.actuator_trntype[i]) not in joints]
    yield Unmodelled("actuator", _numbered(model, mjtObj.mjOBJ_ACTUATOR, elsewhere), "let it act on a joint")
    heavy = model.opt.gravity.any() and not disabled(model, mjtDisableBit.mjDSBL_GRAVITY)
    carried = _any(model.body_gravcomp) & (model.body_mass > 0) & heavy
    yield Unmodelled("gravcomp of body", _named(model, mjtObj.mjOBJ_BODY, carried), REMOVE)
    yield Unmodelled("plugin of body", _named(model, mjtObj.mjOBJ_BODY, model.body_plugin >= 0), REMOVE)
    yield Unmodelled("flex", _numbered(model, mjtObj.mjOBJ_FLEX, range(model.nflex)), REMOVE)
    fluid = [key for key in ("density", "viscosity") if getattr(model.opt, key)]
    yield Unmodelled("fluid of option", fluid, "set it to 0")


def _is_led(model: mujoco.MjModel, equality: int) -> bool:
    ends = [int(model.eq_obj1id[equality]), int(model.eq_obj2id[equality])]
    if model.eq_objtype[equality] == mjtObj.mjOBJ_SITE:
        ends = [int(model.site_bodyid[site]) for site in ends]
    return any(model.body_mocapid[model.body_rootid[body]] >= 0 for body in ends)


def _any(*values: np.ndarray) -> np.ndarray:
    """Per element, whether any of its numbers is not zero."""
    return np.asarray(np.column_stack(values).any(axis=1))


def _named(model: mujoco.MjModel, kind: mjtObj, which: np.ndarray) -> list[str]:
    return _numbered(model, kind, np.flatnonzero(which).tolist())


def _numbered(model: mujoco.MjModel, kind: mjtObj, indices: Iterable[int]) -> list[str]:
    return [name_of(model, kind, i) for i in indices]
