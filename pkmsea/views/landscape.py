"""Energy over two parameters of a study on a grid, as filled contours; over three, as slices of the third."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import matplotlib
import numpy as np
from matplotlib.artist import setp
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from scipy.interpolate import RegularGridInterpolator
from scipy.ndimage import distance_transform_edt

from pkmsea.study import StudyResult
from pkmsea.study.answers import Axis, Mark, Part, parts_of, title_of
from pkmsea.study.table import UNVERIFIED, VERIFIED
from pkmsea.views.study_panels import put

FINE = 8  # drawn intervals per interval of the grid
LEVELS = 13
CUT = 0.75  # share of the points whose energies set the colours
FAR = 2.0  # how many times that range the largest energy may reach without being cut off
SLICES = 6
WIDTH, HEIGHT = 4.9, 4.3  # of a panel [in]
COLUMNS = 3
ENTRY = 2.4  # width of a legend's entry [in]
LABELLED = 6  # optima whose energies are written beside them, where there is
LINE = 11.0  # from one label to the next [points]
ROOM = np.array([36.0, 10.0])  # what a label fills [points]
INCH = 72.0  # [points]
ROUNDING = 1e-9
STAR, OTHER, BEST = "#ffffff", "#f4b6c2", "#ffd166"
HALO = [withStroke(linewidth=2.2, foreground="#222222")]


@dataclass(frozen=True)
class Scale:
    """Contour levels [J]; larger energies share one more colour if there is an `excess`."""

    levels: np.ndarray
    excess: Literal["max", "neither"]


def landscapes(result: StudyResult, axes: Sequence[Axis]) -> Figure:
    """One panel per case and setup: least energy over two parameters, with optima and all that is not verified."""
    parts = parts_of(result)
    columns = len(result.study.names) if len(result.study.names) > 1 else min(len(parts), COLUMNS)
    lines = math.ceil(len(parts) / columns)
    figure = Figure(figsize=(WIDTH * columns + 0.5, HEIGHT * lines + 1.0), layout="constrained")
    panels = figure.subplots(lines, columns, squeeze=False).ravel()
    for panel, part in zip(panels, parts, strict=False):
        scale = scale_of(part.solved["energy"])
        filled = draw(panel, part, axes, scale, part.marks(axes), part.best())
        panel.set_title(f"{title_of(part, result.study)}\n{_headline(part)}", fontsize=10)
        if filled is not None:
            _colour_bar(figure, filled, panel)
    for panel in panels[len(parts) :]:
        panel.remove()
    figure.suptitle(result.study.name, fontsize=13)
    _explain(figure, panels)
    return figure


def slices(result: StudyResult, axes: Sequence[Axis]) -> Figure:
    """A row of panels per case and setup: the first two parameters at some values of the third, in one colour scale."""
    parts, third = parts_of(result), axes[2]
    every = np.unique(np.concatenate([part.rows[third.name] for part in parts]))
    count = min(SLICES, max(len(every), 1))
    figure = Figure(figsize=(2.9 * count + 1.4, 3.6 * len(parts) + 1.0), layout="constrained")
    rows: Any = figure.subfigures(len(parts), 1, squeeze=False)[:, 0]
    drawn: list[Any] = []
    for inner, part in zip(rows, parts, strict=True):
        row = inner.subplots(1, count, squeeze=False, sharex=True, sharey=True)[0]
        inner.suptitle(f"{title_of(part, result.study)}, {_headline(part)}", fontsize=10)
        best, scale, filled = part.best(), scale_of(part.solved["energy"]), None
        thirds = _spread(every, best[third.name] if best else third.ends[0], count)
        marks = part.marks(axes)
        for panel, value in zip(row, thirds, strict=False):
            inside = replace(part, rows=part.rows[part.rows[third.name] == value])
            near = [m for m in marks if thirds[np.abs(third.even(thirds) - third.even(m.at[2])).argmin()] == value]
            here = best if best and best[third.name] == value else None
            filled = draw(panel, inside, axes[:2], scale, near, here) or filled
            panel.set_title(third.value(value), fontsize=9)
            panel.label_outer()
        for panel in row[len(thirds) :]:
            panel.set_axis_off()
        if filled is not None:
            _colour_bar(inner, filled, list(row))
        drawn += list(row)
    figure.suptitle(result.study.name, fontsize=13)
    _explain(figure, drawn)
    return figure


def scale_of(energies: Any) -> Scale:
    """Levels at equal steps of the root of what exceeds the least energy, since that grows with the square of the
    distance from an optimum; a few huge energies do not decide where they end.
    """
    known = np.sort(np.asarray(energies, float))
    if not known.size:
        return Scale(np.array([0.0, 1.0]), "neither")
    low, middle, high = known[0], float(np.quantile(known, CUT)), known[-1]
    cut = high - low > FAR * (middle - low) > 0
    pad = ROUNDING * max(abs(high), ROUNDING)
    levels = low - pad + ((middle if cut else high) - low + 2 * pad) * np.linspace(0, 1, LEVELS) ** 2
    return Scale(levels, "max" if cut else "neither")


def draw(
    panel: Any, part: Part, axes: Sequence[Axis], scale: Scale, marks: Sequence[Mark], best: dict[str, Any] | None
) -> Any | None:
    """Contours, points that are not verified or failed, the best point and the optima; returns the contours."""
    x, y = axes
    put(x, panel, "x")
    put(y, panel, "y")
    panel.set(xlim=x.ends, ylim=y.ends, facecolor="#eeeeee")
    filled = _contours(panel, part, x, y, scale)
    hollow, cross = {"facecolors": "none", "edgecolors": "w", "marker": "o"}, {"color": "#ff6b6b", "marker": "x"}
    common = {"s": 18, "lw": 1.1, "clip_on": False, "zorder": 3, "path_effects": HALO}
    for rows, name, style in ((part.unverified, "not verified", hollow), (part.failed, "failed", cross)):
        if len(rows):
            panel.scatter(rows[x.name], rows[y.name], label=name, **common, **style)
    if best:
        panel.scatter(
            best[x.name], best[y.name], s=60, marker="s", facecolors="none", edgecolors=BEST, lw=2, zorder=4,
            label="best point of the grid", clip_on=False, path_effects=HALO,
        )  # fmt: skip
    _optima(panel, marks)
    return filled


def _contours(panel: Any, part: Part, x: Axis, y: Axis, scale: Scale) -> Any | None:
    energy = part.solved.pivot(index=y.name, columns=x.name, values="energy")
    columns, index = np.unique(part.rows[x.name]), np.unique(part.rows[y.name])
    E = energy.reindex(index=index, columns=columns).to_numpy(float)
    if min(E.shape) < 2 or not np.isfinite(E).any():
        return None
    V, U = (np.linspace(0, n - 1, FINE * (n - 1) + 1) for n in E.shape)
    u, v = x.even(columns), y.even(index)
    fine_u, fine_v = np.interp(U, np.arange(u.size), u), np.interp(V, np.arange(v.size), v)
    X, Y = np.exp(fine_u) if x.logarithmic else fine_u, np.exp(fine_v) if y.logarithmic else fine_v
    surface = RegularGridInterpolator((v, u), _filled(E), method="pchip" if min(E.shape) > 3 else "linear")
    fine = surface(np.stack(np.meshgrid(fine_v, fine_u, indexing="ij"), axis=-1))
    for row, column in np.argwhere(~np.isfinite(E)):
        fine[np.abs(V - row)[:, None] + np.abs(U - column) < 1] = np.nan
    colors = BoundaryNorm(scale.levels, matplotlib.colormaps["viridis"].N, extend=scale.excess)
    return panel.contourf(X, Y, fine, levels=scale.levels, cmap="viridis", norm=colors, extend=scale.excess)


def _filled(E: np.ndarray) -> np.ndarray:
    """Gaps with the nearest energy: only what lies between three solved points is drawn beside a gap."""
    _, nearest = distance_transform_edt(~np.isfinite(E), return_indices=True)
    return np.asarray(E[tuple(nearest)])


def _optima(panel: Any, marks: Sequence[Mark]) -> None:
    """Optima with their energies; those outside the grid stand at its border."""
    written: list[np.ndarray] = []
    for i, mark in enumerate(marks):
        color, marker, size = (STAR, "*", 190) if mark.best else (OTHER, "D", 34)
        name = "co-optimised" if mark.best else "its other local optima"
        panel.scatter(
            *mark.at[:2], s=size, marker=marker, facecolors="none" if mark.outside else color, edgecolors=color, lw=1.4,
            path_effects=HALO, zorder=5 if mark.best else 4.5, clip_on=False,
            label=f"{name}, outside the grid" if mark.outside else name,
        )  # fmt: skip
        if i < LABELLED:
            written.append(_label(panel, mark, color, written))


def _label(panel: Any, mark: Mark, color: str, written: Sequence[np.ndarray]) -> np.ndarray:
    """Write the energy beside a mark, above or below other labels; returns the place of the text [points]."""
    size = panel.bbox.size * INCH / panel.figure.dpi
    share = panel.transAxes.inverted().transform(panel.transData.transform(mark.at[:2]))
    left, top = share * size > size - ROOM
    lines = [-1, -2, -3, -4] if top else [0, 1, -1, 2, -2, 3, -3]
    texts = {n: share * size + [-ROOM[0] * left, LINE * n] for n in lines}
    free = [n for n, text in texts.items() if all((np.abs(text - other) >= ROOM).any() for other in written)]
    line = free[0] if free else lines[0]
    panel.annotate(
        f"{mark.energy:#.4g}", mark.at[:2], (-8 if left else 8, LINE * line - 3), textcoords="offset points",
        color=color, fontsize=8 if mark.best else 7, ha="right" if left else "left", path_effects=HALO, zorder=6,
    )  # fmt: skip
    return np.asarray(texts[line])


def _colour_bar(figure: Any, filled: Any, panels: Any) -> None:
    """With as many digits as tell the levels apart."""
    levels = filled.levels
    digits = next((n for n in range(3, 9) if len({f"{x:.{n}g}" for x in levels}) == len(levels)), 9)
    above = f"; all above {levels[-1]:.3g} J in one colour" if filled.extend == "max" else ""
    bar = figure.colorbar(filled, ax=panels, label=f"E [J]{above}", ticks=levels, spacing="uniform")
    bar.ax.set_yticklabels([f"{x:.{digits}g}" for x in levels], fontsize=8)


def _headline(part: Part) -> str:
    """The optimum's true energy and springs, or the best point's."""
    row = part.optimum or part.best()
    if row is None:
        return "no point was solved"
    kind = "co-optimised" if part.optimum else "co-optimisation failed; best point" if part.failure else "best point"
    status = "" if row["status"] == VERIFIED else f", {UNVERIFIED}"
    c = ", ".join(f"{row[name]:.3g}" for name in part.springs)
    return f"{kind}: {row['energy']:#.4g} J at c = ({c}){status}"


def _explain(figure: Figure, panels: Iterable[Any]) -> None:
    """One legend of the marks that occur."""
    handles: dict[str, Any] = {}
    for panel in panels:
        for handle, name in zip(*panel.get_legend_handles_labels(), strict=True):
            handles.setdefault(name, handle)
    if handles:
        columns = min(len(handles), int(figure.get_figwidth() / ENTRY))
        legend = figure.legend(
            list(handles.values()), list(handles), loc="outside lower center", ncols=columns, fontsize=8,
            facecolor="#d9d9d9",
        )  # fmt: skip
        for handle in filter(None, legend.legend_handles):
            setp(handle, sizes=[40.0])


def _spread(values: np.ndarray, contained: float, count: int) -> np.ndarray:
    """Some of the values, evenly spread in their order; the one nearest to `contained` is replaced by it."""
    if not values.size:
        return values
    chosen = np.linspace(0, len(values) - 1, count).round().astype(int)
    wanted = int(np.abs(values - contained).argmin())
    chosen[np.abs(chosen - wanted).argmin()] = wanted
    return np.unique(values[chosen])
