"""Motions, starts and series as plain data, as result files and tables of studies hold them."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from pkmsea.actuation.cost import positive
from pkmsea.files import Record
from pkmsea.motion import Basis, Motion
from pkmsea.motion.bases import make_basis
from pkmsea.motion.series import series
from pkmsea.problem import Problem
from pkmsea.solution.netcdf import Array
from pkmsea.solver import Outcome, Start
from pkmsea.task.task import Trajectory

POINTS = 1000  # of the stored series, per period, at least
PER_COEFFICIENT = 20  # and at least so many per coefficient of the basis: a torque can be interpolated between them


def motion_record(motion: Motion) -> dict[str, Any]:
    """A motion as plain data; `motion_of` reads it."""
    arrays = {"coefficients": motion.coefficients, "stiffness": motion.stiffness, "parallel": motion.parallel}
    plain = {name: x.astype(object).tolist() for name, x in arrays.items()}
    return {"basis": motion.basis.trajectory.model_dump(), "period": motion.basis.period, **plain}


def motion_of(record: dict[str, Any]) -> Motion:
    """The motion that `motion_record` has written."""
    arrays = [np.array(record[name], float) for name in ("coefficients", "stiffness", "parallel")]
    return Motion(basis_of(record["basis"], record["period"]), *arrays)


def basis_of(trajectory: dict[str, Any], period: float) -> Basis:
    """The basis that a task's trajectory, as plain data, names."""
    return make_basis(TypeAdapter(Trajectory).validate_python(trajectory), period)


def start_record(start: Start) -> dict[str, Any]:
    """A start as plain data; `StartRecord` reads it."""
    kept = asdict(start) | {"outcome": start.outcome.value, "claimed": start.claimed if start.usable else None}
    del kept["x"]
    return kept


class StartRecord(Record):
    """A `Start` as its file holds it."""

    index: int
    outcome: Outcome
    claimed: float | None
    stiffness: tuple[float, ...]
    iterations: int
    seconds: float
    limited: tuple[str, ...]
    finished: bool
    repeats: int | None = None

    def start(self) -> Start:
        claimed = np.inf if self.claimed is None else self.claimed
        return Start(**(self.model_dump() | {"claimed": claimed, "x": None}))


def arrays_of(problem: Problem, motion: Motion) -> dict[str, Array]:
    """The labelled time series of a motion, its springs and its flat output."""
    actuation, mechanism = problem.actuation, problem.mechanism
    s = series(problem, motion, max(POINTS, PER_COEFFICIENT * motion.basis.size))
    energy = np.cumsum(positive(s.power)) * problem.cycle.period / s.t.size
    parallel = motion.parallel
    described = {
        "r_E": (("time", "axis"), s.r_E, "end-effector position", mechanism.end_effector_unit),
        "q": (("time", "joint"), s.q, "joint position", "rad or m, see joint_unit"),
        "v": (("time", "joint"), s.v, "joint velocity", "joint_unit per s"),
        "q_M": (("time", "drive"), s.q_M, "motor position (output side)", "rad or m"),
        "v_M": (("time", "drive"), s.v_M, "motor speed (output side)", "rad/s or m/s"),
        "tau": (("time", "drive"), s.tau, "motor torque or force", "N m or N, see force_unit"),
        "u": (("time", "drive"), s.u, "spring or drive force on the joint", "N m or N, see force_unit"),
        "power": (("time",), s.power, "electrical power on the common bus", "W"),
        "energy": (("time",), energy, "electrical energy drawn since t = 0", "J"),
        "stiffness": (("drive",), motion.stiffness, "spring stiffness", "N m/rad or N/m"),
        "parallel_stiffness": (("drive",), parallel[:, 0], "parallel spring stiffness", "N m/rad or N/m"),
        "parallel_rest": (("drive",), parallel[:, 1], "its position without force", "rad or m"),
        "flat_output": (("coefficient", "output"), motion.coefficients, "coefficients of y", "SI"),
    }
    arrays = {
        name: Array(dims, values, {"long_name": text, "units": unit})
        for name, (dims, values, text, unit) in described.items()
    }
    arrays["time"] = Array(("time",), s.t, {"units": "s"})
    labels = {
        "drive": ("drive", actuation.labels),
        "joint": ("joint", mechanism.joints),
        "axis": ("axis", mechanism.description.end_effector.coordinates),
        "output": ("output", actuation.flat_outputs),
        "joint_unit": ("joint", mechanism.units),
        "force_unit": ("drive", ["N m" if mechanism.revolute[i] else "N" for i in mechanism.actuated]),
    }
    return arrays | {name: Array((dim,), np.array(texts, object)) for name, (dim, texts) in labels.items()}
