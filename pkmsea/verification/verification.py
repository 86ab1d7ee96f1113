"""A result proved by an independent forward simulation: what is compared, and what it must keep."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import simpson

from pkmsea.actuation.cost import ENERGY, positive
from pkmsea.errors import one_line
from pkmsea.mechanism import pose
from pkmsea.problem import Bound, Cost
from pkmsea.solution import Solution
from pkmsea.solution.audit import IDLE, status_of
from pkmsea.solver import Optimality
from pkmsea.solver.threads import one_thread
from pkmsea.verification.dynamics import Robot
from pkmsea.verification.observe import Observed, observe
from pkmsea.verification.reference import Reference, reference
from pkmsea.verification.replay import CYCLES, Trace, cycles, segments

END_EFFECTOR = 5e-5  # of the path's extent; 10 micrometres are 7e-5 of that of the PKM's
DEVIATION = 2e-4  # of a series' range: what a 1 mm shift, a 5 % softer spring or 2 % more torque exceed by far
SAME_VALUE = 1e-3  # relative; the audit's own gap may be five times as large
CLOSURE = 1e-7  # [m, rad]
BALANCE = 1e-5  # relative to the energy: what the simulation itself gains or loses
PERIODICITY = 1e-4  # of the path's extent, per cycle
FEEDBACK = 1e-3  # of the peak torque
WINDOW_EXCESS = 1e-3  # of a window's half width
LIMIT_EXCESS = 1e-4  # relative to a limit's size
TINY = 1e-12  # keeps ratios finite where nothing moves
RESOLUTION = 2e-2  # of the peak torque: error of every second sample's spline; that of all samples is 2^-DEGREE of it


@dataclass(frozen=True, repr=False)
class Verification:
    """What the simulation says about a result; `faults` is empty for one that it confirms.

    Attributes
    ----------
    value : of the cost per cycle, by default the energy [J], as the result prints it.
    simulated : per cycle, from torque and simulated motor speed, in segments.
    in_cycles : the same in the last of the whole cycles, the feedback's torque included.
    gap : the larger difference of these two to `value`, relative to it, or to IDLE of the drives' turnover
        where that is more.
    end_effector, motors : largest deviation in a segment [m, rad].
    deviations : largest deviation of each stored series from the simulated one in a segment, relative to its range;
        'flat_output' compares the stored coefficients with the stored series.
    closure : largest closure residual of all replays [m, rad].
    balance : |work of motors, friction and payload - change of mechanical energy| over the cycles, relative like `gap`.
    periodicity : largest change of the end effector from cycle to cycle [m, rad].
    feedback, feedback_energy : largest torque of the feedback relative to the peak torque, and the energy that it
        moves relative to the drives' turnover.
    window : largest excess over a rest window in the cycles [m, rad]; negative if kept.
    limits : relative excess per limited quantity in the cycles; negative if kept.
    inverse, direct : smallest distance to singularities of type 1 and 2, in [0, 1].
    resolution : error, relative to the peak torque, at which every second torque sample predicts those in between.
    optimality : first- and second-order conditions of a local minimum; None where they are not available.
    faults : what speaks against the result, one sentence each.
    cost : what was minimised.
    """

    value: float
    simulated: float
    in_cycles: float
    gap: float
    end_effector: float
    motors: float
    deviations: dict[str, float]
    closure: float
    balance: float
    periodicity: float
    feedback: float
    feedback_energy: float
    window: float
    limits: dict[str, float]
    inverse: float
    direct: float
    resolution: float
    optimality: Optimality | None
    faults: tuple[str, ...]
    cost: Cost = ENERGY

    @property
    def verified(self) -> bool:
        return not self.faults

    @property
    def status(self) -> str:
        """'verified', with what is undecided about it, or why not."""
        return status_of(self.faults, self.optimality.remark if self.optimality else "")

    def __repr__(self) -> str:
        said, simulated = self.cost.show(self.value), self.cost.show(self.simulated)
        return one_line(f"<Verification: {said}, simulated {simulated}, {self.status}>")


@np.errstate(over="ignore", invalid="ignore")  # a wrong result may move without bounds; the checks say so
@one_thread
def verify(source: Solution | str | Path) -> Verification:
    """Simulate a solution, or a result file as it is stored, and compare; see `Verification`.

    Raises
    ------
    InputError : the file is missing or damaged, or a rotor has no inertia.
    SolveError : the simulation broke down.
    """
    said = reference(source)
    robot = Robot(said.drives)
    pieces, whole = segments(robot, said), cycles(robot, said)
    short, long = observe(robot, pieces), observe(robot, whole)
    cost, actuation, step = said.problem.cost, said.problem.actuation, said.period / said.t.size
    simulated = cost.value(cost.exact(short.tau.T, short.v_M.T, actuation.each), step)
    starts = [int(np.abs(long.t - k * said.period).argmin()) for k in range(CYCLES + 1)]
    in_cycles = long.cost(cost, actuation, slice(starts[-2], starts[-1] + 1))
    idle = IDLE * float(np.abs(short.u * short.v[:, robot.at]).sum(axis=1).mean()) * said.period
    scale = cost.scale(said.value, idle)
    inverse, direct = (float(distance.min()) for distance in pose.singularity(robot.mechanism, short.q))
    measured: dict[str, Any] = {
        "value": said.value,
        "simulated": simulated,
        "in_cycles": in_cycles,
        "gap": max(abs(simulated - said.value), abs(in_cycles - said.value)) / scale,
        "end_effector": float(np.abs(short.r_E - said.series["r_E"]).max()),
        "motors": float(np.abs(short.q_M - said.series["q_M"]).max()),
        "deviations": _deviations(said, short),
        "closure": float(max(short.closure.max(), long.closure.max())),
        "balance": _balance(long) / (CYCLES * ENERGY.turnover(short.power, step, idle)),
        "periodicity": float(np.abs(np.diff(long.r_E[starts], axis=0)).max()),
        **_feedback(whole, long),
        "window": _window_excess(said, long),
        "limits": {b.label: b.excess(_limited(b, long)) for b in said.problem.bounds},
        "inverse": inverse,
        "direct": direct,
        "resolution": said.resolution,
        "optimality": said.solution.optimality(),
    }
    return Verification(**measured, faults=_faults(measured, said), cost=cost)


def _deviations(said: Reference, short: Observed) -> dict[str, float]:
    step = said.period / said.t.size
    seen = {name: getattr(short, name) for name in ("r_E", "q", "v", "q_M", "v_M", "u", "power")}
    seen["energy"] = np.cumsum(positive(short.power)) * step
    pairs = {name: (said.series[name], values) for name, values in seen.items()}
    pairs["flat_output"] = said.flat_series, said.motion.flat_output(said.t)
    return {
        name: float(np.abs(stored - values).max() / max(np.ptp(stored, axis=0).max(), TINY))
        for name, (stored, values) in pairs.items()
    }


def _balance(long: Observed) -> float:
    """|work of the motors less friction and payload - change of mechanical energy| [J]."""
    return abs(float(simpson(long.supplied, x=long.t) - (long.mechanical[-1] - long.mechanical[0])))


def _feedback(whole: Trace, long: Observed) -> dict[str, float]:
    moved, turned = (np.trapezoid(np.abs(x * long.v_M).sum(axis=1), long.t) for x in (whole.feedback, long.tau))
    share = np.abs(whole.feedback).max() / max(np.abs(whole.tau).max(), TINY)
    return {"feedback": float(share), "feedback_energy": float(moved / max(turned, TINY))}


def _window_excess(said: Reference, long: Observed) -> float:
    worst = -np.inf
    rounding = 1e-12 * said.period
    for w in said.problem.cycle.windows:
        since = (long.t - w.start + rounding) % said.period
        off = np.abs(long.r_E[since <= w.end - w.start + 2 * rounding, w.axis] - w.at)
        worst = max(worst, float(off.max()) - w.deviation)
    return worst


def _limited(bound: Bound, long: Observed) -> np.ndarray:
    """What a bound limits."""
    name = {"speed": "v_M", "dq": "v", "ddq": "a"}.get(bound.quantity, bound.quantity)
    return np.asarray(getattr(long, name)[:, bound.index])


def _faults(found: dict[str, Any], said: Reference) -> tuple[str, ...]:
    extent = float(np.ptp(said.series["r_E"], axis=0).max())
    deviation = min(w.deviation for w in said.problem.cycle.windows)
    deviating = [name for name, x in found["deviations"].items() if not x <= DEVIATION]
    checks = [
        (found["gap"] <= SAME_VALUE, "the result prints {value:.5g} {unit}, its torque needs {simulated:.5g} {unit} "
         "in segments and {in_cycles:.5g} {unit} in whole cycles"),
        (found["end_effector"] <= END_EFFECTOR * extent, "the end effector deviates by {end_effector:.1e} {r_E}"),
        (not deviating, f"these series of the result do not follow from its torque: {', '.join(deviating)}"),
        (found["closure"] <= CLOSURE, "the loops open by {closure:.1e} m"),
        (found["balance"] <= BALANCE, "the simulation's power balance is off by {balance:.1e}"),
        (found["periodicity"] <= PERIODICITY * extent,
         "after a cycle the end effector is off by {periodicity:.1e} {r_E}"),
        (found["feedback"] <= FEEDBACK, "holding the motion takes {feedback:.1e} of the peak torque"),
        (found["window"] <= WINDOW_EXCESS * deviation, "a rest window is overstepped by {window:.1e} {r_E}"),
        (found["resolution"] <= RESOLUTION, "the samples are too coarse for the torque (off by {resolution:.1e})"),
        *((x <= LIMIT_EXCESS, f"the limit of {name} is overstepped by {x:.1%}") for name, x in found["limits"].items()),
    ]  # fmt: skip
    told = {"unit": said.problem.cost.unit, "r_E": said.problem.mechanism.end_effector_unit, **found}
    faults = [text.format(**told) for kept, text in checks if not kept]
    faults += [f"by the result's own audit, {fault}" for fault in said.solution.faults]
    return tuple(faults)
