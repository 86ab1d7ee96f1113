"""The audit: a motion checked on a dense grid by the exact flat map, independent of the transcription."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pkmsea.actuation import Actuation
from pkmsea.actuation.cost import ENERGY, Cost, bus_power
from pkmsea.actuation.flat_batch import FlatBatch
from pkmsea.actuation.signals import losses, motor_torque
from pkmsea.errors import one_line
from pkmsea.kernels import Batch
from pkmsea.mechanism import pose
from pkmsea.problem import Bound, Problem
from pkmsea.transcription import Motion
from pkmsea.transcription.damping import DampedSprings, compliance, derivative, filtered, frequencies
from pkmsea.transcription.poses import Poses, poses_along

POINTS = 4000  # at least, per period; many more than any transcription's grid
PER_MODE = 40  # and at least so many per highest harmonic of the basis
PER_WINDOW = 400  # points per rest window, edges included
BETWEEN_SINGULAR = 10  # grid points from one look at the distance to singularities to the next
BALANCE = 1e-6  # largest relative residual of the power balance
CLOSURE = 1e-8  # largest closure residual [m]
WINDOW_EXCESS = 1e-9  # rounding, in a window's own units [m]
LIMIT_EXCESS = 1e-6  # rounding, relative to a limit's size
IDLE = 1e-3  # share of the mechanical turnover below which an energy counts as zero


@dataclass(frozen=True, repr=False)
class Audit:
    """What the dense grid says about a motion; `faults` is empty for a verified one.

    Attributes
    ----------
    energy : value of the cost, by default the integral of max(P, 0) over one period [J]; the truth.
    claimed : the transcription's own value.
    scale : what differences of values are relative to: the value, or, of an energy, IDLE of the drives' turnover if
        that is more.
    gap : |claimed - energy| / scale.
    closure : largest closure residual [m].
    window : largest excess over a rest window at any instant [m]; zero or negative if kept.
    limits : relative excess per limited quantity, e.g. {"tau A": -0.4}; negative if kept.
    balance : |integral of tau v_M less the power of friction, dampers, payload|, relative likewise; zero if periodic.
    inverse, direct : smallest distance to singularities of type 1 and 2 along the motion, in [0, 1].
    faults : what keeps the result from being verified, one sentence each.
    cost : what `energy`, `claimed` and `scale` are values of.
    """

    energy: float
    claimed: float
    scale: float
    gap: float
    closure: float
    window: float
    limits: dict[str, float]
    balance: float
    inverse: float
    direct: float
    faults: tuple[str, ...]
    cost: Cost = ENERGY

    @property
    def verified(self) -> bool:
        return not self.faults

    def __repr__(self) -> str:
        status = f"not verified: {'; '.join(self.faults)}" if self.faults else "verified"
        return one_line(f"<Audit: {self.cost.show(self.energy)}, claimed {self.cost.show(self.claimed)}, {status}>")


@dataclass(frozen=True, eq=False)
class Series:
    """The whole motion on a dense periodic grid; all arrays (points, ...), SI units."""

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
    Z = np.stack([jet[:, delta:] for jet in jets[:3]], axis=1).reshape(count, -1)
    q = _poses(problem, jets[0][:, :delta])
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
    return Series(t, jets[0][:, :delta], q, v, a, q_M, v_M, tau, u, power)


def audit(problem: Problem, motion: Motion, claimed: float) -> tuple[Audit, Series]:
    """Check a motion; see `Audit`."""
    s = series(problem, motion)
    mean = problem.cycle.period / s.t.size
    actuation, cost = problem.actuation, problem.cost
    energy = cost.value(cost.exact(s.tau.T, s.v_M.T, actuation.each), mean)
    turnover = float(np.abs(s.u * s.v[:, problem.actuation.mechanism.actuated]).sum() * mean)
    scale = cost.scale(energy, IDLE * turnover)
    given = s.q, s.v, s.a, s.v_M, actuation.load(s.t)[:, None], actuation.r
    lost = Batch(losses(actuation.structure), s.t.size)(*given)[0].sum()
    off = abs(float(((s.tau * s.v_M).sum() - lost) * mean))
    balance = off / ENERGY.turnover(s.power, mean, IDLE * turnover)
    gap = abs(claimed - energy) / scale
    mechanism = problem.actuation.mechanism
    inverse, direct = pose.singularity(mechanism, s.q[::BETWEEN_SINGULAR])
    closed = mechanism.functions["closure_residual"].map(s.t.size)(s.q.T)
    closure = float(np.abs(np.array(closed)).max(initial=0.0))
    window, outside = _window_excess(problem, motion), _out_of_bounds(problem, motion)
    limits = {f"{b.quantity} {b.name}": _limit_excess(b, s, motion, problem) for b in problem.bounds}
    checks = [
        (
            gap > problem.options.energy_tolerance,
            f"the transcription claims {cost.show(claimed)}, the dense grid gives {cost.show(energy)}",
        ),
        (balance > BALANCE, f"the power balance is off by {balance:.1e}"),
        (closure > CLOSURE, f"the loops open by {closure:.1e} m"),
        (window > WINDOW_EXCESS, f"a rest window is overstepped by {window:.1e} m"),
        (not outside <= LIMIT_EXCESS, f"a spring is outside its bounds by {outside:.1e} of its value"),
        *((x > LIMIT_EXCESS, f"the limit of {name} is overstepped by {x:.1%}") for name, x in limits.items()),
    ]
    faults = tuple(text for failed, text in checks if failed)
    to_inverse, to_direct = float(inverse.min()), float(direct.min())
    return Audit(energy, claimed, scale, gap, closure, window, limits, balance, to_inverse, to_direct, faults, cost), s


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


def _poses(problem: Problem, targets: np.ndarray) -> np.ndarray:
    """Poses along the path, all on the same side of the inverse-kinematic singularities."""
    mechanism = problem.actuation.mechanism
    count, n = targets.shape[0], mechanism.model.nq
    poses = poses_along(Poses(mechanism, count), targets.T).T
    A = Batch(pose.task_system(mechanism), count)(poses)[1]
    signs = np.sign(np.linalg.det(A.reshape(count, n, n)))
    if np.any(signs != signs[0]):
        raise FloatingPointError("the motion crosses a singularity")
    return poses


def _window_excess(problem: Problem, motion: Motion) -> float:
    worst = -np.inf
    for w in problem.cycle.windows:
        t = np.linspace(w.start, w.end, PER_WINDOW + 1)
        r_E = motion.flat_output(t)[:, w.axis]
        worst = max(worst, float(np.abs(r_E - w.at).max()) - w.deviation)
    return worst


def _out_of_bounds(problem: Problem, motion: Motion) -> float:
    """Largest distance of a spring's number from its bounds, relative to the number."""
    with np.errstate(invalid="ignore"):  # the logarithm of a stiffness that is not positive
        variables = motion.variables(problem.actuation)
    inside = Motion.of(problem.actuation, motion.basis, motion.coefficients, variables)
    pairs = ((motion.stiffness, inside.stiffness), (motion.parallel, inside.parallel))
    given, nearest = (np.concatenate([x[i][~np.isnan(x[0])] for x in pairs]) for i in (0, 1))
    return float((np.abs(given - nearest) / np.maximum(np.abs(given), LIMIT_EXCESS)).max(initial=0.0))


def _limit_excess(bound: Bound, s: Series, motion: Motion, problem: Problem) -> float:
    """Largest excess over a limit, relative to the larger of its two sides."""
    i = bound.index
    if bound.quantity.endswith("r_E"):
        values = motion.flat_output(s.t, len(bound.quantity) - len("r_E"))[:, i]
    else:
        values = {"tau": s.tau, "speed": s.v_M, "q": s.q, "dq": s.v, "ddq": s.a}[bound.quantity][:, i]
    size = max(abs(x) for x in (bound.lower, bound.upper) if np.isfinite(x))
    return float(max((bound.lower - values).max(), (values - bound.upper).max()) / max(size, 1e-12))
