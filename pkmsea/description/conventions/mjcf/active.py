"""What of a compiled model is switched on: <flag>, `active` and `actuatorgroupdisable` count."""

from __future__ import annotations

import mujoco
from mujoco import mjtDisableBit, mjtEq

GROUPS = 31  # of actuators; those of higher numbers cannot be switched off


def disabled(model: mujoco.MjModel, *bits: mjtDisableBit) -> bool:
    """Whether one of these flags is off."""
    return any(model.opt.disableflags & bit for bit in bits)


def equalities(model: mujoco.MjModel, *kinds: mjtEq) -> list[int]:
    """Indices of the equalities of these kinds that hold from the start."""
    if disabled(model, mjtDisableBit.mjDSBL_CONSTRAINT, mjtDisableBit.mjDSBL_EQUALITY):
        return []
    return [i for i in range(model.neq) if model.eq_active0[i] and mjtEq(model.eq_type[i]) in kinds]


def actuators(model: mujoco.MjModel) -> list[int]:
    """Indices of the actuators that act."""
    if disabled(model, mjtDisableBit.mjDSBL_ACTUATION):
        return []
    off = [group for group in range(GROUPS) if model.opt.disableactuator >> group & 1]
    return [i for i in range(model.nu) if model.actuator_group[i] not in off]
