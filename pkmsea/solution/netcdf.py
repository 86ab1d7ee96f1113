"""NetCDF files of named arrays with dimensions and attributes, through h5netcdf; nothing in them is executable."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5netcdf
import h5py
import numpy as np

from pkmsea.files import write_whole

MAX_BYTES = 1_000_000_000  # of all arrays in a file that is read; a result's finest mesh has a third of it


@dataclass(frozen=True, eq=False)
class Array:
    """Numbers, bytes or texts over named dimensions, with their unit and meaning."""

    dims: tuple[str, ...]
    values: np.ndarray
    attrs: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Dataset:
    """What a file holds: arrays by name, and attributes of the whole, numbers or texts."""

    arrays: Mapping[str, Array]
    attrs: Mapping[str, Any]

    def numbers(self, name: str) -> np.ndarray:
        """An array as float64. ValueError where it holds anything else, KeyError where it is missing."""
        values = self.arrays[name].values
        if values.dtype.kind not in "fiu":
            raise ValueError(f"'{name}' does not hold numbers")
        return values.astype(float)


def write(dataset: Dataset, path: Path) -> None:
    """Write a file, whole or not at all; in memory first, because HDF5 does not survive a full disk."""
    content = io.BytesIO()
    with h5netcdf.File(content, "w") as file:
        for name, array in dataset.arrays.items():
            for dim, size in zip(array.dims, array.values.shape, strict=True):
                file.dimensions.setdefault(dim, size)
            text, packed = array.values.dtype.kind == "O", array.values.dtype == np.uint8
            variable = file.create_variable(
                name,
                array.dims,
                dtype=h5py.string_dtype() if text else array.values.dtype,
                data=array.values,
                compression="gzip" if packed else None,
            )
            variable.attrs.update(array.attrs)
        file.attrs.update(dataset.attrs)
    write_whole(path, lambda temporary: temporary.write_bytes(content.getbuffer()))


def read(path: Path) -> Dataset:
    """Read a file.

    Raises
    ------
    ValueError : it would fill the memory or read from other files. Others, of h5py : it is no such file, or damaged.
    """
    _check(path)
    with h5netcdf.File(path, "r", decode_vlen_strings=True) as file:
        arrays = {
            name: Array(variable.dimensions, np.asarray(variable[...]), dict(variable.attrs))
            for name, variable in file.variables.items()
        }
        return Dataset(arrays, dict(file.attrs))


def _check(path: Path) -> None:
    with h5py.File(path) as raw:
        if not all(isinstance(raw.get(name, getlink=True), h5py.HardLink) for name in raw):
            raise ValueError("it links to elsewhere")
        series = list(raw.values())
        if not all(isinstance(x, h5py.Dataset) and not x.external and not x.is_virtual for x in series):
            raise ValueError("it holds other things than series of its own")
        if sum(x.size * x.dtype.itemsize for x in series if x.size) > MAX_BYTES:
            raise ValueError(f"it declares more than {MAX_BYTES} bytes")
