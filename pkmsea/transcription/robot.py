"""The robot on a time grid: flat-output coefficients in; motor torque, speed and joint motion out, with derivatives.

At each grid point the flat output's jet (y, y', y'', z) and the parameters p fix the unknowns xi by the stage equations
(`pkmsea.actuation.equations`), exactly. The motor position's time derivatives come from central differences of order 8
on the periodic grid, which is several times finer than the flat output can vary. What happens at all instants runs in
the bridge: programs of the vector machine, and the grid that spreads and gathers their derivatives.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pkmsea.actuation.signals import rows
from pkmsea.bridge import _bridge
from pkmsea.mechanism import pose
from pkmsea.motion import Basis, turns
from pkmsea.motion.damping import DampedSprings
from pkmsea.motion.periodic import derivative_weights
from pkmsea.motion.poses import Poses, poses_along
from pkmsea.problem import Problem
from pkmsea.transcription.cells import make_cells
from pkmsea.transcription.instants import Instants

HALF_WIDTH = 4  # of the difference stencils: order 8
BISECTIONS = 6  # of the way from the last trajectory to a new one, where Newton does not reach it at once


class RobotOnGrid:
    """Everything at one x = (coefficients of each flat output, variables of the robot's parameters), at all samples.

    Attributes
    ----------
    instants : the stage equations at the x that `at` was called with last.
    z : what torques, speeds and cost depend on (`pkmsea.actuation.signals`), (rows, samples).
    gain : what each joint gains per period on the trajectory that `start` was called with (n,).
    local : index into x of each cell's local variables, (cells, local).
    """

    def __init__(self, problem: Problem, basis: Basis, samples: int, limited: Sequence[int] = ()) -> None:
        """`limited` are indices of (q, v, a) of all joints that are among the signals."""
        self.actuation = actuation = problem.actuation
        self.basis, self.samples, self._ranges = basis, samples, problem.ranges
        mechanism = actuation.mechanism
        self.delta, self.m, self.n = mechanism.mobility, actuation.m, mechanism.model.nq
        self.outputs = self.m  # entries of the flat output: delta + (m - delta)
        self.size = self.outputs * basis.size + len(actuation.parameters)
        self.t = np.arange(samples) * basis.period / samples
        load = actuation.load(self.t)
        self.instants = Instants(actuation.structure, tuple(2 * self.m + i for i in limited), actuation.r, load)
        self.springs = DampedSprings(actuation, basis.period, samples)
        self.cells = make_cells(basis, samples, HALF_WIDTH, whole=bool(self.springs.drives))  # they have a memory
        self.local = self._local_indices()
        self._of_z = rows(actuation.structure, len(limited))
        self.z = np.zeros((len(self._of_z), samples))
        self._grid = self._make_grid(np.array(self._of_z, np.int32))
        self._poses = Poses(mechanism, samples)
        self._outputs = np.zeros_like(self.instants.s)  # with the deflections of the damped springs
        self.gain = np.zeros(self.n)
        self._sign: dict[str, float] = {}
        self._x = np.full(self.size, np.nan)
        self._sloped = False
        self._last: tuple[np.ndarray, np.ndarray] | None = None  # x and q that were evaluated last

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients (basis size, flat outputs) and the variables of the parameters."""
        count = self.outputs * self.basis.size
        return x[:count].reshape(self.outputs, -1).T, x[count:]

    def start(self, x: np.ndarray) -> None:
        """Find the poses along a first trajectory; those of the following ones are found from the last.

        Raises
        ------
        FloatingPointError : the trajectory leaves the workspace, or a joint gains what it must not.
        """
        q, self.gain = poses_along(self._poses, self._path(x), self._ranges)
        if fault := turns.fault(self.actuation, self._ranges, self.gain):
            raise FloatingPointError(fault)
        self._last = x.copy(), q
        self._sign, self._x = {}, np.full(self.size, np.nan)

    def at(self, x: np.ndarray) -> None:
        """Make x the point of `instants` and `z`.

        Raises
        ------
        FloatingPointError : the trajectory leaves the workspace, or crosses a singularity.
        """
        if np.array_equal(self._x, x):
            return
        self._x, self._sloped = np.full(self.size, np.nan), False
        q, p = self._close(x), self.split(x)[1]
        e = self.instants
        self._grid.spread(x, e.w)
        e.w[3 * self.delta :] += turns.of_free(self.actuation, self.gain)[:, None] * self.t / self.basis.period
        e.p[:], e.xi[: self.n] = p, q
        e.solve()
        for name, factors in e.factors.items():
            kept = self._sign.setdefault(name, float(factors.sign[0]))
            if not np.all(factors.sign == kept):
                raise FloatingPointError("the trajectory crosses a singularity")
        if not np.all(np.isfinite(e.xi)):
            raise FloatingPointError("the trajectory touches a singularity")
        self._outputs[...] = e.s
        for position, i in enumerate(self.springs.drives):
            u = e.s[self.m + i]
            self._outputs[i] += self.springs.deflection(i, p, u)
            numbers = self.springs.kernel(i, p), self.springs.slope(i, p, u)
            self._grid.filter(position, i, self.m + i, self.springs.parameter[i], *numbers)
        self._differentiate()
        self._last, self._x = (x.copy(), q), x.copy()

    def gradient(self, on_z: np.ndarray) -> np.ndarray:
        """Gradient of sum(on_z * z) in x."""
        self._slope()
        result, p = np.zeros(self.size), self.split(self._x)[1]
        weights, on_deflection = self._on_outputs(on_z)
        self._grid.gather(self.instants.S, weights, result)
        for i, weight in on_deflection.items():
            slope = self.springs.slope(i, p, self.instants.s[self.m + i])
            result[self.size - p.size + self.springs.parameter[i]] += weight @ slope
        return result

    def jacobian(self, J: np.ndarray) -> np.ndarray:
        """dh/dx from J = dh/dz (h z, samples), rows (cells, own samples, h, local variables)."""
        self._slope()
        values = np.zeros((*self.cells.own.shape, J.shape[0] // self.z.shape[0], self.local.shape[1]))
        self._grid.jacobian(self.instants.S, J, values)
        return values

    def hessian(self, on_z: np.ndarray, Q: np.ndarray, slots: np.ndarray, count: int) -> np.ndarray:
        """Hessian of a function of z with gradient on_z and Hessian Q (z z, samples): values (count,), to which the
        upper triangle of each cell's block adds at its slots (cells, local, local)."""
        self._slope()
        self.instants.mu[...], on_deflection = self._on_outputs(on_z)
        self.instants.bend()
        p = self.split(self._x)[1]
        for position, (i, weight) in enumerate(on_deflection.items()):
            bend = self.springs.curvature(i, p, self.instants.s[self.m + i], weight)
            self._grid.bend_filter(position, self.springs.mixed(i, p, weight), bend)
        values = np.zeros(count)
        self._grid.hessian(self.instants.S, Q, self.instants.C, slots, values)
        return values

    def drive_jacobian(self, q: np.ndarray) -> np.ndarray:
        """N_A at all samples, (samples, m, delta): v_A = N_A dr_E/dt, from poses q (n, samples)."""
        select = np.broadcast_to(np.eye(self.n)[:, self.n - self.delta :], (self.samples, self.n, self.delta))
        A = np.array(pose.task_system(self.actuation.mechanism).map(self.samples)(q)[1])
        N = np.linalg.solve(A.reshape(self.n, self.samples, self.n).transpose(1, 0, 2), select)
        return np.asarray(N[:, self.actuation.mechanism.actuated])

    def _differentiate(self) -> None:
        """z from the outputs; what a position gains per period is no part of the periodic grid."""
        rate = turns.of_motors(self.actuation, self.gain) / self.basis.period
        turning = [i for i, kind in enumerate(self.actuation.kinds) if kind.sprung and rate[i]]
        for i in turning:
            self._outputs[i] -= rate[i] * self.t
        self._grid.differentiate(self._outputs, self.z)
        for i in turning:
            self.z[[row == i and order == 1 for row, order in self._of_z]] += rate[i]

    def _path(self, x: np.ndarray) -> np.ndarray:
        """The end effector (delta, samples)."""
        w = np.zeros_like(self.instants.w)
        self._grid.spread(x, w)
        return w[: self.delta]

    def _close(self, x: np.ndarray) -> np.ndarray:
        """Poses (n, samples), from the last ones."""
        if self._last is None:
            raise RuntimeError("call start() with a first trajectory")
        x_from, q = self._last
        target = self._path(x)
        found = self._poses.close(q, target)
        if found is not None:
            return found
        begin, done, step = self._path(x_from), 0.0, 0.5
        while step >= 2.0**-BISECTIONS:
            found = self._poses.close(q, begin + (done + step) * (target - begin))
            if found is None:
                step /= 2
                continue
            q, done = found, done + step
            if done >= 1.0:
                return q
            step = min(2 * step, 1.0 - done)
        raise FloatingPointError("the trajectory leaves the workspace")

    def _slope(self) -> None:
        if not self._sloped:
            self.instants.differentiate()
            self._sloped = True

    def _on_outputs(self, on_z: np.ndarray) -> tuple[np.ndarray, dict[int, np.ndarray]]:
        """Weights of the stage's outputs from those of z, and of the deflections of the damped springs."""
        weights, on_deflection, p = np.zeros_like(self.instants.s), {}, self.split(self._x)[1]
        self._grid.differentiate_adjoint(on_z, weights)
        for i in self.springs.drives:
            on_deflection[i] = weights[i].copy()
            weights[self.m + i] += self.springs.adjoint(i, p, on_deflection[i])
        return weights, on_deflection

    def _make_grid(self, rows: np.ndarray) -> _bridge.Grid:
        step = self.basis.period / self.samples
        weights = np.array([derivative_weights(k, HALF_WIDTH) / step**k for k in (1, 2)])
        cells, parameters = self.cells, len(self.actuation.parameters)
        indices = [np.ascontiguousarray(x, np.int32) for x in (cells.coefficients, cells.samples)]
        return _bridge.Grid(
            np.ascontiguousarray(cells.local),
            *indices,
            weights,
            *np.ascontiguousarray(rows.T),
            self.outputs,
            self.delta,
            parameters,
            self.basis.size,
        )

    def _local_indices(self) -> np.ndarray:
        size, coefficients = self.basis.size, self.cells.coefficients
        parameters = self.outputs * size + np.arange(len(self.actuation.parameters))
        blocks = [coefficients + output * size for output in range(self.outputs)]
        return np.hstack([*blocks, np.broadcast_to(parameters, (coefficients.shape[0], parameters.size))])
