"""An NLP whose limits may be overstepped at a price: what is left of it says which of them contend.

    min  rho f(x) / |f_0| + sum_i s_i    subject to    l - E s <= g(x) <= u + E s,  s >= 0

where s_i is how far one limit is widened at all instants, as a share of its size, and all other constraints hold. For a
small rho no limit is widened where none need be.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from pkmsea.problem import Bound
from pkmsea.problem.bounds import TINY
from pkmsea.transcription.nlp import Nlp, Variable

RHO = (1e-2, 1e-5)  # of the steps: the first finds the way
START, SCALE = 0.1, 0.1  # of a share


@dataclass(frozen=True, eq=False)
class Side:
    """A limit that may be widened, on one side or on both: its rows in the NLP, and what its share is relative to."""

    bound: Bound
    rows: np.ndarray
    lower: bool
    upper: bool
    size: float

    @property
    def stated(self) -> str:
        """Where it stands."""
        return self.bound.stated[self.upper]

    def needed(self, share: float) -> str:
        """Such as 'dq A <= 3 needs 3.4'."""
        at, sign = (self.bound.upper, "<=") if self.upper else (self.bound.lower, ">=")
        wider = at + share * self.size * (1 if self.upper else -1)
        return f"{self.bound.label} {sign} {at:.4g} needs {wider:.4g}"


def sides_of(bound: Bound, rows: np.ndarray, values: np.ndarray) -> list[Side]:
    """The sides of a limit, one where both are equal and opposite; `values` are its signal's."""
    if bound.lower == -bound.upper:
        return [Side(bound, rows, True, True, bound.upper)]
    span = max(float(np.ptp(values)), TINY)
    found = [Side(bound, rows, True, False, span), Side(bound, rows, False, True, span)]
    return [side for side, at in zip(found, (bound.lower, bound.upper), strict=True) if np.isfinite(at)]


def relaxed(nlp: Nlp, sides: Sequence[Side]) -> Nlp:
    """The NLP in (x, s); each of the `sides` has one share. Its derivatives must be given."""
    x, count = nlp.stacked("guess"), len(sides)
    kept = np.setdiff1d(np.arange(nlp.g_lower.size), np.concatenate([side.rows for side in sides]))
    pieces = [(kept, nlp.g_lower[kept], nlp.g_upper[kept], 0, 0.0)]
    for i, side in enumerate(sides):
        free = np.full(side.rows.size, np.inf)
        pieces += [(side.rows, nlp.g_lower[side.rows], free, i, side.size)] if side.lower else []
        pieces += [(side.rows, -free, nlp.g_upper[side.rows], i, -side.size)] if side.upper else []
    rows, lower, upper = (np.concatenate([piece[k] for piece in pieces]) for k in (0, 1, 2))
    select = ca.DM(ca.Sparsity.triplet(rows.size, nlp.g_lower.size, list(range(rows.size)), rows.tolist()), 1.0)
    widen = ca.DM(rows.size, count)
    first = kept.size
    for own, _, _, i, size in pieces[1:]:
        widen[first : first + own.size, i] = size
        first += own.size
    step_0 = nlp.parameter(0, x)
    scale = abs(float(nlp.oracle(x, step_0)[0])) or 1.0
    shares = Variable("s", np.zeros(count), np.full(count, np.inf), np.full(count, SCALE), np.full(count, START))

    def parameter(step: int, z: np.ndarray) -> np.ndarray:
        return np.append(nlp.parameter(0, z[: x.size]), RHO[step])

    oracle, derivatives = _functions(nlp, select, widen, scale)
    return Nlp((*nlp.variables, shares), lower, upper, oracle, len(RHO), parameter, derivatives, nlp)


def _functions(nlp: Nlp, select: ca.DM, widen: ca.DM, scale: float) -> tuple[ca.Function, dict[str, ca.Function]]:
    n, count = nlp.oracle.size1_in(0), widen.shape[1]
    z, p = ca.MX.sym("x", n + count), ca.MX.sym("p", nlp.oracle.size1_in(1) + 1)
    x, s, own, rho = z[:n], z[n:], p[:-1], p[-1] / scale
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", select.shape[0])
    f, g = nlp.oracle(x, own)
    slope = nlp.derivatives["grad_f"](x, own)[1]
    jacobian = nlp.derivatives["jac_g"](x, own)[1]
    bend = nlp.derivatives["hess_lag"](x, own, rho * lam_f, ca.mtimes(select.T, lam_g))
    value, rows = rho * f + ca.sum1(s), ca.mtimes(select, g) + ca.mtimes(widen, s)
    given, weights = ["x", "p"], ["lam_f", "lam_g"]
    oracle = ca.Function("nlp", [z, p], [value, rows], given, ["f", "g"])
    return oracle, {
        "grad_f": ca.Function(
            "nlp_grad_f", [z, p], [value, ca.vertcat(rho * slope, ca.MX.ones(count))], given, ["f", "grad_f_x"]
        ),
        "jac_g": ca.Function(
            "nlp_jac_g", [z, p], [rows, ca.horzcat(ca.mtimes(select, jacobian), widen)], given, ["g", "jac_g_x"]
        ),
        "hess_lag": ca.Function(
            "nlp_hess_l",
            [z, p, lam_f, lam_g],
            [ca.diagcat(bend, ca.MX(count, count))],
            [*given, *weights],
            ["triu_hess_gamma_x_x"],
        ),
    }
