"""Scheme c: motor coordinates as unknowns at the knots of r_E, power from an energy balance between the knots.

r_E is a quintic spline. At every knot q and q_M are unknowns, tied by the closures and the load equation. With central
differences v_M, a_M of q_M at the knots, tau = M_M a_M + d_v v_M + u there. Over an interval, with mean values (bar) of
its two ends and differences D, the drives do the work

    int tau . v_M dt = D(v_M . M_M v_M) / 2 + h bar(v_M . d_v v_M) + bar u . D q_M,

the last term being what the springs and the load have taken up. h bar(kappa tau^2) is lost in copper.
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

JETS = 3  # r_E and two derivatives


@lru_cache(maxsize=1)
def build(problem: Problem) -> list[ca.Function]:
    """w = (r_E, r_E', r_E'', then q, q_M of the knot before, here, of the next and of the one after it, theta)."""
    s = Symbols(problem)
    y, dy, ddy = (ca.SX.sym(name, s.delta) for name in ("y", "dy", "ddy"))
    q = [ca.SX.sym(f"q{i}", s.n) for i in range(4)]
    q_M = [ca.SX.sym(f"q_M{i}", s.m) for i in range(4)]
    here, ahead = 1, 2
    Psi, A = pose.task_system(s.mechanism)(q[here])
    zero = ca.SX(s.n - s.delta, 1)
    v_, v = ca.SX.sym("v", s.n), ca.densify(ca.solve(A, ca.vertcat(zero, dy)))
    gamma = ca.substitute(ca.jtimes(ca.mtimes(A, v_), q[here], v_), v_, v)
    a = ca.solve(A, ca.vertcat(zero, ddy) - gamma)
    g = ca.vertcat(Psi - ca.vertcat(zero, y), s.load(q[here], v[s.ind], a[s.ind], q_M[here]))

    v_M = {k: (q_M[k + 1] - q_M[k - 1]) / (2 * s.step) for k in (here, ahead)}
    u = {k: s.c * (q_M[k] - q[k][s.at]) for k in (here, ahead)}
    tau = {k: s.M_M * (q_M[k + 1] - 2 * q_M[k] + q_M[k - 1]) / s.step**2 + s.d_v * v_M[k] + u[k] for k in (here, ahead)}
    kinetic = {k: ca.dot(s.M_M, v_M[k] ** 2) / 2 for k in (here, ahead)}
    lost = {k: ca.dot(s.d_v, v_M[k] ** 2) + ca.dot(s.kappa, tau[k] ** 2) for k in (here, ahead)}
    stored = kinetic[ahead] - kinetic[here] + ca.dot(u[here] + u[ahead], q_M[ahead] - q_M[here]) / 2
    P = stored / s.step + (lost[here] + lost[ahead]) / 2
    w = ca.vertcat(y, dy, ddy, *(e for pair in zip(q, q_M, strict=True) for e in pair), s.theta)
    return stage_functions(w, s.p, s.positive(P), g)


class EnergyBalance(StageScheme):
    """`size` knots and intervals."""

    title = "lifted, energy balance"
    degree = 5

    def __init__(self, problem: Problem, size: int) -> None:
        super().__init__(problem, size)
        s, m, period = problem.actuation.mechanism, problem.actuation.m, problem.cycle.period
        n, delta = s.model.nq, s.mobility
        self.basis, self.points, self.head = SplineBasis(period, size, self.degree), size, delta * size
        self.t = np.arange(size) * period / size
        each = n + m
        first = self.head + m
        self.unknowns = first + size * each
        knots = first + np.arange(size)[:, None] * each + np.arange(each)
        used = (np.arange(size)[:, None] + np.arange(self.degree)) % size
        index = np.hstack([
            *(used + axis * size for axis in range(delta)), *(np.roll(knots, -k, axis=0) for k in (-1, 0, 1, 2)),
            np.broadcast_to(self.head + np.arange(m), (size, m)),
        ])  # fmt: skip
        local = np.stack([self.basis.matrix(self.t[:1], d)[0, : self.degree] for d in range(JETS)])
        T = np.zeros((size, JETS * delta + 4 * each + m, index.shape[1]))
        T[:, : JETS * delta, : self.degree * delta] = (
            np.kron(local, np.eye(delta))
            .reshape(JETS * delta, self.degree, delta)
            .transpose(0, 2, 1)
            .reshape(JETS * delta, -1)
        )
        T[:, JETS * delta :, self.degree * delta :] = np.eye(4 * each + m)
        box = np.zeros((2, size, n + m))
        rows = linear_rows(problem, self.basis, size, self.unknowns)
        layout = Layout(index, T, np.full(size, period / size))
        self.stages = StageNlp(build(problem), layout, numbers(problem, period / size), box, rows)

    def transfer(self, motion: Motion) -> np.ndarray:
        knots = np.hstack(sampled(self.problem, motion, self.t, ("q", "q_M")))
        return np.concatenate([self._fitted(motion), np.log(motion.stiffness), knots.ravel()])

    def motion(self, x: np.ndarray) -> Motion:
        return self._motion(self.basis, x[: self.head].reshape(-1, self.basis.size).T, x)
