"""First- and second-order conditions of a local minimum at a point of an NLP; the solver is not asked.

Every finite bound of a constraint or variable is one side a_i(x) <= 0 with slack s_i = -a_i; variables are divided by
their scales and f by a unit of the cost. With L = f + sum_i lambda_i a_i, a local minimum satisfies

    grad L = 0,   a_i <= 0,   lambda_i >= 0,   lambda_i s_i = 0                                        (KKT)
    d^T hess L d > 0 for every d != 0 with grad a_i^T d = 0 where lambda_i > 0                         (second order)

(J. Nocedal, S. J. Wright: Numerical Optimization, 2nd ed., Springer 2006: theorems 12.1, 12.5 and 12.6). The
multipliers are those that fit best: min over lambda >= 0 of |grad L|^2 + |lambda * s|^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy import sparse
from scipy.linalg import eigh, eigvalsh, qr, solve
from scipy.optimize import nnls

from pkmsea.solver.ipopt import excess
from pkmsea.solver.nlp import ScaledNlp, scaled
from pkmsea.transcription.nlp import Nlp

NEAR = 1e-3  # of the distance between its bounds (of a single bound: of its size, at least 1): may have a multiplier
ACTIVE = 1e-6  # likewise: blocks a direction
STRONG = 1e-6  # of the largest multiplier: what is less counts as zero
RANK = 1e-10  # of the largest row: what is less counts as dependent
SAVING = 1e-7  # of the cost: what is less is rounding; a stiffness off by 1 % costs 6e-6 and more
MEAN_MULTIPLIER = 100.0  # IPOPT's s_max: residuals are divided by the mean multiplier where that is larger
STATIONARY = 1e-4  # largest residual of a solution; of the paper's setups 3e-6, see examples/guides/verify.md
BLUR = 0.25  # the last step's parameter is known within this factor, as ln
BLUR_STEP, BLUR_STEPS = 1e-3, 4  # of the derivative with respect to ln p; of its Newton iteration


@dataclass(frozen=True, repr=False)
class Optimality:
    """How well a point satisfies the conditions of a local minimum; values of the cost relative to `unit`.

    Attributes
    ----------
    stationarity : |grad L|_inf / s_d, as IPOPT has it: s_d = max(100, mean multiplier) / 100
        (A. Waechter, L. T. Biegler, Math. Programming 106, 2006, eq. 5 and 6).
    infeasibility : largest violation of bounds and constraints, in the constraints' units.
    complementarity : largest lambda_i |s_i|, over s_d.
    saving : what a Newton step along the active constraints would still save, sum over the eigenvalues w_i of the
        reduced Hessian of (grad L)_i^2 / (2 |w_i|).
    curvature : smallest w_i; None where the active constraints leave no direction.
    negative : number of directions along which the cost falls to second order.
    kind : 'minimum'; 'saddle' where there are negative directions; 'undecided' where the curvature is zero within
        rounding, or where only constraints without a multiplier block the negative directions.
    unit : what differences of the objective are relative to, in the cost's unit.
    allowed : the saving that is as good as none.
    """

    stationarity: float
    infeasibility: float
    complementarity: float
    saving: float
    curvature: float | None
    negative: int
    kind: str
    unit: float
    allowed: float = SAVING

    def __repr__(self) -> str:
        return f"<Optimality: {self.kind}, KKT residual {self.error:.1e}, a Newton step saves {self.saving:.1e}>"

    @property
    def error(self) -> float:
        """The largest residual of the first-order conditions: IPOPT's optimality error E_0."""
        return max(self.stationarity, self.infeasibility, self.complementarity)

    @property
    def stationary(self) -> bool:
        """Whether the point satisfies the first-order conditions within STATIONARY, or misses them by rounding only.

        Where the problem is stiff, rounding of x leaves a large gradient; what it can save (which does not depend on
        scales) is then at most `allowed`.
        """
        return self.error <= STATIONARY or self.saving <= self.allowed

    @property
    def faults(self) -> tuple[str, ...]:
        """What speaks against a local minimum, one sentence each."""
        if not self.stationary:
            return (f"the motion is not stationary (KKT residual {self.error:.1e})",)
        if self.kind == "saddle":
            return (f"the motion is a saddle point: the cost falls along {self.negative} directions",)
        return ()

    @property
    def remark(self) -> str:
        """What stays open about a result that is verified; empty for a minimum."""
        if self.error > STATIONARY and self.saving > SAVING:
            return f"a Newton step would still save {self.saving:.0e} of it"
        return "whether it is a minimum is undecided" if self.kind == "undecided" else ""


@dataclass(frozen=True, eq=False)
class Sides:
    """The k sides near x.

    Attributes
    ----------
    normals : outward, grad a_i (k, n).
    slack, sign : s_i, and +1 for an upper bound, -1 for a lower one (k,).
    constraint : index of the constraint, or behind them of the variable (k,).
    active : whether it blocks a direction; equation : whether it is one of the two sides of an equation (k,).
    """

    normals: np.ndarray
    slack: np.ndarray
    sign: np.ndarray
    constraint: np.ndarray
    active: np.ndarray
    equation: np.ndarray


def optimality(nlp: Nlp, x: np.ndarray, p: np.ndarray, unit: float = 1.0, allowed: float = SAVING) -> Optimality:
    """The conditions at x (physical units) for the parameter p of a step; see `Optimality`.

    `unit` is what differences of the objective are relative to; `allowed` is the `saving` up to which a point counts as
    stationary.
    """
    return _examine(nlp, x, p, unit, allowed)[0]


def descent(nlp: Nlp, x: np.ndarray, p: np.ndarray) -> tuple[np.ndarray, float] | None:
    """Where x is a saddle: the unit direction, in variables over their scales, along which the cost falls most to
    second order, and its curvature w < 0; else None."""
    found, direction = _examine(nlp, x, p, 1.0, SAVING)
    return None if direction is None or found.curvature is None else (direction, found.curvature)


def _examine(
    nlp: Nlp, x: np.ndarray, p: np.ndarray, unit: float, allowed: float
) -> tuple[Optimality, np.ndarray | None]:
    problem = scaled(nlp)
    z, functions = x / problem.scale, _derivatives(problem)
    violation, sides = _sides(nlp, problem, z, p, functions)
    gradient = _gradient(functions, z, p) / unit
    multipliers, residual = fit(gradient, sides)
    mean = max(MEAN_MULTIPLIER, float(multipliers.sum()) / (nlp.g_lower.size + x.size)) / MEAN_MULTIPLIER
    on_g = np.bincount(sides.constraint, sides.sign * multipliers, nlp.g_lower.size + x.size)[: nlp.g_lower.size]
    hessian = np.array(ca.triu2symm(ca.DM(functions["hess_lag"](z, p, 1.0, on_g * unit)))) / unit
    strong = sides.equation | (multipliers > STRONG * multipliers.max(initial=0.0))
    values, saving, zero, _ = _reduced(hessian, residual, sides.normals[strong])
    negative, kind, direction = int((values < -zero).sum()), "minimum", None
    if negative:
        blocked, _, _, direction = _reduced(hessian, residual, sides.normals[strong | sides.active])
        negative = int((blocked < -zero).sum())
        kind = "saddle" if negative else "undecided"
    elif np.any(values <= zero):
        kind = "undecided"
    found = Optimality(
        stationarity=float(np.abs(residual).max()) / mean,
        infeasibility=violation,
        complementarity=float(np.abs(multipliers * sides.slack).max(initial=0.0)) / mean,
        saving=saving,
        curvature=float(values.min()) if values.size else None,
        negative=negative,
        kind=kind,
        unit=unit,
        allowed=allowed,
    )
    return found, direction if kind == "saddle" else None


def last_parameter(nlp: Nlp, x: np.ndarray) -> np.ndarray:
    """The parameter p > 0 of the last step that led to x, (1,).

    The step took it from the point where it began, which is not known any more; taken from x it is off by some per
    mille. So ln p is fitted with the multipliers, within BLUR: grad L(x, lambda, p) = 0 is linear in lambda, and
    Newton's iteration linearises it in ln p.
    """
    problem = scaled(nlp)
    z, functions = x / problem.scale, _derivatives(problem)
    first = nlp.parameter(nlp.steps - 1, x)
    sides, shift = _sides(nlp, problem, z, first, functions)[1], 0.0
    for _ in range(BLUR_STEPS):
        p = first * np.exp(shift)
        gradient = _gradient(functions, z, p)
        slope = (_gradient(functions, z, p * np.exp(BLUR_STEP)) - gradient) / BLUR_STEP
        step = fit(gradient, sides, slope)[0][-2:]
        shift = float(np.clip(shift + step[0] - step[1], -BLUR, BLUR))
    return np.asarray(first * np.exp(shift))


def fit(gradient: np.ndarray, sides: Sides, free: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """Multipliers (k,) that fit best, and grad L (n,); with `free`, a column with a factor of either sign.

    The factor's positive and negative part then stand behind the multipliers.
    """
    columns = sides.normals.T if free is None else np.column_stack([sides.normals.T, free, -free])
    complementary = np.zeros((sides.slack.size, columns.shape[1]))
    np.fill_diagonal(complementary, np.maximum(sides.slack, 0.0))
    matrix = np.vstack([columns, complementary])
    if not matrix.shape[1]:
        return np.zeros(0), gradient
    found = nnls(matrix, np.concatenate([-gradient, np.zeros(sides.slack.size)]))[0]
    return found, gradient + columns @ found


def _derivatives(problem: ScaledNlp) -> dict[str, ca.Function]:
    """The NLP's own derivatives, else CasADi's."""
    if problem.derivatives:
        return problem.derivatives
    given, on = ["x", "p"], {"gamma": ["f", "g"]}
    return {
        "grad_f": problem.oracle.factory("grad_f", given, ["f", "grad:f:x"]),
        "jac_g": problem.oracle.factory("jac_g", given, ["g", "jac:g:x"]),
        "hess_lag": problem.oracle.factory("hess_lag", [*given, "lam:f", "lam:g"], ["triu:hess:gamma:x:x"], on),
    }


def _gradient(functions: dict[str, ca.Function], z: np.ndarray, p: np.ndarray) -> np.ndarray:
    return np.array(functions["grad_f"](z, p)[1]).ravel()


def _sides(
    nlp: Nlp, problem: ScaledNlp, z: np.ndarray, p: np.ndarray, functions: dict[str, ca.Function]
) -> tuple[float, Sides]:
    """Largest violation, and the sides within NEAR of z."""
    g, J = (ca.DM(value) for value in functions["jac_g"](z, p))
    jacobian = sparse.csc_matrix((J.nonzeros(), J.sparsity().row(), J.sparsity().colind()), J.shape)
    normals = sparse.vstack([jacobian, sparse.eye(z.size)]).tocsr()
    values = np.concatenate([np.array(g).ravel(), z])
    lower = np.concatenate([nlp.g_lower, problem.lower])
    upper = np.concatenate([nlp.g_upper, problem.upper])
    found = []
    for sign, bound in ((-1.0, lower), (1.0, upper)):
        finite = np.flatnonzero(np.isfinite(bound))
        slack = sign * (bound - values)[finite]
        width = (upper - lower)[finite]
        width = np.where(np.isfinite(width), width, np.maximum(np.abs(bound[finite]), 1.0))
        slack[width == 0] = 0.0  # an equation: its multiplier may have any value of either sign
        near = slack <= NEAR * width
        slack, width = slack[near], width[near]
        found.append((slack, np.full(slack.size, sign), finite[near], slack <= ACTIVE * width, width == 0))
    slacks, signs, constraint, active, equation = (np.concatenate(parts) for parts in zip(*found, strict=True))
    rows = normals[constraint].multiply(signs[:, None]).toarray()
    return excess(values, lower, upper), Sides(rows, slacks, signs, constraint, active, equation)


def _reduced(
    hessian: np.ndarray, residual: np.ndarray, normals: np.ndarray
) -> tuple[np.ndarray, float, float, np.ndarray | None]:
    """On the null space of the normals: eigenvalues of the Hessian, what a Newton step saves, rounding, and the
    direction of the smallest eigenvalue where that is not positive."""
    if normals.size:
        Q, R, _ = qr(normals.T, pivoting=True)
        diagonal = np.abs(np.diag(R))
        Z = Q[:, int((diagonal > RANK * diagonal[0]).sum()) :]
    else:
        Z = np.eye(hessian.shape[0])
    zero = hessian.shape[0] * np.finfo(float).eps * max(float(np.abs(hessian).max()), np.finfo(float).eps)
    if not Z.shape[1]:
        return np.zeros(0), 0.0, zero, None
    along, curved = Z.T @ residual, Z.T @ hessian @ Z
    values = eigvalsh(curved)
    if values[0] > zero:
        return values, float(along @ solve(curved, along, assume_a="pos") / 2), zero, None
    values, vectors = eigh(curved)
    saving = float(((vectors.T @ along) ** 2 / np.maximum(np.abs(values), zero)).sum() / 2)
    return values, saving, zero, Z @ vectors[:, 0]
