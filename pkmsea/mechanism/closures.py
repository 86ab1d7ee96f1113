"""Loop closures as equations: the residual Phi(q) with its Jacobian and bias, independent rows only."""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from pkmsea.bridge import TreeFunctions
from pkmsea.mechanism.sidecar import Closure


def residual(q: ca.SX, tree: TreeFunctions, closures: Sequence[Closure], normal: Sequence[float] | None) -> ca.SX:
    """Phi(q), all rows: p_2 - p_1 in the world for a point, and the vee of R_1^T R_2 as well for a frame.

    In a planar mechanism (`normal` given) a point closure keeps its two in-plane rows, by a projector that does not
    depend on q.
    """
    rows = []
    for closure in closures:
        T1, T2 = (tree.placement[frame](q) for frame in closure.frames)
        gap = T2[:3, 3] - T1[:3, 3]
        rows.append(gap if normal is None else ca.mtimes(_in_plane(normal), gap))
        if closure.type == "frame":
            R = ca.mtimes(T1[:3, :3].T, T2[:3, :3])
            rows.append(ca.vertcat(R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]) / 2)
    return ca.densify(ca.vertcat(*rows)) if rows else ca.SX(0, 1)


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


def independent_rows(G: np.ndarray, tolerance: float = 1e-9) -> list[int]:
    """Rows of G that span its row space, best conditioned first (QR with pivoting), in their original order."""
    from scipy.linalg import qr

    if G.shape[0] == 0:
        return []
    _, R, pivots = qr(G.T, pivoting=True, mode="economic")
    diagonal = np.abs(np.diag(R))
    rank = int(np.sum(diagonal > tolerance * max(diagonal[0], 1.0)))
    return sorted(int(i) for i in pivots[:rank])


def _in_plane(normal: Sequence[float]) -> np.ndarray:
    """Two orthonormal rows that span the plane; the world's x and y axes where the normal is z."""
    n = np.asarray(normal, float) / np.linalg.norm(normal)
    start = np.eye(3)[0 if abs(n[0]) < 0.9 else 1]
    first = start - n * (start @ n)
    first /= np.linalg.norm(first)
    return np.vstack([first, np.cross(n, first)]).round(15)
