"""Result files: NetCDF, readable without pkmsea, which stand alone.

Dimensions time, drive, joint, axis; every array carries its unit. What pkmsea needs to load a solution again (task,
mechanism with its meshes, flat output, versions, solver record) stands beside the series as plain numbers and JSON
text; nothing is executable.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from pkmsea.actuation import Actuation
from pkmsea.description import CompleteDescription, meshes, read
from pkmsea.errors import InputError, blaming
from pkmsea.files import is_file
from pkmsea.mechanism import Mechanism, build_mechanism, plane
from pkmsea.mechanism.model import build_model
from pkmsea.motion import Motion
from pkmsea.problem import build_problem
from pkmsea.solution import netcdf
from pkmsea.solution.netcdf import Dataset
from pkmsea.solution.records import StartRecord, basis_of
from pkmsea.solution.solution import FORMAT, MESH, Mesh, Solution
from pkmsea.task import Task

OLDER = {"pkmsea result 1", "pkmsea result 2"}


def read_dataset(path: str | Path) -> Dataset:
    """Read a result file as it is.

    Raises
    ------
    InputError : the file is missing, damaged, or not a result of this pkmsea.
    """
    file = Path(path)
    if not is_file(file):
        raise InputError("There is no such result file.", "Give a file that 'pkmsea solve' wrote.", file=file)
    try:
        dataset = netcdf.read(file)
    except Exception as error:
        cause = " ".join(str(error).split())
        raise InputError(f"The result file cannot be read ({cause}).", "Solve the task again.", file=file) from error
    found = str(dataset.attrs.get("format"))
    if found in OLDER:
        raise InputError(
            "An older pkmsea wrote this result, without its mechanism.",
            "Solve its task again.",
            file=file,
            key="format",
            value=found,
        )
    if found.startswith(FORMAT.rpartition(" ")[0]) and found != FORMAT:
        raise InputError("A newer pkmsea wrote this result.", "Update pkmsea.", file=file, key="format", value=found)
    if found != FORMAT:
        raise InputError("This is not a result of pkmsea.", f"Give a file of format '{FORMAT}'.", file=file)
    return dataset


def load(path: str | Path) -> Solution:
    """Load a solution; its energies are evaluated anew, not believed. It needs no other file."""
    file = Path(path)
    dataset = read_dataset(file)
    record = dataset.attrs
    with damaged(file):
        task = Task.model_validate_json(record["task"])
        with blaming(file):
            problem = build_problem(task, record["setup"], mechanism=_mechanism(record["mechanism"]))
        basis = basis_of(json.loads(record["basis"]), task.cycle.period)
        parallel = np.stack([dataset.numbers(name) for name in ("parallel_stiffness", "parallel_rest")], axis=1)
        motion = Motion(basis, dataset.numbers("flat_output"), dataset.numbers("stiffness"), parallel)
        _check_motion(motion, problem.actuation)
        starts = tuple(r.start() for r in TypeAdapter(tuple[StartRecord, ...]).validate_json(record["starts"]))
        found = TypeAdapter(tuple[Mesh, ...]).validate_json(record["meshes"])
        claimed, seconds, stated = (_finite(record[key], key) for key in ("claimed", "seconds", problem.cost.name))
        return Solution(problem, motion, claimed, starts, found, seconds, stated=stated, file=file)


@contextmanager
def damaged(file: Path | None) -> Iterator[None]:
    """Where what a result file lacks or holds amiss raises InputError."""
    try:
        yield
    except (KeyError, ValueError, TypeError, RecursionError) as error:
        cause = " ".join(str(error).split())
        raise InputError(f"The result file is damaged ({cause}).", "Solve the task again.", file=file) from error


@lru_cache(maxsize=16)
def _mechanism(text: str) -> Mechanism:
    """Of a description as JSON; results share it, and its Functions."""
    return build_mechanism(CompleteDescription.model_validate_json(text))


def changed(path: Path) -> str:
    """What to say where the mechanism's own files describe another one now than the result file does, else nothing."""
    with damaged(path), blaming(path):
        description = CompleteDescription.model_validate_json(read_dataset(path).attrs["mechanism"])
    source = description.origin.sidecar or description.origin.tree
    if not is_file(source):
        return ""
    try:
        said = read(source).seeded(description.origin.seed)
        same = description.fits(plane.put_right(said, build_model(said)))
    except InputError:
        same = False
    return "" if same else f"{source} has changed since {path} was solved; the result keeps the mechanism as it was"


@contextmanager
def mesh_folder(solution: Solution) -> Iterator[Path]:
    """A folder in which the meshes of a solution's mechanism lie: its own, or one of the file's copies, which goes."""
    if solution.file is None:
        yield solution.problem.mechanism.description.origin.meshes
        return
    arrays = netcdf.read(solution.file).arrays.values()
    with TemporaryDirectory(prefix="pkmsea-") as folder:
        meshes.unpack({x.attrs[MESH]: x.values.tobytes() for x in arrays if MESH in x.attrs}, Path(folder))
        yield Path(folder)


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
