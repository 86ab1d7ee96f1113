"""Feed-forward files: what `pkmsea.solution.feedforward` gives, written as CSV or NetCDF, whole or not at all."""

from __future__ import annotations

import csv
from functools import partial
from pathlib import Path

import numpy as np

from pkmsea.errors import InputError, Unverified
from pkmsea.files import write_whole
from pkmsea.solution import netcdf
from pkmsea.solution.feedforward import Sampling, feedforward
from pkmsea.solution.netcdf import Dataset
from pkmsea.solution.solution import Solution
from pkmsea.solution.store import load

RATE = 1000.0  # [Hz]


def export(
    source: Solution | str | Path, path: str | Path, rate: float = RATE, *, unverified: bool = False
) -> Sampling:
    """Write the feed-forward of a solution, or of a result file, for one period; returns its sampling.

    `rate` [Hz] is raised until a whole number of samples fits the period. `path` ends with .csv or .nc. A result that
    is not verified is written with `unverified` only, and says so in its head.

    Raises
    ------
    InputError : a bad rate or path, or the result file is missing or damaged.
    Unverified : the result is not verified.
    """
    target = Path(path)
    if target.suffix.lower() not in (".csv", ".nc"):
        raise InputError("A feed-forward file is CSV or NetCDF.", "Let its name end with .csv or .nc.", file=target)
    if not isinstance(source, Solution) and target.resolve() == Path(source).resolve():
        raise InputError("This would overwrite the result itself.", "Choose another file with -o.", file=target)
    solution = source if isinstance(source, Solution) else load(source)
    sampling = Sampling.at_least(rate, solution.problem.cycle.period)
    if not (solution.verified or unverified):
        raise Unverified(
            f"The result is {solution.status}.",
            "Solve the task again with more starts or knots, or export it all the same with --unverified "
            "(in Python: unverified=True).",
            file=None if isinstance(source, Solution) else Path(source),
        )
    dataset = feedforward(solution, sampling)
    if target.suffix.lower() == ".csv":
        write_whole(target, partial(_write_csv, dataset))
    else:
        netcdf.write(dataset, target)
    return sampling


def _write_csv(dataset: Dataset, path: Path) -> None:
    """Head and meanings behind '#', a row of names with units, then numbers that read back to the last bit."""
    columns = dataset.arrays
    with path.open("w", newline="", encoding="utf-8") as file:
        file.writelines(f"# {key}: {value}\n" for key, value in dataset.attrs.items())
        file.writelines(f"# {name}: {x.attrs['long_name']}\n" for name, x in columns.items() if name != "time")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow([f"{name} [{x.attrs['units']}]" for name, x in columns.items()])
        writer.writerows(np.column_stack([x.values for x in columns.values()]).tolist())
