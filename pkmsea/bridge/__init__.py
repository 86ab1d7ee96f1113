"""The bridge: Pinocchio's algorithms as CasADi Functions, for any tree of revolute and prismatic joints.

The wheels of `pin` lack the Python module `pinocchio.casadi`; the compiled module `_bridge` instantiates the same
C++ templates on CasADi's SX and returns serialised Functions (see bridge.cpp).
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.metadata import distribution
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path
from types import ModuleType

import casadi as ca
import numpy as np
import pinocchio as pin

from pkmsea.errors import BridgeError, NameNotFound


def _installed() -> ModuleType:
    """The compiled module of the installed pkmsea: sources that have none, such as a checkout's, hide it."""
    files = distribution("pkmsea").files or []
    path = next((Path(str(file.locate())) for file in files if file.name.startswith("_bridge.")), None)
    spec = path and spec_from_file_location(f"{__name__}._bridge", path)
    if not spec or spec.loader is None:
        raise ImportError("the installed pkmsea has none")
    sys.modules[spec.name] = module = module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


try:
    try:
        from pkmsea.bridge import _bridge  # type: ignore[attr-defined]
    except ImportError:
        _bridge = _installed()
except ImportError as error:
    raise BridgeError(
        f"The compiled module of pkmsea cannot be loaded ({error}).",
        f"Build it against the installed casadi {ca.__version__}: run 'pip install .' in the checkout (this needs a "
        "C++17 compiler, on Debian 'apt install g++').",
    ) from error

if _bridge.casadi_version != ca.__version__:
    raise BridgeError(
        f"pkmsea was compiled for casadi {_bridge.casadi_version}, but casadi {ca.__version__} is installed; the two "
        "share a binary interface.",
        f"Run 'pip install casadi=={_bridge.casadi_version}', or reinstall pkmsea.",
    )


@dataclass(frozen=True)
class TreeFunctions:
    """Dynamics and kinematics of the open tree; n joints, F frames.

    Attributes
    ----------
    mass_matrix : M_tree(q), (n, n), Pinocchio's `crba`.
    inverse_dynamics : tau(q, v, a), (n,), Pinocchio's `rnea`.
    bias : h(q, v) = tau(q, v, 0), (n,): Coriolis, centrifugal and gravity.
    placement : per frame name T(q), (4, 4), the homogeneous placement in the world.
    jacobian : per frame name J(q), (6, n), linear over angular, axes of the world, origin of the frame.
    """

    mass_matrix: ca.Function
    inverse_dynamics: ca.Function
    bias: ca.Function
    placement: dict[str, ca.Function]
    jacobian: dict[str, ca.Function]


def tree_functions(model: pin.Model, frames: Sequence[str]) -> TreeFunctions:
    """Run Pinocchio on symbols for `model` and the named `frames`.

    Raises
    ------
    BridgeError : a joint is neither revolute nor prismatic.
    NameNotFound : a frame does not exist.
    """
    joints = [_joint(model, i) for i in range(1, model.njoints)]
    serialized = _bridge.functions(joints, [_frame(model, name) for name in frames], list(model.gravity.linear))
    functions = [ca.Function.deserialize(text) for text in serialized]
    mass_matrix, inverse_dynamics, bias, placements, jacobians = functions
    return TreeFunctions(
        mass_matrix, inverse_dynamics, bias, _unstack(placements, frames, "T"), _unstack(jacobians, frames, "J")
    )


def _unstack(stacked: ca.Function, frames: Sequence[str], output: str) -> dict[str, ca.Function]:
    """One Function per frame from the Function that stacks them all."""
    q = ca.SX.sym("q", stacked.size1_in(0))
    blocks = ca.vertsplit(stacked(q), stacked.size1_out(0) // len(frames)) if frames else []
    return {
        name: ca.Function(output, [q], [block], ["q"], [output]) for name, block in zip(frames, blocks, strict=True)
    }


def joint_axis(model: pin.Model, index: int) -> tuple[np.ndarray, bool]:
    """Axis of a joint in its own frame, and whether it turns about it or slides along it.

    Raises
    ------
    BridgeError : the joint is neither revolute nor prismatic.
    """
    joint = model.joints[index]
    if joint.nq == 1 and joint.nv == 1:
        data = joint.createData()
        joint.calc(data, np.zeros(model.nq))
        linear, angular = np.split(np.asarray(data.S).reshape(6), 2)
        if linear.any() != angular.any():
            return (angular, True) if angular.any() else (linear, False)
    raise _unsupported(model.names[index], joint.shortname())


def _joint(model: pin.Model, index: int) -> _bridge.Joint:
    axis, turning = joint_axis(model, index)
    placement, inertia = model.jointPlacements[index], model.inertias[index]
    return _bridge.Joint(
        model.parents[index],
        turning,
        list(axis),
        _flat(placement.rotation),
        list(placement.translation),
        inertia.mass,
        list(inertia.lever),
        _flat(inertia.inertia),
    )


def _unsupported(name: str, kind: str) -> BridgeError:
    return BridgeError(
        f"Joint '{name}' is of type {kind}; pkmsea models revolute and prismatic joints about any axis.",
        "Replace it in the URDF by a chain of revolute and prismatic joints.",
        key=name,
    )


def _frame(model: pin.Model, name: str) -> _bridge.Frame:
    frame = model.frames[frame_id(model, name)]
    return _bridge.Frame(frame.parentJoint, _flat(frame.placement.rotation), list(frame.placement.translation))


def frame_id(model: pin.Model, name: str) -> int:
    """Index of a frame; where a link and a joint have the same name, the link is meant.

    Raises
    ------
    NameNotFound : no frame has this name.
    """
    kinds = [frame.type for frame in model.frames if frame.name == name]
    if not kinds:
        raise NameNotFound("frame", name, [frame.name for frame in model.frames])
    kind = pin.FrameType.BODY if pin.FrameType.BODY in kinds else kinds[0]
    return int(model.getFrameId(name, kind))


def _flat(matrix: np.ndarray) -> list[float]:
    return [float(x) for x in np.asarray(matrix).reshape(-1)]
