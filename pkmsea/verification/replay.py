"""Replays of a result: in short segments from its own states, and over whole cycles with a small feedback."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import count, pairwise

import numpy as np
from scipy.integrate import solve_ivp

from pkmsea.errors import SolveError
from pkmsea.verification.dynamics import Robot
from pkmsea.verification.reference import Reference

SEGMENTS = 40  # per period
CYCLES = 2
INSTANTS = 1999  # per period at which whole cycles are looked at: a prime, so that they are none of the samples
TOLERANCE = 1e-10  # relative, of the explicit integration
STIFF = 2000  # fastest rate of a motor times the period, beyond which it is implicit
STIFF_TOLERANCE = 1e-7  # relative, of the implicit one: tighter, it would follow the rotor's ringing
FLOOR = 1e-12  # absolute [rad, m, s]
EVALUATIONS = 400_000  # of the equations of motion in one go, at most: about half a minute

Rate = Callable[[float, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Trace:
    """Simulated states x at times t [s] with the motor torques tau (samples, m); `feedback` is part of tau."""

    t: np.ndarray
    x: np.ndarray
    tau: np.ndarray
    feedback: np.ndarray


@dataclass(frozen=True, eq=False)
class Feedback:
    """tau_fb = K_p (q_M,ref - q_M) + K_d (v_M,ref - v_M) on every motor.

    K_p = rms(tau) / range(q_M): being off by one hundredth of the motor's range costs one hundredth of the usual
    torque. K_d = K_p T_P / 2 pi. On an elastic drive both are lessened by one factor, where needed, to
    K_d <= sqrt(c M_M), so that the feedback is no faster than the rotor on its spring.
    """

    K_p: np.ndarray
    K_d: np.ndarray

    def torque(self, ahead: np.ndarray, q_M: np.ndarray, v_M: np.ndarray) -> np.ndarray:
        """(..., m) from reference values (tau, q_M, v_M) (..., 3m) and the simulated motors."""
        _, q_ref, v_ref = np.split(ahead, 3, axis=-1)
        return np.asarray(self.K_p * (q_ref - q_M) + self.K_d * (v_ref - v_M))


def feedback_of(robot: Robot, reference: Reference) -> Feedback:
    """The small feedback of a result."""
    w = 2 * np.pi / reference.period
    spread = np.maximum(np.ptp(reference.series["q_M"], axis=0), FLOOR)
    K_d = np.sqrt((reference.series["tau"] ** 2).mean(axis=0)) / spread / w
    K_d = np.minimum(K_d, robot.drives.damped_gain)
    return Feedback(w * K_d, K_d)


def segments(robot: Robot, reference: Reference, number: int = SEGMENTS) -> Trace:
    """`number` pieces of one period, each started from the stored state and driven by the stored torque alone.

    The trace holds, for every stored sample but the first of its segment, what the segment that leads there makes of
    it; at t = 0 that is the end of the last segment. So there is one row per stored sample, in their order.
    """
    K, T, drive = reference.t.size, reference.period, reference.drive
    m = robot.drives.actuation.m
    times = np.append(reference.t, T)
    borders = np.unique(np.linspace(0, K, number + 1).round().astype(int))
    x, stiff = np.empty_like(reference.states), _stiff(robot, reference)
    for a, b in pairwise(borders):
        span = times[a : b + 1]
        found = _integrate(lambda t, x: robot.rate(t, x, drive(t)[:m]), reference.states[a], span, stiff)
        x[np.arange(a + 1, b + 1) % K] = found[1:]
    x[0] -= reference.gain_of_states
    tau = reference.series["tau"]
    return Trace(reference.t, x, tau, np.zeros_like(tau))


def cycles(robot: Robot, reference: Reference, number: int = CYCLES) -> Trace:
    """`number` cycles in one go from the stored state at t = 0, with the small feedback; the edges of rest windows are
    among its instants."""
    drive, feedback, m = reference.drive, feedback_of(robot, reference), robot.drives.actuation.m
    T = reference.period

    def rate(t: float, x: np.ndarray) -> np.ndarray:
        ahead = drive(t)
        return robot.rate(t, x, ahead[:m] + feedback.torque(ahead, *robot.motors(x)))

    edges = [x + k * T for w in reference.problem.cycle.windows for x in (w.start, w.end) for k in range(number + 1)]
    t = np.union1d(np.linspace(0, number * T, number * INSTANTS + 1), [x for x in edges if 0 <= x <= number * T])
    x = _integrate(rate, reference.states[0], t, _stiff(robot, reference))
    ahead = drive(t)
    added = feedback.torque(ahead, *robot.motors(x))
    return Trace(t, x, ahead[:, :m] + added, added)


def _stiff(robot: Robot, reference: Reference) -> bool:
    """Whether the motors are so much faster than the cycle that an implicit method is due."""
    wound = np.abs(reference.series["q_M"] - reference.series["q"][:, robot.at]).max(axis=0)
    return robot.drives.fastest(wound) * reference.period > STIFF


def _integrate(rate: Rate, x: np.ndarray, t: np.ndarray, stiff: bool) -> np.ndarray:
    """States at times t (len(t), len(x))."""
    calls = count()

    def counted(time: float, state: np.ndarray) -> np.ndarray:
        if next(calls) > EVALUATIONS:
            raise SolveError(
                f"The simulation takes more than {EVALUATIONS} evaluations of the equations of motion.",
                "The motion does not follow from its torque, or a spring is too stiff for its rotor.",
            )
        return rate(time, state)

    method, tolerance = ("Radau", STIFF_TOLERANCE) if stiff else ("DOP853", TOLERANCE)
    found = solve_ivp(counted, (t[0], t[-1]), x, method, t_eval=t, rtol=tolerance, atol=FLOOR)
    if not found.success:
        raise SolveError(f"The simulation broke down: {found.message}", "Check the drives and the mechanism.")
    return np.asarray(found.y.T)
