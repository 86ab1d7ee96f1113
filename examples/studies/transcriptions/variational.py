"""Scheme f: discrete mechanics, the discrete Lagrange-d'Alembert principle with the midpoint rule (DMOC).

With x = (q, q_M), differences D x and means bar x of an interval of length h, the discrete Lagrangian is

    L_d = h (D q^T M_tree(bar q) D q / (2 h^2) + D q_M^T M_M D q_M / (2 h^2) - (bar q_M - bar q_A)^T C (...) / 2),

and at every node D_2 L_d(before) + D_1 L_d(after) + forces / 2 of both + h G^T lambda = 0, Phi(q) = 0. tau is constant
on each interval, and its power is tau . D q_M / h + kappa tau^2. Without gravity.
(Ober-Bloebaum, Junge, Marsden, 2011)
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np
from layout import Layout, stage_functions
from nodes import aligned, sampled, window_box
from scheme import StageScheme
from stages import StageNlp
from symbols import Symbols, numbers

from pkmsea.motion import Motion
from pkmsea.problem import Problem


@lru_cache(maxsize=1)
def build(problem: Problem) -> list[ca.Function]:
    """w = ((q, q_M) at three nodes, tau on the two intervals between, lambda, theta); all that ends at the middle."""
    s = Symbols(problem)
    nodes = [ca.SX.sym(name, s.n + s.m) for name in ("before", "here", "after")]
    taus = [ca.SX.sym(name, s.m) for name in ("tau_before", "tau_after")]
    lam = ca.SX.sym("lambda", s.n - s.delta)

    def lagrangian(x: ca.SX, y: ca.SX) -> ca.SX:
        rate, mean = (y - x) / s.step, (x + y) / 2
        stretch = mean[s.n :] - mean[s.at]
        kinetic = ca.bilin(s.mechanism.tree.mass_matrix(mean[: s.n]), rate[: s.n], rate[: s.n])
        return s.step / 2 * (kinetic + ca.dot(s.M_M, rate[s.n :] ** 2) - ca.dot(s.c, stretch**2))

    before, here, after = nodes
    speed = [(here[s.n :] - before[s.n :]) / s.step, (after[s.n :] - here[s.n :]) / s.step]
    force = sum(tau - s.d_v * v for tau, v in zip(taus, speed, strict=True)) / 2
    q = here[: s.n]
    balance = ca.gradient(lagrangian(before, here) + lagrangian(here, after), here) / s.step
    balance += ca.vertcat(ca.mtimes(s.f["closure_jacobian"](q).T, lam), force)
    g = ca.vertcat(balance, s.f["closure_residual"](q), s.f["end_effector"](q))
    w = ca.vertcat(*nodes, *taus, lam, s.theta)
    return stage_functions(w, s.p, s.energy_rate(taus[1], speed[1]), g)


class Variational(StageScheme):
    """About `size` intervals, so many that the window edges are nodes."""

    title = "discrete mechanics"

    def __init__(self, problem: Problem, size: int) -> None:
        super().__init__(problem, size)
        mechanism, m, period = problem.actuation.mechanism, problem.actuation.m, problem.cycle.period
        n, delta = mechanism.model.nq, mechanism.mobility
        self.points = K = aligned(problem, size)
        self.t, h = np.arange(K) * period / K, period / K
        each = n + m + m + (n - delta)  # q, q_M, tau of the interval that begins here, lambda
        self.unknowns = m + K * each
        node = m + np.arange(K)[:, None] * each + np.arange(each)
        x, tau, lam = np.split(node, [n + m, n + 2 * m], axis=1)
        index = np.hstack([np.roll(x, 1, axis=0), x, np.roll(x, -1, axis=0), np.roll(tau, 1, axis=0), tau, lam,
                           np.broadcast_to(np.arange(m), (K, m))])  # fmt: skip
        T = np.broadcast_to(np.eye(index.shape[1]), (K, index.shape[1], index.shape[1]))
        box = np.concatenate([np.zeros((2, K, n + m + n - delta)), window_box(problem, self.t)], axis=2)
        layout = Layout(index, T, np.full(K, h))
        self.stages = StageNlp(build(problem), layout, numbers(problem, h), box, None)

    def transfer(self, motion: Motion) -> np.ndarray:
        q, q_M = sampled(self.problem, motion, self.t, ("q", "q_M"))
        (tau,) = sampled(self.problem, motion, self.t + self.t[1] / 2, ("tau",))
        lam = np.zeros((self.points, q.shape[1] - len(self.problem.span)))
        return np.concatenate([np.log(motion.stiffness), np.hstack([q, q_M, tau, lam]).ravel()])

    def motion(self, x: np.ndarray) -> Motion:
        mechanism = self.problem.actuation.mechanism
        q = x[self.problem.actuation.m :].reshape(self.points, -1)[:, : mechanism.model.nq]
        r_E = np.array(mechanism.functions["end_effector"].map(self.points)(q.T)).T
        return self._through(self.t, r_E, x)
