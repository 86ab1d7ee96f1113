"""The drives' numbers and the robot's equations as CasADi expressions, for the stages of the schemes."""

from __future__ import annotations

import casadi as ca
import numpy as np

from pkmsea.actuation.cost import ENERGY, positive
from pkmsea.problem import Problem


class Symbols:
    """The drives' numbers and the robot's equations as CasADi expressions."""

    def __init__(self, problem: Problem) -> None:
        self.mechanism, m = problem.actuation.mechanism, problem.actuation.m
        self.f, self.ind, self.at = self.mechanism.functions, self.mechanism.independent, self.mechanism.actuated
        self.n, self.m, self.delta = self.mechanism.model.nq, m, self.mechanism.mobility
        self.eps, self.step, self.theta = ca.SX.sym("eps"), ca.SX.sym("h"), ca.SX.sym("theta", m)
        self.M_M, self.d_v, self.kappa = ca.SX.sym("M_M", m), ca.SX.sym("d_v", m), ca.SX.sym("kappa", m)
        self.p = ca.vertcat(self.eps, self.step, self.M_M, self.d_v, self.kappa)
        self.c = ca.exp(self.theta)

    def energy_rate(self, tau: ca.SX, v_M: ca.SX) -> ca.SX:
        """Smoothed positive part of the bus power."""
        numbers = [{"copper_loss": kappa} for kappa in ca.vertsplit(self.kappa)]
        return ENERGY.rate(ca.vertsplit(tau), ca.vertsplit(v_M), numbers, self.eps)

    def positive(self, P: ca.SX) -> ca.SX:
        """Smoothed positive part."""
        return positive(P, self.eps)

    def load(self, q: ca.SX, v_ind: ca.SX, a_ind: ca.SX, q_M: ca.SX) -> ca.SX:
        """M a_ind + g - H_A^T C (q_M - q_A)."""
        u = self.c * (q_M - q[self.at])
        return (
            ca.mtimes(self.f["mass_matrix"](q), a_ind)
            + self.f["bias"](q, v_ind)
            - ca.mtimes(self.f["actuation_jacobian"](q).T, u)
        )


def numbers(problem: Problem, step: float) -> np.ndarray:
    """Values of `Symbols.p` without eps."""
    return np.concatenate([[step], *(problem.actuation.numbers(k) for k in ("inertia", "friction", "copper_loss"))])
