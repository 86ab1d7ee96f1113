"""Everything that a simulated motion shows: end effector, drives, power, loops, mechanical energy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pkmsea.actuation import Actuation
from pkmsea.problem import Cost
from pkmsea.verification.dynamics import Robot
from pkmsea.verification.replay import Trace


@dataclass(frozen=True, eq=False)
class Observed:
    """Quantities along a trace; arrays (samples, ...), SI units.

    Attributes
    ----------
    r_E, dr_E, ddr_E : end effector and its derivatives.
    q, v, a, q_M, v_M, u, tau : joints and drives; `u` acts on the joints.
    power : bus power P = sum of tau v_M + kappa tau^2.
    supplied : power of the motors less that of friction, dampers and payload.
    closure : largest closure residual [m, rad].
    mechanical : kinetic and potential energy of tree, rotors and springs.
    """

    t: np.ndarray
    r_E: np.ndarray
    dr_E: np.ndarray
    ddr_E: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    q_M: np.ndarray
    v_M: np.ndarray
    u: np.ndarray
    tau: np.ndarray
    power: np.ndarray
    supplied: np.ndarray
    closure: np.ndarray
    mechanical: np.ndarray

    def cost(self, cost: Cost, actuation: Actuation, at: slice) -> float:
        """Value of a cost over a part of the trace, by the trapezoidal rule."""
        rates = cost.exact(self.tau[at].T, self.v_M[at].T, actuation.each)
        steps = np.diff(self.t[at])
        return cost.value(rates, (np.append(steps, 0.0) + np.append(0.0, steps)) / 2)


def observe(robot: Robot, trace: Trace) -> Observed:
    """Look at every instant of a trace."""
    drives = robot.drives
    q, v, _, _ = robot.split(trace.x)
    q_M, v_M = robot.motors(trace.x)
    rates = np.array([robot.rate(*each) for each in zip(trace.t, trace.x, trace.tau, strict=True)])
    a = robot.split(rates)[1]
    E = np.array([robot.end_effector(*state) for state in zip(q, v, a, strict=True)])
    loops = (robot.loops.at(robot.data, *state) for state in zip(q, v, strict=True))
    closure = np.array([np.abs(constraint.Phi).max(initial=0.0) for constraint in loops])
    friction = drives.friction(v_M)
    rigid = trace.tau - drives.inertia * a[:, robot.at] - friction
    slip = v_M - v[:, robot.at]
    u = drives.forces(q_M - q[:, robot.at], slip, rigid)
    kappa = drives.actuation.numbers("copper_loss")
    power = (trace.tau * v_M + kappa * trace.tau**2).sum(axis=1)
    carried = [robot.payload_power(*each) for each in zip(trace.t, q, v, a, strict=True)]
    supplied = ((trace.tau - friction) * v_M - drives.damping * slip**2).sum(axis=1) - carried
    mechanical = np.array([robot.energy(x) for x in trace.x])
    return Observed(
        trace.t, E[:, 0], E[:, 1], E[:, 2], q, v, a, q_M, v_M, u, trace.tau, power, supplied, closure, mechanical
    )
