"""The figure of a study, chosen by what it varies, and its points as CSV."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from pkmsea.files import write_whole
from pkmsea.study import Study, StudyResult
from pkmsea.study.answers import Axis, Part, axes_of, parts_of
from pkmsea.study.study import Grid, Search
from pkmsea.views.landscape import landscapes, slices
from pkmsea.views.scatter import scatter
from pkmsea.views.sweep import sweep

STIFFNESS = "[N m/rad or N/m]"


def study_figure(result: StudyResult) -> Figure:
    """Energies [J] of a study.

    One varied parameter: lines, with what the other setups need relative to the first. A grid of two: contours of the
    least energy. Of three: slices of the third. Samples, searches and larger grids: energy against each parameter.
    """
    study = result.study
    axes = varied(result.study)
    if len(axes) == 1 and not isinstance(study.sample, Search):
        return sweep(result, axes[0])
    if isinstance(study.sample, Grid) and len(axes) == 2:
        return landscapes(result, axes)
    if isinstance(study.sample, Grid) and len(axes) == 3:
        return slices(result, axes)
    return scatter(result, axes)


def varied(study: Study) -> list[Axis]:
    """Parameters with more than one value; the first one if there is none."""
    axes = axes_of(study)
    if not isinstance(study.sample, Grid):
        return axes
    return [axis for axis in axes if study.vary[axis.name].size > 1] or axes[:1]


def write_points(result: StudyResult, folder: Path) -> list[Path]:
    """Write points.csv, the best row of every point, and optima.csv, the local optima of the task as it says itself;
    units stand in the headers. Returns the paths."""
    units = {"energy": "[J]", "claimed": "[J]", "seconds": "[s]"}
    units |= {axis.name: f"[{axis.unit}]" for axis in axes_of(result.study) if axis.unit}
    optima = [row for part in parts_of(result) for row in _optima(part)]
    frames = {"points.csv": result.table, "optima.csv": pd.DataFrame(optima)}
    paths = []
    for name, frame in frames.items():
        springs = {column: STIFFNESS for column in frame.columns if column.startswith("c_")}
        headed = frame.rename(columns={column: f"{column} {unit}" for column, unit in (units | springs).items()})
        path = folder / name
        write_whole(path, lambda temporary, headed=headed: headed.to_csv(temporary, index=False))  # type: ignore[misc]
        paths.append(path)
    return paths


def _optima(part: Part) -> list[dict[str, Any]]:
    """The chosen optimum, with its true energy, then the others as their starts claim them."""
    if part.optimum is None:
        return []
    key = {"case": part.case, "setup": part.setup}
    chosen = {name: part.optimum[name] for name in ("energy", "claimed", "status", *part.springs)}
    others = [
        {"claimed": other["claimed"], **dict(zip(part.springs, other["stiffness"], strict=True))}
        for other in part.others()
    ]
    return [key | {"optimum": i} | row for i, row in enumerate([chosen, *others], 1)]
