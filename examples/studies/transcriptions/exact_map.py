"""Schemes b and d: r_E on one knot per interval, the exact flat map at chosen instants of every interval.

b, the paper's chain: a piecewise constant fifth derivative is a quintic spline; cost at the knots.
d: cost at the Gauss points of every interval.

At every instant q with four derivatives and F = (u, lambda) with two are unknowns. They are tied to r_E by
Psi(q) = (0; r_E), by rnea(q, v, a) = S_A^T u + G^T lambda, and by the time derivatives of both.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from layout import Layout, stage_functions
from nodes import sampled
from scheme import StageScheme
from stages import StageNlp
from symbols import Symbols, numbers

from pkmsea.mechanism import pose
from pkmsea.motion import Motion
from pkmsea.motion.bases import SplineBasis
from pkmsea.problem import Problem
from pkmsea.transcription.windows import linear_rows

ORDERS, FORCES = 5, 3  # of q and F, with their derivatives
POWERS = [*range(ORDERS), *range(FORCES)]
HARMONIC = 6 * np.pi  # the third, in a unit period; derivatives and their equations are scaled by its powers
NEWTON = 8  # steps from q to the start's other unknowns; each makes one more derivative exact


@lru_cache(maxsize=1)
def build(problem: Problem) -> list[ca.Function]:
    """w = (q and F with their derivatives, scaled; r_E with its derivatives; theta)."""
    s, rate = Symbols(problem), HARMONIC / problem.cycle.period
    jets = [ca.SX.sym(f"y{i}", s.delta) for i in range(ORDERS)]
    x = [ca.SX.sym(f"q{i}", s.n) for i in range(ORDERS)]
    F = [ca.SX.sym(f"F{i}", s.n) for i in range(FORCES)]
    now, rates = ca.vertcat(*x[:-1], *F[:-1]), ca.vertcat(*x[1:], *F[1:])
    L = ca.horzcat(ca.SX.eye(s.n)[:, s.at], s.f["closure_jacobian"](x[0]).T)
    poses = [pose.task_system(s.mechanism)(x[0])[0]]
    loads = [s.mechanism.tree.inverse_dynamics(*x[:3]) - ca.mtimes(L, F[0])]
    for equations, count in ((poses, ORDERS), (loads, FORCES)):
        while len(equations) < count:
            equations.append(ca.jtimes(equations[-1], now, rates))
    goals = [ca.vertcat(ca.SX(s.n - s.delta, 1), y) for y in jets]
    ties = [*(e - goal for e, goal in zip(poses, goals, strict=True)), *loads]
    g = ca.vertcat(*(e / rate**i for i, e in zip(POWERS, ties, strict=True)))
    u, du, ddu = (f[: s.m] for f in F)
    v_M = x[1][s.at] + du / s.c
    tau = s.M_M * (x[2][s.at] + ddu / s.c) + s.d_v * v_M + u
    unknown = ca.vertcat(*x, *F)
    scaled = unknown * np.repeat([rate**i for i in POWERS], s.n)
    f, g = ca.substitute([s.energy_rate(tau, v_M), g], [unknown], [scaled])
    return stage_functions(ca.vertcat(unknown, *jets, s.theta), s.p, f, g)


class ExactMap(StageScheme):
    """`size` knots of a spline of some degree, `gauss` evaluations per interval; 0: at the knots."""

    degree, gauss = 5, 0

    def __init__(self, problem: Problem, size: int) -> None:
        super().__init__(problem, size)
        mechanism, m, period = problem.actuation.mechanism, problem.actuation.m, problem.cycle.period
        self.basis, self.head = SplineBasis(period, size, self.degree), mechanism.mobility * size
        at, weight = np.polynomial.legendre.leggauss(self.gauss) if self.gauss else (np.array([-1.0]), np.array([2.0]))
        self.t = ((np.arange(size)[:, None] + (at + 1) / 2) * period / size).ravel()
        self.points, self.own = self.t.size, len(POWERS) * mechanism.model.nq
        self.unknowns = self.head + m + self.points * self.own
        used, jets = self._jets()
        own = self.head + m + np.arange(self.points)[:, None] * self.own + np.arange(self.own)
        T = np.zeros((self.points, self.own + jets.shape[1], self.own + jets.shape[2]))
        T[:, : self.own, : self.own], T[:, self.own :, self.own :] = np.eye(self.own), jets
        layout = Layout(np.hstack([own, used]), T, np.tile(weight / 2 * period / size, size))
        rows = linear_rows(problem, self.basis, self.points, self.unknowns)
        box = np.zeros((2, self.points, self.own))
        self.stages = StageNlp(build(problem), layout, numbers(problem, period / size), box, rows)

    def _jets(self) -> tuple[np.ndarray, np.ndarray]:
        """r_E with derivatives, and theta, from what reaches an instant of x: the indices, and the matrices."""
        basis, m, delta, L = self.basis, self.problem.actuation.m, len(self.problem.span), self.degree + 1
        used = (np.floor(self.t / basis.period * basis.knots + 1e-9).astype(int)[:, None] + np.arange(L)) % basis.knots
        T = np.zeros((self.points, ORDERS * delta + m, delta * L + m))
        for order in range(ORDERS):
            local = np.take_along_axis(basis.matrix(self.t, order), used, axis=1)
            for axis in range(delta):
                T[:, order * delta + axis, axis * L : (axis + 1) * L] = local
        T[:, ORDERS * delta :, delta * L :] = np.eye(m)
        theta = np.broadcast_to(self.head + np.arange(m), (self.points, m))
        return np.hstack([*(used + axis * basis.knots for axis in range(delta)), theta]), T

    def transfer(self, motion: Motion) -> np.ndarray:
        x = np.zeros(self.unknowns)
        x[: self.head] = self._fitted(motion)
        x[self.head : self.head + self.problem.actuation.m] = np.log(motion.stiffness)
        w = self.stages.layout.local(x)
        (q,) = sampled(self.problem, motion, self.t, ("q",))
        w[:, : q.shape[1]] = q
        for _ in range(NEWTON):
            g, slope = self.stages.values(w, 0.0)[:, 1:], self.stages.slopes(w, 1.0)[:, 1:, : self.own]
            w[:, : self.own] -= np.linalg.solve(slope, g[:, :, None])[..., 0]
        x[self.head + self.problem.actuation.m :] = w[:, : self.own].ravel()
        return x

    def motion(self, x: np.ndarray) -> Motion:
        return self._motion(self.basis, x[: self.head].reshape(-1, self.basis.size).T, x)


class KnotSamples(ExactMap):
    title = "power at the knots (paper)"


class Oversampled(ExactMap):
    title = "4 Gauss points per interval"
    gauss = 4
