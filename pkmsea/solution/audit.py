"""The audit: a motion checked on a dense grid by the exact flat map, independent of the transcription."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pkmsea.actuation.cost import ENERGY, Cost
from pkmsea.actuation.signals import losses
from pkmsea.errors import one_line
from pkmsea.kernels import Batch
from pkmsea.mechanism import pose
from pkmsea.motion import Motion, Series, series, turns
from pkmsea.motion.series import limited_signal
from pkmsea.problem import Problem
from pkmsea.problem.bounds import TOUCHING

PER_WINDOW = 400  # points per rest window, edges included
BETWEEN_SINGULAR = 10  # grid points from one look at the distance to singularities to the next
BALANCE = 1e-6  # largest relative residual of the power balance
CLOSURE = 1e-8  # largest closure residual [m]
WINDOW_EXCESS = 1e-9  # rounding, in a window's own units [m, rad]
LIMIT_EXCESS = 1e-6  # rounding, relative to a limit's size
IDLE = 1e-3  # share of the mechanical turnover below which an energy counts as zero


@dataclass(frozen=True, repr=False)
class Audit:
    """What the dense grid says about a motion; `faults` is empty for a verified one.

    Attributes
    ----------
    value : of the cost, by default the integral of max(P, 0) over one period [J]; the truth.
    claimed : the transcription's own value.
    scale : what differences of values are relative to: the value, or, of an energy, IDLE of the drives' turnover if
        that is more.
    gap : |claimed - value| / scale.
    closure : largest closure residual [m].
    window : largest excess over a rest window at any instant, in its own units [m, rad]; zero or negative if kept.
    limits : relative excess per limited quantity, e.g. {"tau A": -0.4}; negative if kept.
    binding : the limits that the motion reaches, and the bounds of springs, such as 'tau A <= 0.3'.
    balance : |integral of tau v_M less the power of friction, dampers, payload|, relative likewise; zero if periodic.
    inverse, direct : smallest distance to singularities of type 1 and 2 along the motion, in [0, 1].
    faults : what keeps the result from being verified, one sentence each.
    cost : what `value`, `claimed` and `scale` are values of.
    """

    value: float
    claimed: float
    scale: float
    gap: float
    closure: float
    window: float
    limits: dict[str, float]
    binding: tuple[str, ...]
    balance: float
    inverse: float
    direct: float
    faults: tuple[str, ...]
    cost: Cost = ENERGY

    @property
    def verified(self) -> bool:
        return not self.faults

    def __repr__(self) -> str:
        return one_line(
            f"<Audit: {self.cost.show(self.value)}, claimed {self.cost.show(self.claimed)}, {status_of(self.faults)}>"
        )


def status_of(faults: Sequence[str], *remarks: str) -> str:
    """'verified', with what is undecided about it, or why not."""
    if faults:
        return "not verified: " + "; ".join(faults)
    return ", but ".join(filter(None, ("verified", *remarks)))


def audit(problem: Problem, motion: Motion, claimed: float) -> tuple[Audit, Series]:
    """Check a motion; see `Audit`."""
    s = series(problem, motion)
    mean = problem.cycle.period / s.t.size
    actuation, cost = problem.actuation, problem.cost
    value = cost.value(cost.exact(s.tau.T, s.v_M.T, actuation.each), mean)
    turnover = float(np.abs(s.u * s.v[:, problem.actuation.mechanism.actuated]).sum() * mean)
    scale = cost.scale(value, IDLE * turnover)
    given = s.q, s.v, s.a, s.v_M, actuation.load(s.t)[:, None], actuation.r
    lost = Batch(losses(actuation.structure), s.t.size)(*given)[0].sum()
    off = abs(float(((s.tau * s.v_M).sum() - lost) * mean))
    balance = off / ENERGY.turnover(s.power, mean, IDLE * turnover)
    gap = abs(claimed - value) / scale
    mechanism = problem.actuation.mechanism
    inverse, direct = pose.singularity(mechanism, s.q[::BETWEEN_SINGULAR])
    closed = mechanism.functions["closure_residual"].map(s.t.size)(s.q.T)
    closure = float(np.abs(np.array(closed)).max(initial=0.0))
    window, outside = _window_excess(problem, motion), _out_of_bounds(problem, motion)
    signals = {bound: limited_signal(bound, motion, s.t, s) for bound in problem.bounds}
    limits = {bound.label: bound.excess(values) for bound, values in signals.items()}
    touched = [side for bound, values in signals.items() for side in bound.touched(values)]
    binding = (*touched, *_springs_at_bounds(problem, motion))
    stays = turns.fault(actuation, problem.ranges, s.gain)
    checks = [
        (
            gap > problem.options.energy_tolerance,
            f"the transcription claims {cost.show(claimed)}, the dense grid gives {cost.show(value)}",
        ),
        (balance > BALANCE, f"the power balance is off by {balance:.1e}"),
        (closure > CLOSURE, f"the loops open by {closure:.1e} m"),
        (window > WINDOW_EXCESS, f"a rest window is overstepped by {window:.1e} {mechanism.end_effector_unit}"),
        (bool(stays), stays),
        (not outside <= LIMIT_EXCESS, f"a spring is outside its bounds by {outside:.1e} of its value"),
        *((x > LIMIT_EXCESS, f"the limit of {name} is overstepped by {x:.1%}") for name, x in limits.items()),
    ]
    faults = tuple(text for failed, text in checks if failed)
    to_inverse, to_direct = float(inverse.min()), float(direct.min())
    return Audit(
        value, claimed, scale, gap, closure, window, limits, binding, balance, to_inverse, to_direct, faults, cost
    ), s


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


def _springs_at_bounds(problem: Problem, motion: Motion) -> list[str]:
    """Numbers of springs that are optimised and have come to an end of their range."""
    found = []
    values = {"c": motion.stiffness, "k": motion.parallel[:, 0], "rest": motion.parallel[:, 1]}
    for p in problem.actuation.parameters:
        at, name = values[p.kind][p.drive], f"{p.kind} {p.label}"
        near = TOUCHING * (at if p.logarithmic else p.high - p.low)
        if p.low < p.high:
            found += [f"{name} >= {p.low:.4g}"] if at <= p.low + near else []
            found += [f"{name} <= {p.high:.4g}"] if at >= p.high - near else []
    return found
