"""What a result says: the stored series of its file, on which a replay is driven and with which it is compared."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.interpolate import BSpline, make_interp_spline

from pkmsea.errors import InputError
from pkmsea.motion import Motion
from pkmsea.problem import Problem
from pkmsea.solution import Solution
from pkmsea.solution.netcdf import Dataset
from pkmsea.solution.store import damaged, load, read_dataset
from pkmsea.verification.drives import Drives

DEGREE = 5  # of the periodic splines through the samples
TURN = 2 * np.pi  # [rad]
SERIES = ("r_E", "q", "v", "q_M", "v_M", "tau", "u", "power", "energy")


@dataclass(frozen=True, eq=False)
class Reference:
    """The series of a result as its file holds them, K samples of one period; SI units.

    Attributes
    ----------
    solution : the stored flat output and stiffnesses, with robot and task, as loaded; its energies are its own.
    t : (K,) uniform, from 0, without the period's end.
    series : by name, (K, ...).
    value : of the cost per cycle, by default the energy [J], as the result prints it.
    """

    solution: Solution
    t: np.ndarray
    series: dict[str, np.ndarray]
    value: float

    @property
    def problem(self) -> Problem:
        return self.solution.problem

    @property
    def motion(self) -> Motion:
        return self.solution.motion

    @property
    def period(self) -> float:
        return self.problem.cycle.period

    @cached_property
    def drives(self) -> Drives:
        """The drives with the stored stiffnesses."""
        return Drives(self.problem.actuation, self.motion.stiffness, self.motion.parallel)

    @cached_property
    def gain(self) -> np.ndarray:
        """What each joint gains per period (n,): the whole turns between its last sample, carried on, and its first."""
        q, v = self.series["q"], self.series["v"]
        turns = np.round((q[-1] + v[-1] * (self.period - self.t[-1]) - q[0]) / TURN)
        return np.where(self.problem.mechanism.revolute, turns * TURN, 0.0)

    @cached_property
    def gain_of_motors(self) -> np.ndarray:
        """What each motor position gains per period (m,)."""
        return self.gain[self.problem.mechanism.actuated]

    @cached_property
    def gain_of_states(self) -> np.ndarray:
        """What the states gain per period (2n + 2e,)."""
        e = self.gain_of_motors[self.drives.elastic]
        return np.concatenate([self.gain, np.zeros_like(self.gain), e, np.zeros_like(e)])

    @cached_property
    def states(self) -> np.ndarray:
        """x = (q, v, q_M, v_M) at the samples; motors of elastic drives only (K, 2n + 2e)."""
        elastic = self.drives.elastic
        motors = self.series["q_M"][:, elastic], self.series["v_M"][:, elastic]
        return np.hstack([self.series["q"], self.series["v"], *motors])

    def drive(self, t: np.ndarray | float) -> np.ndarray:
        """(tau, q_M, v_M) at times t (..., 3m): periodic splines through the samples, and what the motors gain."""
        found = self._through(t)
        m = self.gain_of_motors.size
        found[..., m : 2 * m] += np.multiply.outer(np.asarray(t) / self.period, self.gain_of_motors)
        return np.asarray(found)

    @cached_property
    def _through(self) -> BSpline:
        return self._spline(1)

    @cached_property
    def resolution(self) -> float:
        """Largest error, relative to the peak torque, at which every second sample predicts those in between.

        The splines through all samples are at least DEGREE powers of two better where the torque is smooth.
        """
        tau = self.series["tau"]
        between = self._spline(2)(self.t[1::2])[:, : tau.shape[1]]
        return float(np.abs(between - tau[1::2]).max() / np.abs(tau).max())

    @cached_property
    def flat_series(self) -> np.ndarray:
        """The stored series that are entries of the flat output: r_E, then q_M, u or tau of the free drives (K, m)."""
        actuation = self.problem.actuation
        z = [self._closed[actuation.kinds[i].coordinate][:, i] for i in actuation.free]
        return np.column_stack([self.series["r_E"], *z])

    @cached_property
    def _closed(self) -> dict[str, np.ndarray]:
        """The series of the drives without what they gain, so that they are periodic."""
        q_M = self.series["q_M"] - np.outer(self.t / self.period, self.gain_of_motors)
        return self.series | {"q_M": q_M}

    def _spline(self, stride: int) -> BSpline:
        values = np.hstack([self._closed[name] for name in ("tau", "q_M", "v_M")])[::stride]
        closed = np.append(self.t[::stride], self.period), np.vstack([values, values[:1]])
        return make_interp_spline(*closed, k=DEGREE, bc_type="periodic")


def reference(source: Solution | str | Path) -> Reference:
    """Of a result file, as it is stored; or of a solution, as it would be.

    Raises
    ------
    InputError : the file is missing, damaged, or its series do not fit its task.
    """
    if isinstance(source, Solution):
        return _of_dataset(source.dataset(), source, None)
    return _of_dataset(read_dataset(source), load(source), Path(source))


def _of_dataset(dataset: Dataset, solution: Solution, file: Path | None) -> Reference:
    problem = solution.problem
    actuation = problem.actuation
    n, m, axes = actuation.mechanism.model.nq, actuation.m, actuation.mechanism.mobility
    widths = {"r_E": axes, "q": n, "v": n, "power": 0, "energy": 0}
    key = problem.cost.name
    with damaged(file):
        t = dataset.numbers("time")
        series = {name: dataset.numbers(name) for name in SERIES}
        value = float(dataset.attrs[key])
    uniform = np.arange(t.size) * problem.cycle.period / max(t.size, 1)
    if t.size < 2 * DEGREE + 2 or t.size % 2 or not np.allclose(t, uniform, rtol=0, atol=1e-9 * problem.cycle.period):
        raise InputError(
            "The samples are not evenly spread over one period.", "Solve the task again.", file=file, key="time"
        )
    if not np.isfinite(value):
        raise InputError("This is not a finite number.", "Solve the task again.", file=file, key=key)
    for name, values in series.items():
        width = widths.get(name, m)
        if values.shape != ((t.size, width) if width else (t.size,)) or not np.all(np.isfinite(values)):
            raise InputError(
                "This series has missing or too many numbers.", "Solve the task again.", file=file, key=name
            )
    return Reference(solution, t, series, value)
