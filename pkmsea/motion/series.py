"""Every quantity of a motion on a dense grid, by the exact flat map."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pkmsea.actuation import Actuation
from pkmsea.actuation.cost import bus_power
from pkmsea.actuation.flat_batch import FlatBatch
from pkmsea.actuation.signals import motor_torque
from pkmsea.kernels import Batch
from pkmsea.mechanism import pose
from pkmsea.motion import turns
from pkmsea.motion.damping import DampedSprings, compliance
from pkmsea.motion.motion import Motion
from pkmsea.motion.periodic import derivative, filtered, frequencies
from pkmsea.motion.poses import Poses, poses_along
from pkmsea.problem import Bound, Problem

POINTS = 4000  # at least, per period; many more than any transcription's grid
PER_MODE = 40  # and at least so many per highest harmonic of the basis


@dataclass(frozen=True, eq=False)
class Series:
    """The whole motion on a dense periodic grid; all arrays (points, ...), SI units.

    `gain` is what each joint has gained after the period (n,), see `pkmsea.motion.turns`.
    """

    t: np.ndarray
    r_E: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    q_M: np.ndarray
    v_M: np.ndarray
    tau: np.ndarray
    u: np.ndarray
    power: np.ndarray
    gain: np.ndarray

    def limited(self, bound: Bound) -> np.ndarray:
        """What a bound of drives or joints limits."""
        of = {"tau": self.tau, "speed": self.v_M, "q": self.q, "dq": self.v, "ddq": self.a}
        return of[bound.quantity][:, bound.index]


def limited_signal(bound: Bound, motion: Motion, t: np.ndarray, s: Series | None) -> np.ndarray:
    """What a bound limits, at the instants t of a series (points,); the end effector's needs no series."""
    if bound.of_end_effector:
        return motion.flat_output(t, bound.order)[:, bound.index]
    assert s is not None
    return s.limited(bound)


def series(problem: Problem, motion: Motion, points: int | None = None) -> Series:
    """Every quantity of a motion by the exact flat map.

    Raises
    ------
    FloatingPointError : the motion leaves the workspace.
    """
    actuation, basis = problem.actuation, motion.basis
    delta = actuation.mechanism.mobility
    count = points or _even(max(POINTS, PER_MODE * basis.modes), basis.size)
    t = np.arange(count) * basis.period / count
    jets = [motion.flat_output(t, d) for d in range(5)]
    Y = np.stack([jet[:, :delta] for jet in jets], axis=1).reshape(count, -1)
    q, gained = _poses(problem, jets[0][:, :delta])
    rate = turns.of_free(actuation, gained) / basis.period
    z = jets[0][:, delta:] + t[:, None] * rate, jets[1][:, delta:] + rate, jets[2][:, delta:]
    Z = np.stack(z, axis=1).reshape(count, -1)
    L = np.zeros((count, 3))
    if actuation.payload is not None:
        L = np.stack([actuation.payload(t, order) for order in range(3)], axis=1)
    k, rest = np.nan_to_num(motion.parallel, nan=1.0).T
    c = np.nan_to_num(motion.stiffness, nan=1.0)
    exact = FlatBatch(actuation.structure, count)
    q_M, v_M, tau, u, v, a = (x.copy() for x in exact(q, Y, Z, c, k, rest, L, actuation.r))
    if damped := DampedSprings(actuation, basis.period, count).drives:
        a_M = np.zeros_like(v_M)
        for i in damped:
            q_M[:, i], v_M[:, i], a_M[:, i] = _damped(actuation, i, basis.period, c[i], q, v, a, u[:, i])
        torque = Batch(motor_torque(actuation.structure), count)(v_M, a_M, u, actuation.r)[0]
        tau[:, damped] = torque[:, damped]
    power = np.asarray(bus_power(tau.T, v_M.T, actuation.each))
    return Series(t, jets[0][:, :delta], q, v, a, q_M, v_M, tau, u, power, gained)


def _damped(
    actuation: Actuation, i: int, period: float, c: float, q: np.ndarray, v: np.ndarray, a: np.ndarray, u: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """q_M, v_M and a_M of a drive whose spring is damped: c e + d_s de/dt = u over one period, by Fourier transform."""
    joint, count = actuation.mechanism.actuated[i], u.size
    e = filtered(compliance(c, actuation.drives[i].damping, frequencies(period, count)), u)[:, None]
    e_1, e_2 = (derivative(e, period, order)[:, 0] for order in (1, 2))
    return q[:, joint] + e[:, 0], v[:, joint] + e_1, a[:, joint] + e_2


def _even(wanted: int, pieces: int) -> int:
    """A number of points that is a multiple of twice the pieces, so that every knot is one of them."""
    return 2 * pieces * -(-wanted // (2 * pieces))


def _poses(problem: Problem, targets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Poses along the path, all on the same side of the inverse-kinematic singularities, and what joints gain."""
    mechanism = problem.actuation.mechanism
    count, n = targets.shape[0], mechanism.model.nq
    along, gained = poses_along(Poses(mechanism, count), targets.T, problem.ranges)
    poses = along.T
    A = Batch(pose.task_system(mechanism), count)(poses)[1]
    signs = np.sign(np.linalg.det(A.reshape(count, n, n)))
    if np.any(signs != signs[0]):
        raise FloatingPointError("the motion crosses a singularity")
    return poses, gained
