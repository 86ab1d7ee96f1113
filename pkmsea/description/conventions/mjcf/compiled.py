"""MuJoCo's compiler, without its log file and without what it remembers of other models."""

from __future__ import annotations

import copy
import threading
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

import mujoco
import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from pkmsea.description.surfaces import FORMATS
from pkmsea.errors import MechanismError, one_line

WORDS = 500  # characters of MuJoCo's longest messages
ROOT = "mujoco"  # element
QUIET = threading.Lock()  # what is set for a compilation is the whole process's


class Mesh(NamedTuple):
    """A mesh file relative to the model's folder, and where it lies in the mesh as MuJoCo has compiled it."""

    file: str
    scale: np.ndarray
    placement: pin.SE3


def compile_model(file: Path, files: Mapping[str, Sequence[Path]]) -> tuple[mujoco.MjModel, dict[int, Mesh]]:
    """The compiled model, and by their index the meshes that can be drawn from a file; `files` are those it names.

    Raises
    ------
    MechanismError : the file does not compile; with MuJoCo's words.
    """
    folder = file.parent.resolve()
    try:
        with _quiet():
            spec = mujoco.MjSpec.from_file(str(folder / file.name))
            model = spec.compile()
    except Exception as error:
        words, _, place = one_line(str(error), WORDS).partition(" Element ")
        raise MechanismError(
            f"MuJoCo does not compile this file ({words}).", "Mend it there.", file=file, key=place or ROOT
        ) from error
    meshes = {mesh.id: _mesh(model, mesh, files.get(mesh.file, ()), folder) for mesh in spec.meshes}
    return model, {i: mesh for i, mesh in meshes.items() if mesh}


@contextmanager
def _quiet() -> Iterator[None]:
    """MuJoCo writes no MUJOCO_LOG.TXT, and caches no mesh: 3.10 takes one from there as another model has placed it."""
    with QUIET, warnings.catch_warnings(action="ignore"):
        cache, said = mujoco.mj_getCache(), mujoco.MjLogConfig.get()
        capacity, silent = mujoco.mj_getCacheCapacity(cache), copy.copy(said)
        silent.logto_file = silent.logto_console = False
        try:
            silent.set()
            mujoco.mj_setCacheCapacity(cache, 0)
            yield
        finally:
            said.set()
            mujoco.mj_setCacheCapacity(cache, capacity)


def _mesh(model: mujoco.MjModel, mesh: mujoco.MjsMesh, named: Sequence[Path], folder: Path) -> Mesh | None:
    """MuJoCo takes the vertices of a file from its reference, scales them, and moves them to their principal axes."""
    scale, reference = model.mesh_scale[mesh.id], pose(mesh.refpos, mesh.refquat).inverse()
    file = next((path for path in named if path.suffix.lower() in FORMATS), None)
    if file is None or (np.ptp(scale) and reference.rotation.trace() < 3):  # scaled along other axes than the file's
        return None
    scaled = pin.SE3(reference.rotation, scale * reference.translation)
    placement = pose(model.mesh_pos[mesh.id], model.mesh_quat[mesh.id]).inverse() * scaled
    return Mesh(quote(file.relative_to(folder).as_posix()), scale, placement)


def pose(position: ArrayLike = (0.0, 0.0, 0.0), quaternion: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> pin.SE3:
    """A placement from MuJoCo's numbers, w first."""
    w, x, y, z = np.array(quaternion, float)
    rotation = pin.Quaternion(w, x, y, z).normalized().matrix()
    return pin.SE3(rotation, np.array(position, float))
