"""An NLP whose cost and equations are sums over stages that all look alike, with exact derivatives.

Stage k sees w_k = T_k x[index_k], a few linear combinations of a few unknowns. It adds weight_k f(w_k) to the cost and
g(w_k) to the constraints. So the Lagrangian's Hessian is the sum of T_k^T W_k T_k at the rows and columns index_k, W_k
being the Hessian of weight_k f + lambda_k^T g.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np
from layout import Layout, pattern

from pkmsea.kernels import Batch
from pkmsea.transcription.nlp import Callback, Nlp, Variable
from pkmsea.transcription.windows import LinearRows


class StageNlp:
    """Values and derivatives of the NLP. `numbers` are the stage's p after its first entry, the kink's width eps."""

    def __init__(
        self, functions: Sequence[ca.Function], layout: Layout, numbers: np.ndarray, box: np.ndarray,
        rows: LinearRows | None,
    ) -> None:  # fmt: skip
        """`box` (2, K, g): bounds of g, infinite where a stage does not have that constraint; `rows`: linear ones."""
        self.layout, self.numbers, self.size = layout, numbers, int(layout.index.max()) + 1
        K, L = layout.index.shape
        self._values, self._slopes, self._curvature = (Batch(function, K) for function in functions)
        self._kept = np.isfinite(box).any(axis=0)
        self._rows = rows.matrix.tocoo() if rows is not None else None
        linear = (rows.lower, rows.upper) if rows is not None else (np.zeros(0), np.zeros(0))
        self.lower, self.upper = (np.concatenate([a, b[self._kept]]) for a, b in zip(linear, box, strict=True))
        row = linear[0].size + np.arange(np.count_nonzero(self._kept))
        i, j = np.repeat(row, L), layout.index[np.nonzero(self._kept)[0]].ravel()
        if self._rows is not None:
            i, j = np.concatenate([self._rows.row, i]), np.concatenate([self._rows.col, j])
        self.jacobian_pattern, self._jacobian_at = pattern(i, j, self.lower.size, self.size)
        i, j = (np.broadcast_to(side, (K, L, L)) for side in (layout.index[:, :, None], layout.index[:, None, :]))
        self._upper = i <= j
        self.hessian_pattern, self._hessian_at = pattern(i[self._upper], j[self._upper], self.size, self.size)

    def values(self, w: np.ndarray, eps: float) -> np.ndarray:
        """h = (f, g) of all stages, (K, 1 + g)."""
        return self._values(w, np.concatenate([[eps], self.numbers]))[0]

    def slopes(self, w: np.ndarray, eps: float) -> np.ndarray:
        """dh/dw of all stages, (K, 1 + g, w)."""
        return self._slopes(w, np.concatenate([[eps], self.numbers]))[0]

    def cost(self, x: np.ndarray, eps: float) -> float:
        """Sum of the stages' weighted costs; with eps = 0 the exact positive part."""
        return float(self.layout.weight @ self.values(self.layout.local(x), eps)[:, 0])

    def constraints(self, x: np.ndarray, eps: float) -> np.ndarray:
        """Linear rows, then those g of every stage that are bounded."""
        g = self.values(self.layout.local(x), eps)[:, 1:][self._kept]
        return g if self._rows is None else np.concatenate([self._rows @ x, g])

    def gradient(self, x: np.ndarray, eps: float) -> np.ndarray:
        """Gradient of the cost."""
        slope = self.layout.weight[:, None, None] * self.slopes(self.layout.local(x), eps)[:, :1] @ self.layout.T
        return np.bincount(self.layout.index.ravel(), slope.ravel(), self.size)

    def jacobian(self, x: np.ndarray, eps: float) -> np.ndarray:
        """Nonzeros of the constraints' Jacobian."""
        values = (self.slopes(self.layout.local(x), eps)[:, 1:] @ self.layout.T)[self._kept].ravel()
        if self._rows is not None:
            values = np.concatenate([self._rows.data, values])
        return np.bincount(self._jacobian_at, values, self.jacobian_pattern.nnz())

    def hessian(self, x: np.ndarray, eps: float, factor: float, multipliers: np.ndarray) -> np.ndarray:
        """Nonzeros of the upper triangle of the Lagrangian's Hessian."""
        mu = np.concatenate([factor * self.layout.weight[:, None], np.zeros(self._kept.shape)], axis=1)
        mu[:, 1:][self._kept] = multipliers[multipliers.size - np.count_nonzero(self._kept) :]
        W = self._curvature(self.layout.local(x), np.concatenate([[eps], self.numbers]), mu)[0]
        blocks = self.layout.T.transpose(0, 2, 1) @ (W @ self.layout.T)
        return np.bincount(self._hessian_at, blocks[self._upper], self.hessian_pattern.nnz())

    def nlp(self, variables: tuple[Variable, ...], widths: Callable[[int, np.ndarray], np.ndarray], steps: int) -> Nlp:
        """Wrapped for the solver, with `widths` (step, x) -> eps."""
        one, x, rows = ca.Sparsity.dense(1), ("x", ca.Sparsity.dense(self.size)), ca.Sparsity.dense(self.lower.size)
        given, f, g = [x, ("p", one)], ("f", one), ("g", rows)

        def wrap(name: str, first: tuple, second: tuple, functions: tuple[Callable, Callable]) -> Callback:
            def evaluate(a, r):
                for result, function in zip(r, functions, strict=True):
                    if result is not None:
                        result[:] = function(a[0], a[1][0])

            return Callback(name, given, [first, second], evaluate)

        def curvature(a, r):
            r[0][:] = self.hessian(a[0], a[1][0], a[2][0], np.zeros(self.lower.size) if a[3] is None else a[3])

        derivatives = {
            "grad_f": wrap("nlp_grad_f", f, ("grad_f_x", x[1]), (self.cost, self.gradient)),
            "jac_g": wrap("nlp_jac_g", g, ("jac_g_x", self.jacobian_pattern), (self.constraints, self.jacobian)),
            "hess_lag": Callback("nlp_hess_l", [*given, ("lam_f", one), ("lam_g", rows)],
                                 [("triu_hess_gamma_x_x", self.hessian_pattern)], curvature),
        }  # fmt: skip
        oracle = wrap("nlp", f, g, (self.cost, self.constraints))
        return Nlp(variables, self.lower, self.upper, oracle, steps, widths, derivatives, self)
