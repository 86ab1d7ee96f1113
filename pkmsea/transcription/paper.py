"""The paper's own transcription: the flat torque map at 200 samples, sampled power, derivatives left to CasADi.

With a chain (paper, section 4.3): r_E as a chain of integrators up to the 5th derivative, a free drive's q_M up to the
3rd, piecewise constant inputs, RK4 multiple shooting. With a Fourier series (section 3): its coefficients instead.
Rest windows hold at the samples that fall into them. Poses q are unknowns tied to r_E by the closures, which stands
for the paper's analytical inverse kinematics. It is kept as the baseline; the default is faster and truer.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from pkmsea.actuation.cost import ENERGY, bus_power, positive
from pkmsea.actuation.flat_map import flat_map_of_columns
from pkmsea.errors import InputError
from pkmsea.mechanism import pose
from pkmsea.motion import Basis
from pkmsea.motion.bases import BASES, SplineBasis, make_basis
from pkmsea.motion.motion import Motion
from pkmsea.problem import Problem
from pkmsea.transcription import guess
from pkmsea.transcription.base import Transcription
from pkmsea.transcription.nlp import Nlp, Variable
from pkmsea.transcription.robot import RobotOnGrid

SAMPLES = 200
DEGREE = 5  # a piecewise constant fifth derivative is a quintic spline
DEPTHS = (5, 3)  # integrators of r_E and of a free drive's coordinate
EDGE = 1e-9  # [s]; a sample on a window's edge is inside


@dataclass
class _Rows:
    """Constraints as they are collected: expressions with bounds."""

    expressions: list[ca.MX]
    lower: list[np.ndarray]
    upper: list[np.ndarray]

    def add(self, expression: ca.MX, lower: float, upper: float) -> None:
        column = ca.vec(expression)
        self.expressions.append(column)
        self.lower.append(np.full(column.numel(), lower))
        self.upper.append(np.full(column.numel(), upper))


class PaperTranscription(Transcription):
    """Unknowns: chain states and inputs (or Fourier coefficients), ln c, poses q, and p_k >= max(P_k, 0)."""

    quick = False

    def __init__(self, problem: Problem) -> None:
        super().__init__(problem)
        _refuse_extras(problem)
        options, period = problem.options, problem.cycle.period
        self.samples = options.samples or SAMPLES
        self.chain = options.trajectory.kind not in BASES
        self.basis: Basis = (
            SplineBasis(period, self.samples, DEGREE) if self.chain else make_basis(options.trajectory, period)
        )
        self.size = self.basis.size
        self.t = np.arange(self.samples) * period / self.samples
        self.robot = RobotOnGrid(problem.actuation, self.basis, self.samples)
        self.delta, self.m = self.robot.delta, self.robot.m
        self._build()

    def _build(self) -> None:
        actuation, K = self.problem.actuation, self.samples
        outputs = self.m
        rows = _Rows([], [], [])
        self._shapes: dict[str, tuple[int, int]] = {}
        unknowns: dict[str, ca.MX] = {}

        def unknown(name: str, *structure: int) -> ca.MX:
            self._shapes[name] = (structure[0], structure[1])
            unknowns[name] = ca.MX.sym(name, *structure)
            return unknowns[name]

        if self.chain:
            jets = [self._integrate(unknown, rows, j) for j in range(outputs)]
        else:
            coefficients = unknown("coefficients", self.basis.size, outputs)
            matrices = [ca.DM(self.basis.matrix(self.t, d)) for d in range(DEPTHS[0])]
            jets = [ca.horzcat(*[B @ coefficients[:, j] for B in matrices[: self._depth(j)]]).T for j in range(outputs)]
        theta = unknown("theta", max(len(actuation.parameters), 1), 1)
        q = unknown("q", self.robot.n, K)
        p = unknown("p", 1, K)

        c = ca.MX.ones(self.m)
        for j, parameter in enumerate(actuation.parameters):
            c[parameter.drive] = ca.exp(theta[j])
        Y = ca.vertcat(*[jets[j][d, :] for d in range(DEPTHS[0]) for j in range(self.delta)])
        Z = ca.vertcat(*[jets[j][d, :] for d in range(DEPTHS[1]) for j in range(self.delta, outputs)])
        torque = self._flat_torque().map(K)
        tau, speed, v, a = torque(q, Y, Z, ca.repmat(c, 1, K))
        Psi = pose.task_system(actuation.mechanism).map(K)(q)[0]
        P = bus_power(ca.vertsplit(tau), ca.vertsplit(speed), actuation.each)
        closures = self.robot.n - self.delta
        rows.add(Psi[:closures, :], 0.0, 0.0)
        rows.add(Psi[closures:, :] - Y[: self.delta, :], 0.0, 0.0)
        rows.add(p - P, 0.0, np.inf)
        self._window_rows(rows, Y)
        self._limit_rows(rows, {"tau": tau, "speed": speed, "q": q, "dq": v, "ddq": a, "Y": Y})
        x = ca.vertcat(*[ca.vec(e) for e in unknowns.values()])
        weight = self.problem.cycle.period / K
        self._oracle = ca.Function(
            "nlp", [x, ca.MX.sym("p", 1)], [weight * ca.sum2(p), ca.vertcat(*rows.expressions)], ["x", "p"], ["f", "g"]
        )
        self._power = ca.Function("power", [x], [P])
        self._position = ca.Function("position", [x], [ca.vertcat(*[jet[0, :] for jet in jets])])
        self._lower, self._upper = np.concatenate(rows.lower), np.concatenate(rows.upper)

    def _depth(self, output: int) -> int:
        return DEPTHS[0] if output < self.delta else DEPTHS[1]

    def _integrate(self, unknown, rows: _Rows, j: int) -> ca.MX:
        """One chain of integrators with RK4 steps, periodic; returns its states (depth, K)."""
        depth, K = self._depth(j), self.samples
        state, rate = unknown(f"chain_{j}", depth, K), unknown(f"input_{j}", 1, K)
        shift = ca.DM(np.eye(depth, k=1))
        last = ca.DM(np.eye(depth)[:, -1:])
        h = self.problem.cycle.period / K

        def f(s: ca.MX) -> ca.MX:
            return shift @ s + last @ rate

        k1 = f(state)
        k2 = f(state + h / 2 * k1)
        k3 = f(state + h / 2 * k2)
        k4 = f(state + h * k3)
        step = state + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        following = ca.horzcat(state[:, 1:], state[:, 0])
        rows.add((following - step) / ca.repmat(ca.DM(self._chain_scale(j, depth)), 1, K), 0.0, 0.0)
        return state

    def _chain_scale(self, j: int, depth: int) -> np.ndarray:
        """Typical size of each state of a chain: the span times powers of the base frequency's third harmonic."""
        span = self.problem.span[j] if j < self.delta else 1.0
        return span * (6 * np.pi / self.problem.cycle.period) ** np.arange(depth)

    def _flat_torque(self) -> ca.Function:
        """(q, Y, Z, c) -> tau, v_M, v, a with Y and Z as columns and the drives' numbers in place."""
        actuation = self.problem.actuation
        exact = flat_map_of_columns(actuation.structure)
        q, Y, Z, c = (ca.SX.sym(name, exact.numel_in(i)) for i, name in enumerate(("q", "Y", "Z", "c")))
        none, mass = ca.DM.zeros(self.m), ca.DM.zeros(1, 3)
        out = exact(q, Y, Z, c, none, none, mass, ca.DM(actuation.r))
        return ca.Function("flat_torque", [q, Y, Z, c], [out[2], out[1], out[4], out[5]])

    def _window_rows(self, rows: _Rows, Y: ca.MX) -> None:
        period = self.problem.cycle.period
        for w in self.problem.cycle.windows:
            away = (self.t - (w.start + w.end) / 2 + period / 2) % period - period / 2
            inside = np.flatnonzero(np.abs(away) <= (w.end - w.start) / 2 + EDGE)
            if inside.size == 0:
                inside = np.array([np.abs(away).argmin()])
            rows.add(Y[w.axis, inside.tolist()], w.at - w.deviation, w.at + w.deviation)

    def _limit_rows(self, rows: _Rows, signals: dict[str, ca.MX]) -> None:
        for bound in self.problem.bounds:
            if bound.of_end_effector:
                signal = signals["Y"][bound.order * self.delta + bound.index, :]
            else:
                signal = signals[bound.quantity][bound.index, :]
            rows.add(signal, bound.lower, bound.upper)

    def start(self, rng: np.random.Generator | None) -> np.ndarray:
        flat = guess.start(self.problem, self.robot, rng)
        self.robot.start(flat)
        coefficients, theta = self.robot.split(flat)
        parts: dict[str, np.ndarray] = {"theta": theta if theta.size else np.zeros(1)}
        self.robot.at(flat)
        parts["q"] = self.robot.instants.xi[: self.robot.n]
        if self.chain:
            for j in range(self.m):
                jet = np.array([self.basis.matrix(self.t, d) @ coefficients[:, j] for d in range(self._depth(j))])
                mean_rate = (np.roll(jet[-1:], -1, axis=1) - jet[-1:]) / self.t[1]
                parts[f"chain_{j}"], parts[f"input_{j}"] = jet, mean_rate
        else:
            parts["coefficients"] = coefficients
        parts["p"] = np.zeros((1, self.samples))
        x = self._stack(parts)
        parts["p"] = positive(np.array(self._power(x)))
        return self._stack(parts)

    def _stack(self, parts: dict[str, np.ndarray]) -> np.ndarray:
        return np.concatenate([np.asarray(parts[name], float).ravel(order="F") for name in self._shapes])

    def _parts(self, x: np.ndarray) -> dict[str, np.ndarray]:
        sizes = [rows * columns for rows, columns in self._shapes.values()]
        pieces = np.split(x, np.cumsum(sizes)[:-1])
        return {
            name: piece.reshape(structure, order="F")
            for (name, structure), piece in zip(self._shapes.items(), pieces, strict=True)
        }

    def nlp(self, x: np.ndarray, limited: Collection[str] = (), seen: Sequence[np.ndarray] = ()) -> Nlp:
        # it holds all limits, at its samples
        variables = []
        for name, values in self._parts(x).items():
            flat = values.ravel(order="F")
            lower, upper = np.full(flat.size, -np.inf), np.full(flat.size, np.inf)
            if name == "p":
                lower[:] = 0.0
            if name == "theta" and self.problem.actuation.parameters:
                lower, upper = np.array([p.bounds for p in self.problem.actuation.parameters]).T
            elif name == "theta":
                lower, upper = np.zeros(1), np.zeros(1)
            variables.append(Variable(name, lower, upper, np.ones(flat.size), flat))
        return Nlp(tuple(variables), self._lower, self._upper, self._oracle, 1, lambda step, x: np.zeros(1))

    def claimed(self, x: np.ndarray) -> float:
        rates = positive(np.array(self._power(x)))
        return self.problem.cost.value(rates, self.problem.cycle.period / self.samples)

    def motion(self, x: np.ndarray) -> Motion:
        parts = self._parts(x)
        if self.chain:
            coefficients = self.basis.fit(self.t, np.array(self._position(x)).T)
        else:
            coefficients = parts["coefficients"].copy()
        actuation = self.problem.actuation
        return Motion.of(actuation, self.basis, coefficients, parts["theta"].ravel()[: len(actuation.parameters)])


def _refuse_extras(problem: Problem) -> None:
    """The paper's transcription knows neither parallel springs nor damped ones, no payload, no other cost."""
    structure = problem.actuation.structure
    damped = any(kind.remembers for kind in structure.kinds)
    another = problem.cost != ENERGY
    present = {"cost": another, "parallel": structure.parallel, "damping": damped, "payload": structure.payload}
    for key, found in present.items():
        if found:
            raise InputError(f"The paper's transcription has no {key}.", "Use options.transcription: flat.", key=key)
