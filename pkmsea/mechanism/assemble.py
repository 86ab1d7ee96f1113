"""Assembling a Mechanism: a description in, checked names, closed loops and named Functions out."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin

from pkmsea.bridge import TreeFunctions, frame_id, tree_functions
from pkmsea.description import CompleteDescription, Description, read
from pkmsea.errors import BridgeError, MechanismError, NameNotFound, noting
from pkmsea.mechanism import closures, hints, plane, propose
from pkmsea.mechanism.conditioning import Conditioning, characteristic_length
from pkmsea.mechanism.mechanism import Mechanism
from pkmsea.mechanism.mobility import close_loops
from pkmsea.mechanism.model import build_model

AXES = {"x": 0, "y": 1, "z": 2}
SINGULAR = 1e8  # condition number of H
MASSLESS = 1e-12  # smallest over largest eigenvalue of M


def load_mechanism(source: str | Path, guess: bool = False) -> Mechanism:
    """Load a mechanism from a folder, a sidecar or a tree (see `pkmsea.description.conventions`), or by the name of one
    that pkmsea ships.

    With `guess`, drives, end effector and seed that the files leave open are proposed, and named in
    `mechanism.description.origin.proposed`.

    Raises
    ------
    InputError : names file, key, value and remedy.
    """
    return build_mechanism(read(source), guess)


def build_mechanism(description: Description, guess: bool = False) -> Mechanism:
    """The mechanism that a description stands for; see `load_mechanism`. It reads no file.

    Raises
    ------
    InputError : names file, key, value and remedy.
    """
    notes = list(description.notes)
    with noting(notes):
        return _build(description, guess, notes)


def _build(description: Description, guess: bool, notes: list[str]) -> Mechanism:
    """The mechanism; what is noticed is added to `notes`, also before an error."""
    model = build_model(description)
    _check_frames(model, description)
    propose.check_joint_names(description, model)
    exact = plane.put_right(description, model)
    if exact.tree != description.tree:
        model = build_model(exact)
    description = exact
    notes += [*exact.notes, *hints.possible_loops(model, description)]
    closing = [frame for closure in description.closures for frame in closure.frames]
    tree = _tree(model, closing, description)
    q = ca.SX.sym("q", model.nq)
    Phi = closures.residual(q, tree, description, list(model.names)[1:])
    length = characteristic_length(model, [*closing, *propose.followers(description, model)])
    measure = Conditioning(model, description, length)
    worth = partial(propose.worth, description, measure) if guess else None
    every_row, sense = closures.equations(q, Phi, description, measure), closures.sense(q, tree, description.closures)
    loops = close_loops(every_row, sense, model, description, measure, worth)
    complete = propose.complete(description, loops, model, guess)
    tree = _tree(model, [*closing, complete.end_effector.frame], description)
    functions = closures.functions(Phi, q, loops.rows)
    functions |= _minimal(functions, tree, model, complete)
    length = characteristic_length(model, [*closing, complete.end_effector.frame])
    mechanism = Mechanism(complete, model, tree, functions, loops.seed, loops.mobility, length)
    _check_motion(mechanism)
    notes += hints.of(mechanism, loops.poses)
    told = complete.model_copy(update={"notes": tuple(dict.fromkeys(notes))})
    return replace(mechanism, description=told)


def _tree(model: pin.Model, frames: list[str], description: Description) -> TreeFunctions:
    try:
        return tree_functions(model, list(dict.fromkeys(frames)))
    except BridgeError as error:
        raise BridgeError(error.cause, error.remedy, file=description.origin.tree, key=error.key) from None


def _check_frames(model: pin.Model, description: Description) -> None:
    frames, loops = sorted({frame.name for frame in model.frames}), description.closures
    named = [("closures", f"closures.{i}.frames", frame) for i, loop in enumerate(loops) for frame in loop.frames]
    if description.end_effector is not None:
        named.append(("end_effector", "end_effector.frame", description.end_effector.frame))
    for key, place, frame in named:
        if frame not in frames:
            raise NameNotFound("frame", frame, frames, **description.where(key, place))
    for i, loop in enumerate(loops):
        if len({model.frames[frame_id(model, frame)].parentJoint for frame in loop.frames}) == 1:
            raise MechanismError(
                "Both frames are on the same link.",
                "Name one frame on each side of the loop.",
                **description.where("closures", f"closures.{i}.frames", list(loop.frames)),
            )


def _minimal(
    closed: dict[str, ca.Function], tree: TreeFunctions, model: pin.Model, description: CompleteDescription
) -> dict[str, ca.Function]:
    """r_E, J_E, H, H_A, M and g as Functions of q (and v_ind), by eliminating the dependent joints."""
    joints = list(model.names)[1:]
    independent = [joints.index(name) for name in description.independent]
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
    H_A = H[[joints.index(name) for name in description.actuated], :]
    end_effector = description.end_effector
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


def _check_motion(mechanism: Mechanism) -> None:
    """At the seed, the independent coordinates determine the motion, and every motion moves a mass."""
    description, H = mechanism.description, mechanism.velocity_map(mechanism.seed)
    if not np.all(np.isfinite(H)) or np.linalg.cond(H) > SINGULAR:
        raise MechanismError(
            "The independent coordinates do not determine the motion at the seed pose.",
            "Name other joints, leave the key out, or give a seed away from the singularity.",
            **description.where("independent", value=list(description.independent)),
        )
    inertia = np.linalg.eigvalsh(mechanism.mass_matrix(mechanism.seed))
    if not inertia[0] > MASSLESS * inertia[-1]:
        raise MechanismError(
            "The mechanism can move without moving a mass.",
            "Give its links inertials, with mass and inertia.",
            file=description.origin.tree,
            key="link: inertial",
        )
