"""Assembling a Mechanism: files in any convention in, checked names, closed loops and named Functions out."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin

from pkmsea.bridge import TreeFunctions, frame_id, tree_functions
from pkmsea.errors import BridgeError, MechanismError, NameNotFound
from pkmsea.mechanism import closures, plane, propose, urdf
from pkmsea.mechanism.conventions import Source, read_source
from pkmsea.mechanism.mechanism import Mechanism, Origin
from pkmsea.mechanism.mobility import Loops, close_loops
from pkmsea.mechanism.sidecar import Sidecar

AXES = {"x": 0, "y": 1, "z": 2}
SINGULAR = 1e8  # condition number of H
MASSLESS = 1e-12  # smallest over largest eigenvalue of M


def load_mechanism(source: str | Path, guess: bool = False) -> Mechanism:
    """Load a mechanism from a folder, a sidecar or a tree (see `pkmsea.mechanism.conventions`), or by the name of one
    that pkmsea ships.

    With `guess`, drives, end effector and seed that the files leave open are proposed, and named in
    `mechanism.origin.proposed`.

    Raises
    ------
    InputError : names file, key, value and remedy.
    """
    said = read_source(urdf.find(source))
    model, text, notes = urdf.build_model(said)
    _check_frames(model, said)
    propose.check_joint_names(said, model)
    draft = said.draft
    closing = [frame for closure in draft.closures for frame in closure.frames]
    tree = _tree(model, closing, said)
    q = ca.SX.sym("q", model.nq)
    Phi = closures.residual(q, tree, draft, list(model.names)[1:])
    every_row = ca.Function("closure", [q], [Phi, ca.densify(ca.jacobian(Phi, q))], ["q"], ["Phi", "G"])
    worth = partial(propose.worth, said, model) if guess else None
    loops = close_loops(every_row, closures.sense(q, tree, draft.closures), model, said, worth)
    plane.check(model, loops.seed, said)
    sidecar, proposed = propose.complete(said, loops, model, guess)
    tree = _tree(model, [*closing, sidecar.end_effector.frame], said)
    functions = closures.functions(Phi, q, loops.rows)
    functions |= _minimal(functions, tree, model, sidecar)
    origin = Origin(said.tree, said.sidecar, said.labels, proposed, tuple(notes), _conditioning(loops, model, sidecar))
    mechanism = Mechanism(
        said.name,
        said.folder,
        sidecar,
        model,
        text,
        tree,
        functions,
        loops.seed,
        loops.mobility,
        origin,
    )
    _check_motion(mechanism, said)
    return mechanism


def _tree(model: pin.Model, frames: list[str], source: Source) -> TreeFunctions:
    try:
        return tree_functions(model, list(dict.fromkeys(frames)))
    except BridgeError as error:
        raise BridgeError(error.cause, error.remedy, file=source.tree, key=error.key) from None


def _check_frames(model: pin.Model, source: Source) -> None:
    frames, draft = sorted({frame.name for frame in model.frames}), source.draft
    named = [("closures", f"closures.{i}.frames", frame) for i, c in enumerate(draft.closures) for frame in c.frames]
    if draft.end_effector is not None:
        named.append(("end_effector", "end_effector.frame", draft.end_effector.frame))
    for key, place, frame in named:
        if frame not in frames:
            raise NameNotFound("frame", frame, frames, file=source.where(key), key=place)
    for i, closure in enumerate(draft.closures):
        if len({model.frames[frame_id(model, frame)].parentJoint for frame in closure.frames}) == 1:
            raise MechanismError(
                "Both frames are on the same link.", "Name one frame on each side of the loop.",
                file=source.where("closures"), key=f"closures.{i}.frames", value=list(closure.frames),
            )  # fmt: skip


def _conditioning(loops: Loops, model: pin.Model, sidecar: Sidecar) -> float:
    joints = list(model.names)[1:]
    return loops.conditioning([joints.index(name) for name in sidecar.independent])


def _minimal(
    closed: dict[str, ca.Function], tree: TreeFunctions, model: pin.Model, sidecar: Sidecar
) -> dict[str, ca.Function]:
    """r_E, J_E, H, H_A, M and g as Functions of q (and v_ind), by eliminating the dependent joints."""
    joints = list(model.names)[1:]
    independent = [joints.index(name) for name in sidecar.independent]
    dependent = [i for i in range(model.nq) if i not in independent]
    q, v_ind = ca.SX.sym("q", model.nq), ca.SX.sym("v_ind", len(independent))
    G = closed["closure_jacobian"](q)
    H = ca.SX(model.nq, len(independent))
    H[independent, :] = ca.SX.eye(len(independent))
    gamma = ca.SX(model.nq, 1)
    if dependent:
        H[dependent, :] = -ca.solve(G[:, dependent], G[:, independent])
        v = ca.mtimes(H, v_ind)
        gamma[dependent] = -ca.solve(G[:, dependent], closed["closure_bias"](q, v))
    H, gamma = ca.densify(H), ca.densify(gamma)
    v = ca.mtimes(H, v_ind)
    M = ca.mtimes([H.T, tree.mass_matrix(q), H])
    g = ca.mtimes(H.T, tree.inverse_dynamics(q, v, gamma))
    H_A = H[[joints.index(name) for name in sidecar.actuated], :]
    end_effector = sidecar.end_effector
    axes = [AXES[axis] for axis in end_effector.axes]
    r_E, J_E = tree.placement[end_effector.frame](q)[axes, 3], tree.jacobian[end_effector.frame](q)[axes, :]
    if end_effector.joints:
        followed = [joints.index(name) for name in end_effector.joints]
        r_E, J_E = q[followed], ca.SX.eye(model.nq)[followed, :]
    named = {
        "end_effector": ([q], ca.densify(r_E), "r_E"),
        "end_effector_jacobian": ([q], J_E, "J_E"),
        "velocity_map": ([q], H, "H"),
        "actuation_jacobian": ([q], H_A, "H_A"),
        "mass_matrix": ([q], M, "M"),
        "bias": ([q, v_ind], g, "g"),
    }
    inputs = ["q", "v_ind"]
    return {
        name: ca.Function(name, arguments, [ca.densify(result)], inputs[: len(arguments)], [symbol])
        for name, (arguments, result, symbol) in named.items()
    }


def _check_motion(mechanism: Mechanism, source: Source) -> None:
    """At the seed, the independent coordinates determine the motion, and every motion moves a mass."""
    H = mechanism.velocity_map(mechanism.seed)
    if not np.all(np.isfinite(H)) or np.linalg.cond(H) > SINGULAR:
        raise MechanismError(
            "The independent coordinates do not determine the motion at the seed pose.",
            "Name other joints, leave the key out, or give a seed away from the singularity.",
            file=source.where("independent"), key="independent", value=list(mechanism.sidecar.independent),
        )  # fmt: skip
    inertia = np.linalg.eigvalsh(mechanism.mass_matrix(mechanism.seed))
    if not inertia[0] > MASSLESS * inertia[-1]:
        raise MechanismError(
            "The mechanism can move without moving a mass.", "Give its links inertials, with mass and inertia.",
            file=source.tree, key="link: inertial",
        )  # fmt: skip
