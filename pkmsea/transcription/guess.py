"""First trajectories: smooth paths through the rest windows, straight or with random detours."""

from __future__ import annotations

import numpy as np

from pkmsea.actuation.equations import free_coordinates
from pkmsea.kernels import Batch
from pkmsea.motion import Basis, turns
from pkmsea.motion.bases import SplineBasis
from pkmsea.problem import Problem
from pkmsea.transcription.robot import RobotOnGrid
from pkmsea.transcription.windows import window_times

DETOUR = 0.25  # standard deviation of a random detour, relative to the task's span
HARMONICS = (3, 6)  # of a random detour, one of them per start: each finds valleys that the other seldom finds
INTERNAL = 4.0  # size of a random internal load, relative to the drives' largest force on the path
COARSE_KNOTS, COARSE_DEGREE = 24, 5  # paths are shaped on few knots and then fitted


def path(problem: Problem, basis: Basis, rng: np.random.Generator | None) -> np.ndarray:
    """Coefficients (basis size, delta) of a path that rests at the operating points.

    Between the rests it has the least integral of the squared jerk's distance to a random low harmonic (zero where
    `rng` is None).
    """
    coarse = SplineBasis(problem.cycle.period, COARSE_KNOTS, COARSE_DEGREE)
    period = problem.cycle.period
    fine = np.arange(8 * COARSE_KNOTS) * period / (8 * COARSE_KNOTS)
    jerk = coarse.matrix(fine, 3)
    harmonics = int(rng.choice(HARMONICS)) if rng is not None else 0
    samples = np.empty((fine.size, len(problem.cycle.points[0].at)))
    for axis in range(samples.shape[1]):
        windows = [w for w in problem.cycle.windows if w.axis == axis]
        times = [window_times(w, period / COARSE_KNOTS) for w in windows]
        at = np.concatenate([np.full(t.size, w.at) for t, w in zip(times, windows, strict=True)])
        wish = np.zeros(fine.size)
        if rng is not None:
            detour = _detour(rng, fine, period, harmonics) * DETOUR * problem.span[axis]
            wish = jerk @ coarse.fit(fine, detour)
        rows = np.vstack([1e-4 * jerk * period**3, 1e3 * coarse.matrix(np.concatenate(times))])
        right = np.concatenate([1e-4 * wish * period**3, 1e3 * at])
        samples[:, axis] = coarse.matrix(fine) @ np.linalg.lstsq(rows, right, rcond=None)[0]
    dense = np.arange(4 * basis.size) * period / (4 * basis.size)
    knots = coarse.matrix(dense) @ coarse.fit(fine, samples)
    return basis.fit(dense, knots)


def _detour(rng: np.random.Generator, t: np.ndarray, period: float, harmonics: int) -> np.ndarray:
    order = np.arange(1, harmonics + 1)
    phase = 2 * np.pi / period * np.outer(t, order)
    amplitude = rng.normal(size=(2, harmonics)) / order
    return np.asarray(np.sin(phase) @ amplitude[0] + np.cos(phase) @ amplitude[1])


def start(problem: Problem, robot: RobotOnGrid, rng: np.random.Generator | None) -> np.ndarray:
    """A whole first x: a path, parameters within their bounds, and free drives that carry their share of the load.

    With `rng` also a random internal load; without it, the plain path and the middle of the bounds (of stiffnesses,
    in the logarithm).

    Raises
    ------
    FloatingPointError : the path leaves the workspace, or crosses a singularity.
    """
    low, high = np.array([parameter.bounds for parameter in problem.actuation.parameters]).reshape(-1, 2).T
    p = (low + high) / 2 if rng is None else rng.uniform(low, high)
    coefficients = np.zeros((robot.basis.size, robot.outputs))
    coefficients[:, : robot.delta] = path(problem, robot.basis, rng)
    x = np.concatenate([coefficients.T.ravel(), p])
    robot.start(x)
    robot.at(x)
    if problem.actuation.free:
        coefficients[:, robot.delta :] = _shared_load(problem, robot, x, rng)
        x = np.concatenate([coefficients.T.ravel(), p])
    return x


def _shared_load(problem: Problem, robot: RobotOnGrid, x: np.ndarray, rng: np.random.Generator | None) -> np.ndarray:
    """Coefficients of z for which the drives' forces have the least norm: u = N_A (N_A^T N_A)^-1 N_A^T u.

    With `rng`, random low harmonics add to the free drives' forces; the load equation makes them internal.
    """
    actuation = problem.actuation
    m, n = robot.m, robot.n
    q, v, a, forces = np.split(robot.instants.xi.T, [n, 2 * n, 3 * n], axis=1)
    u = np.empty((q.shape[0], m))
    u[:, [*actuation.free, *actuation.structure.dependent]] = forces[:, :m]
    N_A = robot.drive_jacobian(q.T)
    share = (N_A @ np.linalg.pinv(N_A) @ u[:, :, None])[..., 0]
    if rng is not None:
        size = INTERNAL * np.abs(share).max()
        for i in actuation.free:
            share[:, i] += size * _detour(rng, robot.t, robot.basis.period, max(HARMONICS))
    p = robot.split(x)[1]
    z = Batch(free_coordinates(actuation.structure), robot.samples)(q, v, a, share, p, actuation.r)[0]
    return robot.basis.fit(robot.t, z - np.outer(robot.t, turns.of_free(actuation, robot.gain)) / robot.basis.period)
