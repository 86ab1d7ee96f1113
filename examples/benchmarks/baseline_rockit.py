"""The two-arm elastic robot in rockit: the paper's formulation, and the best one that we could write.

Both hold r_E as a chain of five integrators with piecewise constant input on N intervals (multiple shooting, one RK4
step each), periodic, with the windows and limits at the N samples, from the same first guess as pkmsea.
The positive part of the power is p >= P, p >= 0.

paper:  tau and P as one expression of r_E and its four derivatives, and of c.
lifted: q_M as another chain, up to its jerk, tied to r_E by the load equation; expanded to scalar operations.
"""

from __future__ import annotations

import casadi as ca
import numpy as np
import ours
from rockit import MultipleShooting, Ocp

BASES = ((0.0, 0.2309401077), (-0.2, -0.1154700538))  # of arms A and B [m], as in urdf/pkm_2rrr
SIGNS, LENGTH = (1, -1), 0.2  # working modes; length of every link [m]
DEPTH = 5  # integrators of r_E
HARMONIC = 3  # whose frequency scales the derivatives
EDGE = 1e-9  # a sample on a window's edge is inside


class Baseline:
    """One formulation as an `Ocp`; y are the states of r_E; c and P are expressions."""

    def __init__(self, posed: ours.Problem, guess: ours.Motion, samples: int, lifted: bool) -> None:
        self.posed, self.N, self.T, self.m = posed, samples, posed.cycle.period, posed.actuation.m
        self.inertia, self.friction = (posed.actuation.numbers(name) for name in ("inertia", "friction"))
        self.torque, self.load = stage_functions(posed)
        self.ocp = Ocp(T=self.T)
        w = 2 * np.pi * HARMONIC / self.T
        t = np.arange(samples + 1) * self.T / samples
        jets = [guess.flat_output(t, d).T for d in range(DEPTH)]
        self.y = self._chain(posed.span[0], w, jets)
        theta = self.ocp.variable(self.m)
        self.c = ca.exp(theta)
        low, high = np.array([parameter.bounds for parameter in posed.actuation.parameters]).T
        self.ocp.subject_to(low <= (theta <= high))
        self.ocp.set_initial(theta, np.log(guess.stiffness))
        first = ours.series(posed, guess, samples)
        tau, self.P = self._motor(first, w) if lifted else self.torque(ca.vertcat(*self.y), self.c)
        self._cost(tau, first.power)
        self._windows()
        self.ocp.method(MultipleShooting(N=samples, M=1, intg="rk"))

    def _chain(self, size: float, w: float, jets: list[np.ndarray]) -> list[ca.MX]:
        """A periodic chain of integrators with its first guess."""
        ocp, rows = self.ocp, jets[0].shape[0]
        states = [ocp.state(rows, scale=size * w**d) for d in range(len(jets))]
        last = ocp.control(rows, scale=size * w ** len(jets))
        for state, rate, values in zip(states, [*states[1:], last], jets, strict=True):
            ocp.set_der(state, rate)
            ocp.subject_to(ocp.at_t0(state) == ocp.at_tf(state))
            ocp.set_initial(state, values)
        ocp.set_initial(last, np.diff(jets[-1]) * self.N / self.T)
        return states

    def _motor(self, first: ours.Series, w: float) -> tuple[ca.MX, ca.MX]:
        """tau and P with q_M lifted: its chain, tied to r_E by the load equation."""
        a_M = (first.tau - first.u - self.friction * first.v_M) / self.inertia
        jets = [np.vstack([values, values[:1]]).T for values in (first.q_M, first.v_M, a_M)]
        q_M, v_M, a_M = self._chain(1.0, w, jets)
        q_A, u = self.load(ca.vertcat(*self.y[:3]))
        spring = self.c * (q_M - q_A)
        self.ocp.subject_to(spring == u, include_last=False)
        tau = self.inertia * a_M + self.friction * v_M + spring
        return tau, ca.dot(tau, v_M) + ca.dot(self.posed.kappa, tau**2)

    def _cost(self, tau: ca.MX, power: np.ndarray) -> None:
        """p >= P, p >= 0 and the limits as one constraint: rockit evaluates each of them anew."""
        ocp, p, bounds = self.ocp, self.ocp.control(), self.posed.bounds
        values = ca.vertcat(p - self.P, p, *[tau[bound.index] for bound in bounds])
        lower = ca.DM([0.0, 0.0, *[bound.lower for bound in bounds]])
        upper = ca.DM([np.inf, np.inf, *[bound.upper for bound in bounds]])
        ocp.subject_to(lower <= (values <= upper), include_last=False)
        ocp.set_initial(p, np.maximum(power, 0))
        ocp.add_objective(ocp.sum(p) * self.T / self.N)

    def _windows(self) -> None:
        """As path constraints that are void outside the windows."""
        for window in self.posed.cycle.windows:
            middle, half = (window.start + window.end) / 2, (window.end - window.start) / 2
            turn = 2 * np.pi / self.T
            inside = ca.cos(turn * (self.ocp.t - middle)) >= np.cos(turn * (half + EDGE))
            away = ca.if_else(inside, self.y[0][window.axis] - window.at, 0)
            self.ocp.subject_to(-window.deviation <= (away <= window.deviation), include_last=False)


def stage_functions(posed: ours.Problem) -> tuple[ca.Function, ca.Function]:
    """Stage functions with the closed-form inverse kinematics put in.

    torque: (r_E and four derivatives, c) -> tau, P;  load: (r_E and two derivatives) -> q_A, u.
    """
    exact, none, numbers = ours.exact_map(posed)
    Y, c = ca.SX.sym("Y", 2 * DEPTH), ca.SX.sym("c", 2)
    q = inverse_kinematics(Y[:2])
    _, v_M, tau, u, *_ = exact(q, ca.reshape(Y, 2, DEPTH), ca.SX(0, 3), c, none, none, ca.SX(1, 3), numbers)
    power = ca.dot(tau, v_M) + ca.dot(posed.kappa, tau**2)
    lean = {"cse": True}  # common subexpressions once
    torque = ca.Function("torque", [Y, c], [tau, power], ["Y", "c"], ["tau", "P"], lean)
    return torque, ca.Function("load", [Y[:6]], [q[::2], u], ["Y"], ["q_A", "u"], lean)


def inverse_kinematics(r_E: ca.SX) -> ca.SX:
    """Joints A, elbow_A, B, elbow_B: phi_i + s_i acos(r_i / 2 l) with r_i, phi_i from base i to r_E."""
    joints = []
    for base, sign in zip(BASES, SIGNS, strict=True):
        x, y = r_E[0] - base[0], r_E[1] - base[1]
        half = sign * ca.acos(ca.sqrt(x**2 + y**2) / (2 * LENGTH))
        joints += [ca.atan2(y, x) + half, -2 * half]
    return ca.vertcat(*joints)
