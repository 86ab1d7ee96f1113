"""Scheme e: Radau collocation of the first-order form x' = f(x, tau) with x = (q_A,ind, v_ind, q_M, v_M).

    q_A,ind' = v_ind,   M v_ind' + g = H_A^T C (q_M - q_A),   q_M' = v_M,   M_M v_M' = tau - d_v v_M - C (q_M - q_A)

x is a polynomial on every interval, through its start and its collocation points, the last of which is its end; tau is
free at every point. The other joints are unknowns at the points, tied by the closures. Cost by the Radau quadrature.
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
    """w = (q, v_ind, q_M, v_M, tau, then the rates of q_A,ind, v_ind, q_M, v_M, theta)."""
    s = Symbols(problem)
    q, v, q_M, v_M, tau = (ca.SX.sym(name, k) for name, k in
                           (("q", s.n), ("v", s.delta), ("q_M", s.m), ("v_M", s.m), ("tau", s.m)))  # fmt: skip
    dq, dv, dq_M, dv_M = (ca.SX.sym(name, k) for name, k in
                          (("dq", s.delta), ("dv", s.delta), ("dq_M", s.m), ("dv_M", s.m)))  # fmt: skip
    motor = s.M_M * dv_M + s.d_v * v_M + s.c * (q_M - q[s.at]) - tau
    g = ca.vertcat(s.f["closure_residual"](q), dq - v, s.load(q, v, dv, q_M), dq_M - v_M, motor, s.f["end_effector"](q))
    w = ca.vertcat(q, v, q_M, v_M, tau, dq, dv, dq_M, dv_M, s.theta)
    return stage_functions(w, s.p, s.energy_rate(tau, v_M), g)


class Radau(StageScheme):
    """About `size` collocation points, so many that the window edges are ends of intervals."""

    title = "Radau collocation, 3 points"
    degree = 3

    def __init__(self, problem: Problem, size: int) -> None:
        super().__init__(problem, size)
        mechanism, m, period = problem.actuation.mechanism, problem.actuation.m, problem.cycle.period
        n, delta, d = mechanism.model.nq, mechanism.mobility, self.degree
        intervals = aligned(problem, size / d)
        self.points, h = intervals * d, period / intervals
        tau = np.array(ca.collocation_points(d, "radau"))
        self.t = ((np.arange(intervals)[:, None] + tau) * h).ravel()
        self.each = n + delta + 3 * m
        self.unknowns = m + self.points * self.each
        node = m + np.arange(self.points)[:, None] * self.each + np.arange(self.each)
        states = [*mechanism.independent, *range(n, n + delta + 2 * m)]
        previous = node[np.arange(self.points) // d * d - 1][:, states]  # the interval's start, an end of another
        inside = node.reshape(intervals, d, -1)[:, :, states].reshape(intervals, -1).repeat(d, axis=0)
        theta = np.broadcast_to(np.arange(m), (self.points, m))
        nodal = np.hstack([np.zeros((self.each, 0)), np.eye(self.each)])
        slope = _differentiation(tau) / h  # (d, d + 1)
        k = len(states)
        T = np.zeros((self.points, self.each + k + m, self.each + k * (d + 1) + m))
        T[:, : self.each, : self.each] = nodal
        for j in range(d):
            T[j::d, self.each : self.each + k, self.each : -m] = np.kron(slope[j], np.eye(k))
        T[:, self.each + k :, -m:] = np.eye(m)
        weight = np.tile(_quadrature(tau) * h, intervals)
        zeros = np.zeros((2, self.points, (n - delta) + 2 * delta + 2 * m))
        box = np.concatenate([zeros, window_box(problem, self.t)], axis=2)
        layout = Layout(np.hstack([node, previous, inside, theta]), T, weight)
        self.stages = StageNlp(build(problem), layout, numbers(problem, h), box, None)

    def transfer(self, motion: Motion) -> np.ndarray:
        q, v, q_M, v_M, tau = sampled(self.problem, motion, self.t, ("q", "v", "q_M", "v_M", "tau"))
        v_ind = v[:, self.problem.actuation.mechanism.independent]
        return np.concatenate([np.log(motion.stiffness), np.hstack([q, v_ind, q_M, v_M, tau]).ravel()])

    def motion(self, x: np.ndarray) -> Motion:
        """Through the ends of the intervals, where collocation is most accurate; through all points it is worse."""
        mechanism = self.problem.actuation.mechanism
        q = x[self.problem.actuation.m :].reshape(self.points, -1)[self.degree - 1 :: self.degree, : mechanism.model.nq]
        r_E = np.array(mechanism.functions["end_effector"].map(q.shape[0])(q.T)).T
        return self._through(self.t[self.degree - 1 :: self.degree], r_E, x)


def _lagrange(tau: np.ndarray) -> list[np.poly1d]:
    """Polynomials that are one at one of (0, tau) and zero at the others."""
    nodes = np.concatenate([[0.0], tau])
    return [np.poly1d(np.delete(nodes, i), r=True) / np.prod(x - np.delete(nodes, i)) for i, x in enumerate(nodes)]


def _differentiation(tau: np.ndarray) -> np.ndarray:
    """Slopes of these polynomials at tau, (d, d + 1)."""
    return np.array([p.deriv()(tau) for p in _lagrange(tau)]).T


def _quadrature(tau: np.ndarray) -> np.ndarray:
    """Weights at tau that integrate polynomials of degree d - 1 over (0, 1) exactly."""
    d = tau.size
    return np.linalg.solve(np.vander(tau, d, increasing=True).T, 1 / np.arange(1, d + 1))
