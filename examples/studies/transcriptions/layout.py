"""One stage as CasADi Functions, where the stages find their variables, and where their derivatives belong."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np


def stage_functions(w: ca.SX, p: ca.SX, f: ca.SX, g: ca.SX) -> list[ca.Function]:
    """Values h = (f, g), their Jacobian, and the Hessian of mu^T h: (w, p[, mu]) -> h, slope or W."""
    h = ca.densify(ca.vertcat(f, g))
    mu = ca.SX.sym("mu", h.numel())
    W = ca.densify(ca.hessian(ca.dot(mu, h), w)[0])
    return [
        ca.Function("values", [w, p], [h], ["w", "p"], ["h"]),
        ca.Function("slopes", [w, p], [ca.cse(ca.densify(ca.jacobian(h, w)))], ["w", "p"], ["slope"]),
        ca.Function("curvature", [w, p, mu], [ca.cse(W)], ["w", "p", "mu"], ["W"]),
    ]


@dataclass(frozen=True, eq=False)
class Layout:
    """Where the stages find their variables in x: index (K, L), T (K, w, L); and their weights (K,) in the cost."""

    index: np.ndarray
    T: np.ndarray
    weight: np.ndarray

    def local(self, x: np.ndarray) -> np.ndarray:
        """w of all stages, (K, w)."""
        return (self.T @ x[self.index][:, :, None])[..., 0]


def pattern(i: np.ndarray, j: np.ndarray, rows: int, columns: int) -> tuple[ca.Sparsity, np.ndarray]:
    """Compressed columns of all entries (i, j), and the place of each among the nonzeros."""
    keys, place = np.unique(j.astype(np.int64) * rows + i, return_inverse=True)
    starts = np.concatenate([[0], np.cumsum(np.bincount(keys // rows, minlength=columns))])
    return ca.Sparsity(rows, columns, starts.tolist(), (keys % rows).tolist()), place.ravel()
