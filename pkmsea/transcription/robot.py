"""The robot on a time grid: flat-output coefficients in; motor torque, speed and joint motion out, with derivatives.

At each grid point the flat output's jet (y, y', y'', z) and theta fix the unknowns xi by the stage equations
(`pkmsea.actuation.equations`), exactly. The motor position's time derivatives come from central differences of
order 8 on the periodic grid, which is several times finer than the flat output can vary.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import sparse

from pkmsea.actuation import NUMBERS, Actuation
from pkmsea.actuation.equations import stage_functions
from pkmsea.mechanism import pose
from pkmsea.transcription.bases import Basis, derivative_weights
from pkmsea.transcription.batch import Batch, close_poses, poses_along
from pkmsea.transcription.cells import make_cells
from pkmsea.transcription.compiled import kernels
from pkmsea.transcription.damping import DampedSprings

HALF_WIDTH = 4  # of the difference stencils: order 8
BISECTIONS = 6  # of the way from the last trajectory to a new one, where Newton does not reach it at once


@dataclass
class State:
    """Everything at one x; the slope of the differentiated signals per cell, once it has been asked for."""

    x: np.ndarray
    q: np.ndarray
    xi: np.ndarray
    w: np.ndarray
    signals: np.ndarray
    outputs: np.ndarray
    slope: np.ndarray | None = None


class RobotOnGrid:
    """Signals at all samples from x = (coefficients of each flat output, variables of the robot's parameters).

    Signals, in order: tau_i and motor speed of each drive, then q, v, a of all joints (2m + 3n). Those of the drives,
    and the `limited` ones of the joints, are differentiated; `differentiated` are their columns.
    """

    def __init__(self, actuation: Actuation, basis: Basis, samples: int, limited: Sequence[int] = ()) -> None:
        self.actuation, self.basis, self.samples = actuation, basis, samples
        mechanism = actuation.mechanism
        self.delta, self.m, self.n = mechanism.mobility, actuation.m, mechanism.model.nq
        self.outputs = self.m  # entries of the flat output: delta + (m - delta)
        self.size = self.outputs * basis.size + len(actuation.parameters)
        self.t = np.arange(samples) * basis.period / samples
        self.cells = make_cells(basis, samples, HALF_WIDTH, whole=bool(actuation.damped))  # deflections have a memory
        self.springs = DampedSprings(actuation, basis.period, samples)
        self.r = actuation.stage_numbers(self.t)
        self.inertia, self.friction, self.coulomb, self.width = (actuation.numbers(key) for key in NUMBERS[:4])
        self.differentiated = [*range(2 * self.m), *limited]
        stage = stage_functions(actuation.shape, tuple(limited))
        functions = (pose.pose_step(mechanism), stage.unknowns, stage.slope, stage.curvature)
        self._pose_step, self._unknowns, self._slope, self._curvature = (
            Batch(function, samples, kernel) for function, kernel in zip(functions, kernels(functions), strict=True)
        )
        self._bases = [sparse.csr_matrix(basis.matrix(self.t, d)) for d in range(3)]
        step = basis.period / samples
        weights = [derivative_weights(k, HALF_WIDTH) / step**k for k in (1, 2)]
        own = self.cells.own.shape[1]
        self._d1, self._d2 = (_circulant(w, samples) for w in weights)  # on the whole periodic grid
        self._local_d1, self._local_d2 = (_banded(w, own) for w in weights)  # from a cell with halo to its own samples
        self._expand = self._expansion()
        self.local = self._local_indices()
        self._signs: tuple[float, float] | None = None
        self._last: tuple[np.ndarray, np.ndarray] | None = None  # x and q that were evaluated last

    def jets(self, x: np.ndarray) -> np.ndarray:
        """w = (y, y', y'', z, p) at all samples."""
        c, p = self.split(x)
        y = [B @ c[:, : self.delta] for B in self._bases]
        z = self._bases[0] @ c[:, self.delta :]
        return np.hstack([*y, z, np.broadcast_to(p, (self.samples, p.size))])

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Coefficients (basis size, flat outputs) and the variables of the parameters."""
        count = self.outputs * self.basis.size
        return x[:count].reshape(self.outputs, -1).T, x[count:]

    def start(self, x: np.ndarray) -> None:
        """Find the poses along a first trajectory; those of the following ones are found from the last."""
        targets = self.jets(x)[:, : self.delta]
        poses = poses_along(self.actuation.mechanism, self._pose_step, targets)
        self._last = x.copy(), poses
        self._signs = None

    def state(self, x: np.ndarray) -> State:
        """Evaluate all signals.

        Raises
        ------
        FloatingPointError : the trajectory leaves the workspace, or crosses a singularity.
        """
        w = self.jets(x)
        q = self._poses(x, w)
        xi, s, A, L = self._unknowns(q, w, self.r)
        signs = tuple(np.sign(np.linalg.det(x.reshape(self.samples, self.n, self.n))) for x in (A, L))
        if self._signs is None:
            self._signs = float(signs[0][0]), float(signs[1][0])
        if any(np.any(found != kept) for found, kept in zip(signs, self._signs, strict=True)):
            raise FloatingPointError("the trajectory crosses a singularity")
        if not np.all(np.isfinite(xi)):
            raise FloatingPointError("the trajectory touches a singularity")
        self._last = x.copy(), q
        return State(x.copy(), q, xi.copy(), w, self._time(s, self.split(x)[1]), s.copy())

    def differentiate(self, state: State) -> np.ndarray:
        """ds/dx of the differentiated signals at each cell's own samples, (cells, r, signals, local variables)."""
        if state.slope is None:
            S = self._slope(state.xi, state.w, self.r)[0]
            state.slope = self._time_local(state, S[self.cells.samples] @ self._expand)
        return state.slope

    def curvature(self, state: State, weights: np.ndarray) -> np.ndarray:
        """Hessian of sum(weights * differentiated signals) per cell, (cells, local, local)."""
        mu = self._time_transposed(state, weights)
        W = self._curvature(state.xi, state.w, self.r, mu)[0]
        own = self._expand[self.cells.halo : self._expand.shape[0] - self.cells.halo]
        right = W[self.cells.own] @ own
        left = own.reshape(-1, own.shape[-1])
        result: np.ndarray = left.T @ right.reshape(right.shape[0], -1, right.shape[-1])
        for i in self.actuation.damped:
            S_u = self._slope(state.xi, state.w, self.r)[0][:, 2 * i + 1]
            u_x = np.einsum("kw,kwl->kl", S_u, own)
            u = state.outputs[:, 2 * i + 1]
            result[0] += self.springs.curvature(i, self.split(state.x)[1], u, u_x, mu[:, 2 * i], self._column(i))
        return result

    def _column(self, i: int) -> int:
        """Local index of the variable ln c of an elastic drive."""
        return self.local.shape[1] - len(self.actuation.parameters) + self.actuation.elastic.index(i)

    def drive_jacobian(self, q: np.ndarray) -> np.ndarray:
        """N_A at all samples, (samples, m, delta): v_A = N_A dr_E/dt."""
        select = np.broadcast_to(np.eye(self.n)[:, self.n - self.delta :], (q.shape[0], self.n, self.delta))
        A = np.array(pose.task_system(self.actuation.mechanism).map(self.samples)(q.T)[1])
        N = np.linalg.solve(A.reshape(self.n, self.samples, self.n).transpose(1, 0, 2), select)
        return np.asarray(N[:, self.actuation.mechanism.actuated])

    def _poses(self, x: np.ndarray, w: np.ndarray) -> np.ndarray:
        if self._last is None:
            raise RuntimeError("call start() with a first trajectory")
        x_from, q = self._last
        w_from, done, step = self.jets(x_from), 0.0, 1.0
        for _ in range(2**BISECTIONS):
            target = w_from + (done + step) * (w - w_from)
            found = close_poses(self._pose_step, q, target[:, : self.delta])
            if found is None:
                step /= 2
                if step < 2.0**-BISECTIONS:
                    break
                continue
            q, done = found, done + step
            if done >= 1.0:
                return q
            step = min(2 * step, 1.0 - done)
        raise FloatingPointError("the trajectory leaves the workspace")

    def _time(self, s: np.ndarray, p: np.ndarray) -> np.ndarray:
        """Signals from stage outputs: tau = M_M q_M'' + d_v q_M' + F(q_M') + u and v_M = q_M' of the elastic drives."""
        result = s.copy()
        for i in self.actuation.elastic:
            q_M, u = s[:, 2 * i], s[:, 2 * i + 1]
            if i in self.actuation.damped:
                q_M = q_M + self.springs.deflection(i, p, u)
            rate = self._d1 @ q_M
            result[:, 2 * i] = self.inertia[i] * (self._d2 @ q_M) + self.friction[i] * rate + u
            result[:, 2 * i] += self.coulomb[i] * np.tanh(rate / self.width[i])
            result[:, 2 * i + 1] = rate
        return result

    def _drag(self, i: int, state: State) -> np.ndarray:
        """Slope of a drive's friction in its speed at all samples."""
        steepness = 1.0 - np.tanh(state.signals[:, 2 * i + 1] / self.width[i]) ** 2
        return self.friction[i] + self.coulomb[i] / self.width[i] * steepness

    def friction_curvature(self, state: State) -> np.ndarray:
        """d^2 F / dv^2 of the elastic drives at all samples, (samples, m); those of rigid drives are in the stage."""
        result = np.zeros((self.samples, self.m))
        for i in self.actuation.elastic:
            tanh = np.tanh(state.signals[:, 2 * i + 1] / self.width[i])
            result[:, i] = -2 * self.coulomb[i] / self.width[i] ** 2 * tanh * (1 - tanh**2)
        return result

    def _time_transposed(self, state: State, weights: np.ndarray) -> np.ndarray:
        result = weights.copy()
        for i in self.actuation.elastic:
            on_tau, on_speed = weights[:, 2 * i], weights[:, 2 * i + 1]
            on_rate = self._drag(i, state) * on_tau + on_speed
            result[:, 2 * i] = self.inertia[i] * (self._d2.T @ on_tau) + self._d1.T @ on_rate
            result[:, 2 * i + 1] = on_tau
            if i in self.actuation.damped:
                result[:, 2 * i + 1] += self.springs.adjoint(i, self.split(state.x)[1], result[:, 2 * i])
        return result

    def _time_local(self, state: State, spread: np.ndarray) -> np.ndarray:
        """The same as `_time`, on the slopes of each cell with its halo; returns the own samples."""
        h, width = self.cells.halo, spread.shape[1]
        result = spread[:, h : width - h].copy()
        for i in self.actuation.elastic:
            q_M, u = spread[:, :, 2 * i], spread[:, h : width - h, 2 * i + 1]
            if i in self.actuation.damped:
                own = self.springs.slope(i, self.split(state.x)[1], state.outputs[:, 2 * i + 1], u[0], self._column(i))
                q_M = q_M + own[self.cells.samples]
            rate, drag = self._local_d1 @ q_M, self._drag(i, state)[self.cells.own]
            result[:, :, 2 * i] = self.inertia[i] * (self._local_d2 @ q_M) + drag[..., None] * rate + u
            result[:, :, 2 * i + 1] = rate
        return result

    def _expansion(self) -> np.ndarray:
        """dw/d(local variables) at a cell's samples, (r + 2h, w, local)."""
        local = self.cells.local
        width, L = local.shape[1:]
        k = self.m - self.delta
        parameters = len(self.actuation.parameters)
        result = np.zeros((width, 3 * self.delta + k + parameters, self.outputs * L + parameters))
        for axis in range(self.delta):
            for d in range(3):
                result[:, d * self.delta + axis, axis * L : (axis + 1) * L] = local[d]
        for j in range(k):
            column = (self.delta + j) * L
            result[:, 3 * self.delta + j, column : column + L] = local[0]
        result[:, 3 * self.delta + k :, self.outputs * L :] = np.eye(parameters)
        return result

    def _local_indices(self) -> np.ndarray:
        """Index into x of each cell's local variables, (cells, local)."""
        size, coefficients = self.basis.size, self.cells.coefficients
        parameters = self.outputs * size + np.arange(len(self.actuation.parameters))
        blocks = [coefficients + output * size for output in range(self.outputs)]
        return np.hstack([*blocks, np.broadcast_to(parameters, (coefficients.shape[0], parameters.size))])


def _circulant(weights: np.ndarray, size: int) -> sparse.csr_matrix:
    half = weights.size // 2
    rows = np.repeat(np.arange(size), weights.size)
    columns = (np.arange(size)[:, None] + np.arange(-half, half + 1)) % size
    return sparse.csr_matrix((np.tile(weights, size), (rows, columns.ravel())), shape=(size, size))


def _banded(weights: np.ndarray, rows: int) -> np.ndarray:
    result = np.zeros((rows, rows + weights.size - 1))
    for i in range(rows):
        result[i, i : i + weights.size] = weights
    return result
