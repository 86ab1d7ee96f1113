"""Loop closures and couplings as equations: the residual Phi(q), its Jacobian and bias."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from pkmsea.bridge import TreeFunctions
from pkmsea.description import Closure, Description
from pkmsea.mechanism.conditioning import Conditioning


def residual(q: ca.SX, tree: TreeFunctions, description: Description, joints: Sequence[str]) -> ca.SX:
    """Phi(q), all rows, by closure and then by coupling.

    point      p_2 - p_1 in the world
    revolute   that, and the two parts of R_1^T R_2 n across the axis n
    frame      that, and the vee of the skew part of R_1^T R_2
    coupling   q_joint - ratio q_of - offset

    In a declared plane, where all axes are exact (see `plane.put_right`), rows that would be zero are left out: the gap
    has its two parts in the plane, a revolute closure no further rows, a frame closure the turn about the normal.
    """
    normal = description.plane.normal if description.plane else None
    rows = []
    for closure in description.closures:
        T1, T2 = (tree.placement[frame](q) for frame in closure.frames)
        gap = T2[:3, 3] - T1[:3, 3]
        rows.append(gap if normal is None else ca.mtimes(_across(normal), gap))
        R = ca.mtimes(T1[:3, :3].T, T2[:3, :3])
        if closure.type == "revolute" and normal is None:
            rows.append(ca.mtimes([_across(closure.axis), R, _unit(closure.axis)]))
        if closure.type == "frame":
            turn = ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2
            rows.append(turn if normal is None else ca.mtimes([_unit(normal).T, T1[:3, :3], turn]))
    for coupling in description.couplings:
        this, other = joints.index(coupling.joint), joints.index(coupling.of)
        rows.append(q[this] - coupling.ratio * q[other] - coupling.offset)
    return ca.densify(ca.vertcat(*rows)) if rows else ca.SX(0, 1)


@dataclass(frozen=True, eq=False)
class Equations:
    """All rows of Phi without units, of joint coordinates q_i / units_i: lengths are divided by L, see
    `pkmsea.mechanism.conditioning`.

    Attributes
    ----------
    function : Phi(q) and its Jacobian, in m and rad.
    units : of the joints (n,), 1 or L.
    lengths : of the rows, 1 or L.
    """

    function: ca.Function
    units: np.ndarray
    lengths: np.ndarray

    def __call__(self, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        Phi, G = (np.array(x) for x in self.function(q))
        return Phi.ravel() / self.lengths, G * self.units / self.lengths[:, None]


def equations(q: ca.SX, Phi: ca.SX, description: Description, conditioning: Conditioning) -> Equations:
    """The rows of `residual` as a call on numbers."""
    function = ca.Function("closure", [q], [Phi, ca.densify(ca.jacobian(Phi, q))], ["q"], ["Phi", "G"])
    L, planar, lengths = conditioning.length, description.plane is not None, list[float]()
    for closure in description.closures:
        turns = {"point": 0, "revolute": 0 if planar else 2, "frame": 1 if planar else 3}[closure.type]
        lengths += [L] * (2 if planar else 3) + [1.0] * turns
    units = dict(zip(conditioning.joints, conditioning.units.tolist(), strict=True))
    lengths += [units[coupling.joint] for coupling in description.couplings]
    return Equations(function, conditioning.units, np.array(lengths))


def sense(q: ca.SX, tree: TreeFunctions, closures: Sequence[Closure]) -> ca.Function:
    """Per closure, positive where it closes as meant; its rows are zero also for frames turned by half a turn."""
    signs = []
    for closure in closures:
        R1, R2 = (tree.placement[frame](q)[:3, :3] for frame in closure.frames)
        R, n = ca.mtimes(R1.T, R2), _unit(closure.axis)
        signs.append({"point": 1, "revolute": ca.mtimes([n.T, R, n]), "frame": ca.trace(R) - 1}[closure.type])
    return ca.Function("sense", [q], [ca.densify(ca.vertcat(*signs, 1))], ["q"], ["sense"])


def functions(Phi: ca.SX, q: ca.SX, rows: Sequence[int]) -> dict[str, ca.Function]:
    """The independent `rows` of Phi as named Functions: Phi(q), G(q) = dPhi/dq and gamma(q, v) = dG/dt v."""
    v = ca.SX.sym("v", q.numel())
    kept = Phi[list(rows)] if rows else ca.SX(0, 1)
    G = ca.jacobian(kept, q)
    gamma = ca.jtimes(ca.mtimes(G, v), q, v)
    return {
        "closure_residual": ca.Function("closure_residual", [q], [kept], ["q"], ["Phi"]),
        "closure_jacobian": ca.Function("closure_jacobian", [q], [ca.densify(G)], ["q"], ["G"]),
        "closure_bias": ca.Function("closure_bias", [q, v], [ca.densify(gamma)], ["q", "v"], ["gamma"]),
    }


def _unit(vector: Sequence[float]) -> np.ndarray:
    return np.asarray(vector, float)[:, None] / np.linalg.norm(vector)


def _across(normal: Sequence[float]) -> np.ndarray:
    """Two orthonormal rows at right angles to a direction; x and y where it is z."""
    n = _unit(normal).ravel()
    start = np.eye(3)[0 if abs(n[0]) < 0.9 else 1]
    first = start - n * (start @ n)
    first /= np.linalg.norm(first)
    return np.vstack([first, np.cross(n, first)]).round(15)
