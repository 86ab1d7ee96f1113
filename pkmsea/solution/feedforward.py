"""Feed-forward of a drive: a result's motion and torques at a rate of its own, with names, units and meanings.

Every number is the exact flat map at its own instant; nothing is interpolated. A periodic reference needs a whole
number of samples, so that the last one is one sample time before the first one of the next cycle.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from importlib.metadata import version
from math import ceil, isfinite

import numpy as np

from pkmsea.errors import InputError
from pkmsea.motion import turns
from pkmsea.motion.series import POINTS, Series, series
from pkmsea.problem import Cost, Problem
from pkmsea.solution.netcdf import Array, Dataset
from pkmsea.solution.solution import Solution

FORMAT = "pkmsea feed-forward 1"
LARGEST = 100_000  # samples per cycle; a file of about 50 MB
ROUNDING = 1e-9  # samples by which rate * period may miss a whole number
UNITS = {True: ("rad", "rad/s", "rad/s^2", "N m"), False: ("m", "m/s", "m/s^2", "N")}  # of revolute joints, of others


@dataclass(frozen=True)
class Sampling:
    """K samples of one period T [s], at t = 0, T/K ... T - T/K."""

    period: float
    samples: int

    @classmethod
    def at_least(cls, rate: float, period: float) -> Sampling:
        """The lowest rate that is not below `rate` [Hz] and has a whole number of samples per period.

        Raises
        ------
        InputError : the rate is not a positive number, or asks for more than LARGEST samples.
        """
        if not isinstance(rate, int | float | np.number) or not isfinite(rate) or rate <= 0:
            raise InputError(
                "The rate must be a positive number.", "Give samples per second, such as 1000.", key="rate", value=rate
            )
        if rate * period > LARGEST:
            raise InputError(
                f"The rate asks for more than {LARGEST} samples per cycle of {period:g} s.",
                f"Choose at most {LARGEST / period:g} Hz.",
                key="rate",
                value=rate,
            )
        return cls(period, max(ceil(rate * period - ROUNDING), 1))

    @property
    def rate(self) -> float:
        """[Hz]"""
        return self.samples / self.period

    @property
    def time(self) -> float:
        """Between two samples [s]."""
        return self.period / self.samples

    def __str__(self) -> str:
        return f"{self.samples} samples per cycle, one every {self.time!r} s ({self.rate:.10g} Hz)"

    @property
    def instants(self) -> np.ndarray:
        """(samples,) [s]"""
        return np.arange(self.samples) * self.period / self.samples


def feedforward(solution: Solution, sampling: Sampling) -> Dataset:
    """One variable per column, with unit and meaning; the head as attributes."""
    stride = ceil(POINTS / sampling.samples)  # damped springs need a dense period, and paths are followed densely
    s = series(solution.problem, solution.motion, sampling.samples * stride)
    columns = {
        name: Array(("time",), values[::stride], {"units": unit, "long_name": text})
        for name, unit, text, values in _columns(solution.problem, s)
    }
    tau = s.tau[::stride]
    jump = np.abs(np.diff(tau, axis=0, append=tau[:1])).max() / np.abs(tau).max(initial=np.finfo(float).tiny)
    turning = ", ".join(turns.told(solution.problem.mechanism, s.gain).values()) or "none"
    head = {**_head(solution, sampling), "turns_per_cycle": turning, "largest_torque_step_over_peak": float(jump)}
    return Dataset({"time": Array(("time",), sampling.instants, {"units": "s"}), **columns}, head)


def _columns(problem: Problem, s: Series) -> list[tuple[str, str, str, np.ndarray]]:
    """Name, unit, meaning and values (points,) of every column but the time."""
    actuation, mechanism = problem.actuation, problem.actuation.mechanism
    found = []
    for i, (joint, name) in enumerate(zip(mechanism.actuated, _names(actuation.labels), strict=True)):
        angle, speed, acceleration, force = UNITS[mechanism.revolute[joint]]
        of = f"of drive {' '.join(actuation.labels[i].split())}"
        adds, gained = "; each cycle adds {!r} {}", float(s.gain[joint])
        on = adds.format(gained, angle) if gained else ""
        found += [
            (f"q_M_{name}", angle, f"motor position {of}, output side of the gear{on}", s.q_M[:, i]),
            (f"v_M_{name}", speed, f"motor speed {of}, output side", s.v_M[:, i]),
            (f"tau_{name}", force, f"motor torque or force {of}, output side", s.tau[:, i]),
            (f"u_{name}", force, f"force on the joint {of}: its spring's, or a rigid drive's own", s.u[:, i]),
            (f"q_A_{name}", angle, f"joint position {of}{on}", s.q[:, joint]),
            (f"v_A_{name}", speed, f"joint speed {of}", s.v[:, joint]),
            (f"a_A_{name}", acceleration, f"joint acceleration {of}", s.a[:, joint]),
        ]
        if (ratio := problem.gear_ratios[i]) is not None:  # the shaft turns where the output slides, too: rad per m
            on = adds.format(ratio * gained, "rad") if gained else ""
            found += [
                (f"q_shaft_{name}", "rad", f"motor position {of}, at its own shaft{on}", ratio * s.q_M[:, i]),
                (f"v_shaft_{name}", "rad/s", f"motor speed {of}, at its own shaft", ratio * s.v_M[:, i]),
                (f"tau_shaft_{name}", "N m", f"motor torque {of}, at its own shaft", s.tau[:, i] / ratio),
            ]
    followed = mechanism.description.end_effector
    named = zip(followed.coordinates, _names(list(followed.coordinates)), mechanism.end_effector_units, strict=True)
    for k, (axis, name, unit) in enumerate(named):
        found.append((f"{name}_E", unit, f"end effector, {axis}", s.r_E[:, k]))
    return [*found, ("power", "W", "electrical power on the common bus", s.power)]


def _names(labels: list[str]) -> list[str]:
    """Labels as parts of column names, without separators; numbered where they would coincide."""
    clean = [re.sub(r"\W+", "_", label) for label in labels]
    return clean if len(set(clean)) == len(clean) else [f"{i}_{name}" for i, name in enumerate(clean, 1)]


def _head(solution: Solution, sampling: Sampling) -> dict[str, str | float]:
    """What the file says about itself."""
    problem, motion = solution.problem, solution.motion
    head: dict[str, str | float] = {
        "format": FORMAT,
        "version": f"pkmsea {version('pkmsea')}",
        "task": problem.title,
        "setup": problem.name,
        "mechanism": problem.actuation.mechanism.name,
        "status": solution.status,
        _cost_key(solution.cost): solution.energy,
        "period_s": sampling.period,
        "samples": sampling.samples,
        "sample_time_s": sampling.time,
        "stiffness": _each(problem, motion.stiffness, "{force}/{angle}"),
        "parallel_stiffness": _each(problem, motion.parallel[:, 0], "{force}/{angle}"),
        "parallel_rest": _each(problem, motion.parallel[:, 1], "{angle}"),
        "copper_loss": _each(problem, problem.kappa, "W/({force})^2"),
        "gear_ratio": _each(problem, np.array(problem.gear_ratios, float), "rad/{angle}"),
    }
    return {key: " ".join(x.split()) if isinstance(x, str) else x for key, x in head.items()}


def _cost_key(cost: Cost) -> str:
    """Such as energy_per_cycle_J."""
    return f"{cost.name}_per_cycle_{cost.unit.replace(' ', '_')}"


def _each(problem: Problem, values: np.ndarray, unit: str) -> str:
    """A number of every drive that has it, in words."""
    mechanism = problem.actuation.mechanism
    found = []
    for label, joint, value in zip(problem.actuation.labels, mechanism.actuated, values.tolist(), strict=True):
        angle, _, _, force = UNITS[mechanism.revolute[joint]]
        found += [] if np.isnan(value) else [f"{label} {value!r} {unit.format(angle=angle, force=force)}"]
    return "; ".join(found) or "none"
