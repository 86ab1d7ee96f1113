"""Assembling a Mechanism: URDF and sidecar in, checked names, closed loops and named Functions out."""

from __future__ import annotations

from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin

from pkmsea.bridge import TreeFunctions, tree_functions
from pkmsea.errors import BridgeError, InputError, MechanismError, NameNotFound
from pkmsea.files import read
from pkmsea.mechanism import closures, pose, urdf
from pkmsea.mechanism.mechanism import Mechanism
from pkmsea.mechanism.sidecar import Sidecar

SIDECAR = "mechanism.yaml"
AXES = {"x": 0, "y": 1, "z": 2}


def load_mechanism(source: str | Path) -> Mechanism:
    """Load a mechanism from a folder with a `*.urdf` and a `mechanism.yaml`, or by the name of one that pkmsea ships.

    Raises
    ------
    InputError : names file, key, value and remedy.
    """
    folder = urdf.find_folder(source)
    file = folder / SIDECAR
    sidecar = read(Sidecar, file)
    path = urdf.find_urdf(folder, sidecar.urdf)
    model, text = urdf.read_model(path)
    model.gravity.linear = np.array(sidecar.gravity)
    _check_names(model, sidecar, file)
    frames = [frame for closure in sidecar.closures for frame in closure.frames] + [sidecar.end_effector.frame]
    try:
        tree = tree_functions(model, list(dict.fromkeys(frames)))
    except BridgeError as error:
        raise BridgeError(error.cause, error.remedy, file=path, key=error.key) from None

    q = ca.SX.sym("q", model.nq)
    Phi = closures.residual(q, tree, sidecar.closures, sidecar.plane.normal if sidecar.plane else None)
    seed, mobility, rows = _close(Phi, q, model, sidecar, file)
    functions = closures.functions(Phi, q, rows)
    functions |= _minimal(functions, tree, model, sidecar, mobility, file)
    mechanism = Mechanism(folder.resolve().name, folder, sidecar, model, text, tree, functions, seed, mobility)
    _check_independent(mechanism, file)
    return mechanism


def _check_names(model: pin.Model, sidecar: Sidecar, file: Path) -> None:
    joints = list(model.names)[1:]
    for key, names in (("actuated", sidecar.actuated), ("independent", sidecar.independent), ("seed", sidecar.seed)):
        for name in names:
            if name not in joints:
                raise NameNotFound("joint", name, joints, file=file, key=key)
    frames = sorted({frame.name for frame in model.frames})
    named = [(f"closures.{i}.frames", frame) for i, c in enumerate(sidecar.closures) for frame in c.frames]
    for key, frame in [*named, ("end_effector.frame", sidecar.end_effector.frame)]:
        if frame not in frames:
            raise NameNotFound("frame", frame, frames, file=file, key=key)


def _close(Phi: ca.SX, q: ca.SX, model: pin.Model, sidecar: Sidecar, file: Path) -> tuple[np.ndarray, int, list[int]]:
    """A closed seed pose, the mobility by rank, and the independent rows of Phi, chosen at the most generic pose."""
    every_row = ca.Function("closure", [q], [Phi, ca.densify(ca.jacobian(Phi, q))])
    guess = np.array([sidecar.seed.get(name, 0.0) for name in list(model.names)[1:]])
    seed = pose.close(every_row, guess)
    if seed is None:
        gap = float(np.abs(np.array(every_row(guess)[0])).max())
        raise MechanismError(
            f"The loops do not close from the seed pose; they stay open by up to {gap:.3g} m there.",
            "Give joint positions near a closed pose under 'seed'.", file=file, key="seed",
        )  # fmt: skip
    poses = [seed, *pose.scatter(every_row, seed)]
    ranked = [(closures.independent_rows(np.array(every_row(p)[1])), p) for p in poses]
    rows = max((chosen for chosen, _ in ranked), key=len)
    mobility = model.nq - len(rows)
    if mobility == 0:
        raise MechanismError("The closed mechanism cannot move.", "Remove a closure.", file=file, key="closures")
    return seed, mobility, rows


def _minimal(
    closed: dict[str, ca.Function], tree: TreeFunctions, model: pin.Model, sidecar: Sidecar, mobility: int, file: Path
) -> dict[str, ca.Function]:
    """r_E, J_E, H, H_A, M and g as Functions of q (and v_ind), by eliminating the dependent joints."""
    joints = list(model.names)[1:]
    independent = [joints.index(name) for name in sidecar.independent]
    if len(set(independent)) != mobility:
        raise MechanismError(
            f"{len(independent)} independent coordinates are named, but the mobility of the closed mechanism is "
            f"{mobility}.",
            f"Name {mobility} different joint(s).", file=file, key="independent", value=list(sidecar.independent),
        )  # fmt: skip
    dependent = [i for i in range(model.nq) if i not in independent]
    q, v_ind = ca.SX.sym("q", model.nq), ca.SX.sym("v_ind", mobility)
    G = closed["closure_jacobian"](q)
    H = ca.SX(model.nq, mobility)
    H[independent, :] = ca.SX.eye(mobility)
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
    axes = [AXES[axis] for axis in sidecar.end_effector.axes]
    r_E = ca.densify(tree.placement[sidecar.end_effector.frame](q)[axes, 3])
    J_E = tree.jacobian[sidecar.end_effector.frame](q)[axes, :]
    named = {
        "end_effector": ([q], r_E, "r_E"),
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


def _check_independent(mechanism: Mechanism, file: Path) -> None:
    H = mechanism.velocity_map(mechanism.seed)
    if not np.all(np.isfinite(H)) or np.linalg.cond(H) > 1e8:
        raise MechanismError(
            "The independent coordinates do not determine the motion at the seed pose.",
            "Name other joints, or give a seed away from the singularity.",
            file=file, key="independent", value=list(mechanism.sidecar.independent),
        )  # fmt: skip
    if not any(mechanism.tree.mass_matrix(mechanism.seed).nonzeros()):
        raise InputError("No link has a mass.", "Give the links inertials.", file=mechanism.folder)
