"""Does a loop that is declared planar move in its plane? Else its point closures would lack a row."""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from pkmsea.bridge import frame_id, joint_axis
from pkmsea.description import Description
from pkmsea.errors import MechanismError

TILT = 1e-6  # sine of the angle that rounded numbers explain


def check(model: pin.Model, q: np.ndarray, description: Description) -> None:
    """Revolute joints of the loops turn about the normal, prismatic ones slide at right angles to it.

    Raises
    ------
    MechanismError : names the joint that does not.
    """
    if description.plane is None:
        return
    normal = np.array(description.plane.normal) / np.linalg.norm(description.plane.normal)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    for i in sorted(_in_loops(model, description)):
        axis, turning = joint_axis(model, i)
        along = abs(float((data.oMi[i].rotation @ axis / np.linalg.norm(axis)) @ normal))
        tilt = np.sqrt(max(1 - along**2, 0.0)) if turning else along
        if tilt > TILT:
            raise MechanismError(
                f"The joint '{model.names[i]}' does not move in the declared plane.",
                "Correct its axis or the normal; or remove 'plane', so that point closures keep three rows.",
                **description.where("plane", "plane.normal", list(description.plane.normal)),
            )


def _in_loops(model: pin.Model, description: Description) -> set[int]:
    """Joints between the two frames of a closure."""
    found: set[int] = set()
    for closure in description.closures:
        sides = [set(model.supports[model.frames[frame_id(model, name)].parentJoint]) for name in closure.frames]
        found |= sides[0] ^ sides[1]
    return found
