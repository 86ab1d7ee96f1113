"""Result files: NetCDF through xarray, readable without pkmsea; written whole or not at all.

Dimensions time, drive, joint, axis; every variable carries its unit. What pkmsea needs to load a solution again (task,
flat output, versions, solver record) stands beside the series as plain numbers and JSON text; nothing is executable.
"""

from __future__ import annotations

import io
import json
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np
import xarray as xr
from pydantic import TypeAdapter

from pkmsea.actuation import Actuation
from pkmsea.actuation.cost import positive
from pkmsea.errors import InputError, blaming
from pkmsea.files import Record, is_file, write_whole
from pkmsea.motion import Basis, Motion
from pkmsea.motion.bases import make_basis
from pkmsea.motion.series import series
from pkmsea.problem import build_problem, task_of
from pkmsea.solution.solution import Mesh, Solution
from pkmsea.solver import Outcome, Start
from pkmsea.task import Task
from pkmsea.task.task import Trajectory

FORMAT = "pkmsea result 1"
POINTS = 1000  # of the stored series, per period, at least
PER_COEFFICIENT = 20  # and at least so many per coefficient of the basis: a torque can be interpolated between them
PACKAGES = ("pkmsea", "casadi", "pin", "numpy")
MAX_BYTES = 1_000_000_000  # of a result's numbers; the finest mesh has a third of it


def to_dataset(solution: Solution) -> xr.Dataset:
    """The labelled time series of a solution, with its record as attributes."""
    problem, audit, optimality = solution.problem, solution.audit(), solution.optimality()
    actuation, mechanism = problem.actuation, problem.actuation.mechanism
    s = series(problem, solution.motion, max(POINTS, PER_COEFFICIENT * solution.motion.basis.size))
    revolute = mechanism.revolute
    force = ["N m" if revolute[i] else "N" for i in mechanism.actuated]
    angle = ["rad" if turning else "m" for turning in revolute]
    energy = np.cumsum(positive(s.power)) * problem.cycle.period / s.t.size
    described = {
        "r_E": (("time", "axis"), s.r_E, "end-effector position", "m"),
        "q": (("time", "joint"), s.q, "joint position", "rad or m, see joint_unit"),
        "v": (("time", "joint"), s.v, "joint velocity", "joint_unit per s"),
        "q_M": (("time", "drive"), s.q_M, "motor position (output side)", "rad or m"),
        "v_M": (("time", "drive"), s.v_M, "motor speed (output side)", "rad/s or m/s"),
        "tau": (("time", "drive"), s.tau, "motor torque or force", "N m or N, see force_unit"),
        "u": (("time", "drive"), s.u, "spring or drive force on the joint", "N m or N, see force_unit"),
        "power": (("time",), s.power, "electrical power on the common bus", "W"),
        "energy": (("time",), energy, "electrical energy drawn since t = 0", "J"),
        "stiffness": (("drive",), solution.motion.stiffness, "spring stiffness", "N m/rad or N/m"),
        "parallel_stiffness": (
            ("drive",),
            solution.motion.parallel[:, 0],
            "parallel spring stiffness",
            "N m/rad or N/m",
        ),
        "parallel_rest": (("drive",), solution.motion.parallel[:, 1], "its position without force", "rad or m"),
        "flat_output": (("coefficient", "output"), solution.motion.coefficients, "coefficients of y", "SI"),
    }
    variables = {
        name: xr.Variable(dims, values, {"long_name": text, "units": unit})
        for name, (dims, values, text, unit) in described.items()
    }
    coordinates = {
        "time": xr.Variable("time", s.t, {"units": "s"}),
        "drive": actuation.labels,
        "joint": mechanism.joints,
        "axis": list(mechanism.description.end_effector.coordinates),
        "output": actuation.flat_outputs,
        "joint_unit": ("joint", angle),
        "force_unit": ("drive", force),
    }
    record = {
        "format": FORMAT,
        "setup": problem.name,
        "task": task_of(problem).model_dump_json(),
        "task_file": "",  # of older results: beside it lies the mechanism that their task names
        "basis": solution.motion.basis.trajectory.model_dump_json(),
        problem.cost.name: audit.value,
        "claimed": solution.claimed,
        "status": solution.status,
        "audit": json.dumps({key: value for key, value in asdict(audit).items() if key != "cost"}),
        "optimality": json.dumps(optimality and asdict(optimality)),
        "optima": json.dumps([asdict(optimum) for optimum in solution.optima]),
        "starts": json.dumps([_start_record(start) for start in solution.starts]),
        "meshes": json.dumps([asdict(mesh) for mesh in solution.meshes]),
        "seconds": solution.seconds,
        "versions": json.dumps({name: version(name) for name in PACKAGES}),
    }
    return xr.Dataset(variables, coordinates, record)


def content_of(solution: Solution) -> bytes:
    """The content of the result file, made in memory: HDF5 does not survive a full disk."""
    buffer = io.BytesIO()
    with h5netcdf.File(
        buffer, "w"
    ) as file:  # xarray would open it under a lock of the Dask cluster, where there is one
        to_dataset(solution).dump_to_store(xr.backends.H5NetCDFStore(file, lock=False))
    return buffer.getvalue()


def save(solution: Solution, path: Path) -> Path:
    """Write the result file under a temporary name and move it into place."""
    content = content_of(solution)
    write_whole(path, lambda temporary: temporary.write_bytes(content))
    return path


def read_dataset(path: str | Path) -> xr.Dataset:
    """Read a result file as it is.

    Raises
    ------
    InputError : the file is missing, damaged, or not a result of pkmsea.
    """
    file = Path(path)
    if not is_file(file):
        raise InputError("There is no such result file.", "Give a file that 'pkmsea solve' wrote.", file=file)
    try:
        _check_container(file)
        with xr.open_dataset(file, engine="h5netcdf", decode_times=False) as opened:
            dataset = opened.load()
    except Exception as error:
        cause = " ".join(str(error).split())
        raise InputError(f"The result file cannot be read ({cause}).", "Solve the task again.", file=file) from error
    if str(dataset.attrs.get("format")) != FORMAT:
        raise InputError("This is not a result of pkmsea.", f"Give a file of format '{FORMAT}'.", file=file)
    return dataset


def _check_container(file: Path) -> None:
    """Refuse, with a ValueError, what would fill the memory or read from other files."""
    with h5py.File(file) as raw:
        if not all(isinstance(raw.get(name, getlink=True), h5py.HardLink) for name in raw):
            raise ValueError("it links to elsewhere")
        series = list(raw.values())
        if not all(isinstance(x, h5py.Dataset) and not x.external and not x.is_virtual for x in series):
            raise ValueError("it holds other things than series of its own")
        if sum(x.size * x.dtype.itemsize for x in series if x.size) > MAX_BYTES:
            raise ValueError(f"it declares more than {MAX_BYTES} bytes")


def numbers(dataset: xr.Dataset, name: str) -> np.ndarray:
    """A series as float64. ValueError where it holds anything else, KeyError where it is missing."""
    values = dataset[name].values
    if values.dtype.kind not in "fiu":
        raise ValueError(f"'{name}' does not hold numbers")
    return values.astype(float)


def load(path: str | Path) -> Solution:
    """Load a solution; its energies are evaluated anew, not believed."""
    file = Path(path)
    dataset = read_dataset(file)
    record = dataset.attrs
    try:
        task = Task.model_validate_json(record["task"]).read_from(record["task_file"])
        with blaming(file):
            problem = build_problem(task, record["setup"])
        basis = _basis(json.loads(record["basis"]), task.cycle.period)
        parallel = np.stack([numbers(dataset, name) for name in ("parallel_stiffness", "parallel_rest")], axis=1)
        motion = Motion(basis, numbers(dataset, "flat_output"), numbers(dataset, "stiffness"), parallel)
        _check_motion(motion, problem.actuation)
        starts = tuple(r.start() for r in TypeAdapter(tuple[StartRecord, ...]).validate_json(record["starts"]))
        meshes = TypeAdapter(tuple[Mesh, ...]).validate_json(record["meshes"])
        claimed, seconds, stated = (_finite(record[key], key) for key in ("claimed", "seconds", problem.cost.name))
        return Solution(problem, motion, claimed, starts, meshes, seconds, stated=stated)
    except (KeyError, ValueError, TypeError, RecursionError) as error:
        cause = " ".join(str(error).split())
        raise InputError(f"The result file is damaged ({cause}).", "Solve the task again.", file=file) from error


def _finite(value: Any, key: str) -> float:
    if not np.isfinite(number := float(value)):
        raise ValueError(f"'{key}' is not finite")
    return number


def _check_motion(motion: Motion, actuation: Actuation) -> None:
    """Refuse, with a ValueError, coefficients and springs that do not fit the robot."""
    m = actuation.m
    if motion.coefficients.shape != (motion.basis.size, m) or not np.all(np.isfinite(motion.coefficients)):
        raise ValueError(f"'flat_output' does not hold {motion.basis.size} x {m} finite numbers")
    springs = {"c": motion.stiffness, "k": motion.parallel[:, 0], "rest": motion.parallel[:, 1]}
    for kind, values in springs.items():
        there = np.isin(np.arange(m), [p.drive for p in actuation.parameters if p.kind == kind])
        if values.shape != (m,) or not np.array_equal(np.isfinite(values), there) or np.any(np.isinf(values)):
            raise ValueError("the springs do not fit the drives")
        if kind != "rest" and np.any(values[there] <= 0):
            raise ValueError("a spring has a stiffness that is not positive")


def motion_record(motion: Motion) -> dict[str, Any]:
    """A motion as plain data; `motion_of` reads it."""
    arrays = {"coefficients": motion.coefficients, "stiffness": motion.stiffness, "parallel": motion.parallel}
    plain = {name: x.astype(object).tolist() for name, x in arrays.items()}
    return {"basis": motion.basis.trajectory.model_dump(), "period": motion.basis.period, **plain}


def motion_of(record: dict[str, Any]) -> Motion:
    """The motion that `motion_record` has written."""
    arrays = [np.array(record[name], float) for name in ("coefficients", "stiffness", "parallel")]
    return Motion(_basis(record["basis"], record["period"]), *arrays)


def _basis(trajectory: dict[str, Any], period: float) -> Basis:
    return make_basis(TypeAdapter(Trajectory).validate_python(trajectory), period)


def _start_record(start: Start) -> dict[str, Any]:
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
    limited: bool
    finished: bool
    repeats: int | None = None

    def start(self) -> Start:
        claimed = np.inf if self.claimed is None else self.claimed
        return Start(**(self.model_dump() | {"claimed": claimed, "x": None}))
