"""What joints gain per cycle: their path closes, or they turn without end and gain whole turns.

A joint that gains g per period T is g t / T plus a periodic part.
"""

from __future__ import annotations

import numpy as np

from pkmsea.actuation import Actuation
from pkmsea.mechanism import Mechanism
from pkmsea.mechanism.closed_tree import TURN

ROUNDING = 1e-6  # [rad, m] of a gain


def gain(mechanism: Mechanism, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """What joints gain (n,) from the first pose of a path to that at which it closes; whole turns and zeros exactly."""
    found = last - first
    whole = np.where(mechanism.revolute, TURN * np.round(found / TURN), 0.0)
    return np.asarray(np.where(np.abs(found - whole) <= ROUNDING, whole, found)) + 0.0


def fault(actuation: Actuation, ranges: np.ndarray, gained: np.ndarray) -> str:
    """Why a cycle is none that can be repeated, because of what a joint gains; empty where it can."""
    mechanism = actuation.mechanism
    sprung = {mechanism.actuated[i] for i in actuation.structure.parallel}
    for j in np.flatnonzero(gained):
        whole = mechanism.revolute[j] and gained[j] == TURN * np.round(gained[j] / TURN)
        reason = (
            "so that the robot does not return to its pose" if not whole
            else "but the URDF does not call it continuous" if not mechanism.limits[j].continuous
            else "but its position is limited" if np.isfinite(ranges[:, j]).any()
            else "but a spring is parallel to it" if j in sprung
            else ""
        )  # fmt: skip
        if reason:
            return f"joint {told(mechanism, gained)[mechanism.joints[j]]} per cycle, {reason}"
    return ""


def told(mechanism: Mechanism, gained: np.ndarray) -> dict[str, str]:
    """Such as "'A' gains 1 turn", by joint."""
    found = {}
    for j in np.flatnonzero(gained):
        amount = gained[j] / TURN if mechanism.revolute[j] else gained[j]
        unit = "m" if not mechanism.revolute[j] else "turn" if abs(amount) == 1 else "turns"
        found[mechanism.joints[j]] = f"'{mechanism.joints[j]}' gains {amount:.6g} {unit}"
    return found


def of_motors(actuation: Actuation, gained: np.ndarray) -> np.ndarray:
    """What the drives' motor positions gain (m,)."""
    return np.asarray(gained[actuation.mechanism.actuated])


def of_free(actuation: Actuation, gained: np.ndarray) -> np.ndarray:
    """What the flat output's coordinates z of the free drives gain (m - delta,): those that are motor positions."""
    motors = of_motors(actuation, gained)
    return np.array([motors[i] if actuation.kinds[i].coordinate == "q_M" else 0.0 for i in actuation.free])
