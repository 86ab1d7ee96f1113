"""Joints that are held, and their followers: a coupling to a joint that is held holds the other one, too."""

from __future__ import annotations

from pathlib import Path

from pkmsea.description.parts import Coupling
from pkmsea.description.sidecar import Draft
from pkmsea.errors import MechanismError

AGREE = 1e-9  # [rad, m]; two values that a joint is held at may differ by so much


def hold(draft: Draft, file: Path) -> tuple[Draft, list[str]]:
    """The draft with all followers of locked joints locked as well, and their couplings gone; notes on them.

    Raises
    ------
    MechanismError : a coupling holds a joint elsewhere than 'locked' does.
    """
    locked, open_, notes = dict(draft.locked), list(draft.couplings), []
    while ended := [coupling for coupling in open_ if {coupling.joint, coupling.of} & locked.keys()]:
        for coupling in ended:
            open_.remove(coupling)
            joint, at = _follower(coupling, locked)
            if joint in locked:
                _check(coupling, locked[joint], at, file)
                continue
            locked[joint] = at
            notes.append(f"joint '{joint}': held at {at:g}, since its coupling {coupling.label} ends at a locked joint")
    return draft.model_copy(update={"locked": locked, "couplings": tuple(open_)}), notes


def _follower(coupling: Coupling, locked: dict[str, float]) -> tuple[str, float]:
    """The joint that is held by the other one, and where."""
    if coupling.of in locked:
        return coupling.joint, coupling.ratio * locked[coupling.of] + coupling.offset
    if coupling.ratio == 0:
        return coupling.joint, coupling.offset
    return coupling.of, (locked[coupling.joint] - coupling.offset) / coupling.ratio


def _check(coupling: Coupling, at: float, follows: float, file: Path) -> None:
    if abs(at - follows) > AGREE:
        raise MechanismError(
            f"The coupling {coupling.label} does not hold where its joints are locked: it asks for {follows:g}.",
            f"Lock one of '{coupling.joint}' and '{coupling.of}' only; the other follows.",
            file=file,
            key="locked",
            value=at,
        )
