"""Result files: NetCDF through xarray, readable without pkmsea; written whole or not at all.

Dimensions time, drive, joint, axis; every variable carries its unit. What pkmsea needs to load a solution again (task,
flat output, versions, solver record) stands beside the series as plain numbers and JSON text; nothing is executable.
"""

from __future__ import annotations

import json
import os
import tempfile
from collections.abc import Callable
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from pkmsea.errors import InputError
from pkmsea.problem import build_problem
from pkmsea.solution.audit import series
from pkmsea.solution.solution import Mesh, Solution
from pkmsea.solver import Outcome, Start
from pkmsea.task import Fourier, Spline, Task
from pkmsea.transcription import Motion
from pkmsea.transcription.bases import Basis, make_basis

FORMAT = "pkmsea result 1"
POINTS = 1000  # of the stored series, per period, at least
PER_COEFFICIENT = 20  # and at least so many per coefficient of the basis: a torque can be interpolated between them
PACKAGES = ("pkmsea", "casadi", "pin", "numpy")


def to_dataset(solution: Solution) -> xr.Dataset:
    """The labelled time series of a solution, with its record as attributes."""
    problem, audit, optimality = solution.problem, solution.audit(), solution.optimality()
    actuation, mechanism = problem.actuation, problem.actuation.mechanism
    s = series(problem, solution.motion, max(POINTS, PER_COEFFICIENT * solution.motion.basis.size))
    revolute = mechanism.revolute
    force = ["N m" if revolute[i] else "N" for i in mechanism.actuated]
    angle = ["rad" if turning else "m" for turning in revolute]
    energy = np.cumsum(np.maximum(s.power, 0)) * problem.cycle.period / s.t.size
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
        "axis": list(mechanism.sidecar.end_effector.coordinates),
        "output": actuation.flat_outputs,
        "joint_unit": ("joint", angle),
        "force_unit": ("drive", force),
    }
    record = {
        "format": FORMAT,
        "setup": problem.setup.name,
        "task": problem.task.model_dump_json(),
        "task_file": str(problem.task.file.resolve()) if problem.task.file else "",
        "basis": solution.motion.basis.trajectory.model_dump_json(),
        "energy_true": audit.energy,
        "energy_claimed": solution.claimed,
        "status": solution.status,
        "audit": json.dumps(asdict(audit)),
        "optimality": json.dumps(optimality and asdict(optimality)),
        "optima": json.dumps([asdict(optimum) for optimum in solution.optima]),
        "starts": json.dumps([_start_record(start) for start in solution.starts]),
        "meshes": json.dumps([asdict(mesh) for mesh in solution.meshes]),
        "seconds": solution.seconds,
        "versions": json.dumps({name: version(name) for name in PACKAGES}),
    }
    return xr.Dataset(variables, coordinates, record)


def save(solution: Solution, path: Path) -> Path:
    """Write the result file under a temporary name and move it into place."""
    dataset = to_dataset(solution)
    write_whole(path, lambda temporary: dataset.to_netcdf(temporary, engine="h5netcdf"))
    return path


def write_whole(path: Path, write: Callable[[Path], Any]) -> None:
    """Call `write` with a temporary path beside `path` and rename it: the file is there whole, or not at all.

    Raises
    ------
    InputError : the folder cannot be written to.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.stem}-", suffix=path.suffix)
        os.close(handle)
        temporary = Path(name)
        try:
            write(temporary)
            temporary.chmod(0o644)
            temporary.replace(path)
        finally:
            temporary.unlink(missing_ok=True)
    except OSError as error:
        raise InputError(
            f"The file cannot be written ({error.strerror or error}).", "Choose another output folder with -o.",
            file=path,
        ) from error  # fmt: skip


def read_dataset(path: str | Path) -> xr.Dataset:
    """Read a result file as it is.

    Raises
    ------
    InputError : the file is missing, damaged, or not a result of pkmsea.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError("There is no such result file.", "Give a file that 'pkmsea solve' wrote.", file=file)
    try:
        with xr.open_dataset(file, engine="h5netcdf") as opened:
            dataset = opened.load()
    except Exception as error:
        raise InputError(f"The result file cannot be read ({error}).", "Solve the task again.", file=file) from error
    if dataset.attrs.get("format") != FORMAT:
        raise InputError("This is not a result of pkmsea.", f"Give a file of format '{FORMAT}'.", file=file)
    return dataset


def load(path: str | Path) -> Solution:
    """Load a solution; its energies are evaluated anew, not believed."""
    file = Path(path)
    dataset = read_dataset(file)
    record = dataset.attrs
    try:
        task = Task.model_validate_json(record["task"])
        task._file = Path(record["task_file"]) if record["task_file"] else None
        problem = build_problem(task, record["setup"])
        basis = _basis(json.loads(record["basis"]), task.cycle.period)
        parallel = np.stack([dataset[name].values for name in ("parallel_stiffness", "parallel_rest")], axis=1)
        motion = Motion(basis, dataset["flat_output"].values.copy(), dataset["stiffness"].values.copy(), parallel)
        starts = tuple(_start(r) for r in json.loads(record["starts"]))
        meshes = tuple(Mesh(**r) for r in json.loads(record["meshes"]))
        return Solution(
            problem, motion, float(record["energy_claimed"]), starts, meshes, float(record["seconds"]),
            stated=float(record["energy_true"]),
        )  # fmt: skip
    except (KeyError, ValueError, TypeError) as error:
        raise InputError(f"The result file is damaged ({error}).", "Solve the task again.", file=file) from error


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
    kind: type[Fourier] | type[Spline] = Fourier if trajectory["kind"] == "fourier" else Spline
    return make_basis(kind.model_validate(trajectory), period)


def _start_record(start: Start) -> dict[str, Any]:
    kept = asdict(start) | {"outcome": start.outcome.value, "energy": start.energy if start.usable else None}
    del kept["x"]
    return kept


def _start(record: dict[str, Any]) -> Start:
    record = record | {
        "outcome": Outcome(record["outcome"]), "stiffness": tuple(record["stiffness"]), "x": None,
        "energy": np.inf if record["energy"] is None else record["energy"],
    }  # fmt: skip
    return Start(**record)
