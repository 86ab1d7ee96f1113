"""Figures, tables and files of studies, from rows that are made up: what they promise to show is there."""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import ELASTIC, RIGID, task
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from rich.console import Console

from pkmsea.study import Progress, Study, StudyResult
from pkmsea.study.answers import axes_of, parts_of
from pkmsea.study.table import DONE, FAILED, UNVERIFIED, VERIFIED
from pkmsea.views import study_table
from pkmsea.views.figures import save_figure
from pkmsea.views.scatter import FAILED_AT
from pkmsea.views.study import study_figure, write_points
from pkmsea.views.sweep import crossings, relative

REASON = "no two successive meshes agree"
BROKEN = "Infeasible: no motion"
TIME = {"cycle.period": {"range": [0.5, 2.0], "count": 7, "label": "T_P [s]"}}
SPRINGS = {f"c{i}": {"log": [0.01, 1], "count": 3, "label": f"c_{i} [N m/rad]"} for i in (1, 2, 3)}
SETUPS = [
    {"name": "rigid", "mechanism": "pkm_2rrr", "drives": RIGID},
    {"name": "SEA", "mechanism": "pkm_2rrr", "drives": ELASTIC},
]


def row(setup: str, point: int, values: dict[str, float], energy: float | None, **more: Any) -> dict[str, Any]:
    status = FAILED if energy is None else VERIFIED
    whole = {
        "case": "all", "setup": setup, "point": point, "round": 0, **values, "c_1": None, "c_2": None, "c_3": None,
        "outcome": FAILED if energy is None else DONE, "energy": energy, "claimed": energy, "status": status,
        "reason": BROKEN if energy is None else "", "starts": 2, "seconds": 1.0, "optima": None, "motion": "{}",
        "meshes": "[]", "task": "{}",
    }  # fmt: skip
    return whole | more


def result(rows: Sequence[dict[str, Any]], vary: dict[str, Any], folder: Path = Path(), **keys: Any) -> StudyResult:
    study = Study.model_validate({"name": "made up", "task": "task.yaml", "vary": vary} | keys)
    study._task = task("pkm_2rrr", RIGID, setups=SETUPS)
    return StudyResult(study, pd.DataFrame(rows), folder, False)


def sweep(**changes: Any) -> StudyResult:
    """The elastic setup needs 1.2 - 0.2 t^2 of what the rigid one needs, which is 1 J: it pays from t = 1 s."""
    rows = []
    for point, t in enumerate(np.linspace(0.5, 2.0, 7).tolist()):
        rows.append(row("rigid", point, {"cycle.period": t}, 1.0))
        rows.append(row("SEA", point, {"cycle.period": t}, 1.2 - 0.2 * t**2, c_1=0.1 * t, c_2=0.2 * t))
    rows[-1] |= changes
    return result(rows, TIME)


def landscape(parameters: int, *, failed: int = -1, unverified: int = -1, floor: float = 0.3) -> StudyResult:
    """Energies with one valley at c_i = 0.1, and a co-optimised task with three optima."""
    vary = dict(list(SPRINGS.items())[:parameters])
    rows = []
    for point, c in enumerate(product([0.01, 0.1, 1.0], repeat=parameters)):
        springs = dict(zip(("c_1", "c_2", "c_3"), c, strict=False))
        energy = floor + float(np.sum(np.log10(np.array(c) / 0.1) ** 2))
        more = {"status": UNVERIFIED, "reason": f"{REASON} ({point} J)"} if point == unverified else {}
        values = dict(zip(vary, c, strict=True))
        rows.append(row("SEA", point, values, None if point == failed else energy, **springs, **more))
    own = [0.11, 0.12, 0.4][:parameters]
    optima = [{"claimed": 0.29, "stiffness": own}, {"claimed": 0.35, "stiffness": [0.5] * parameters},
              {"claimed": 0.4, "stiffness": [5.0] * parameters}]  # fmt: skip
    springs = dict(zip(("c_1", "c_2", "c_3"), own, strict=False))
    rows.append(row("SEA", -1, dict.fromkeys(vary), 0.2912345, **springs, optima=json.dumps(optima)))  # type: ignore[arg-type]
    keys = {f"drives.{i}.stiffness": name for i, name in enumerate(vary)}
    return result(rows, vary, set=keys, setups=["SEA"], optimum=True)


def marks(figure: Figure, name: str) -> np.ndarray:
    """Places of all markers of a legend entry, (marks, 2)."""
    found = [np.asarray(s.get_offsets()) for axes in figure.axes for s in axes.collections if s.get_label() == name]
    found += [line.get_xydata() for axes in figure.axes for line in axes.lines if line.get_label() == name]
    return np.concatenate(found) if found else np.empty((0, 2))


def texts(figure: Figure, folder: Path) -> str:
    """The figure as SVG, where all that is written stands as text."""
    return save_figure(figure, folder / "figure.svg").read_text()


def test_springs_pay_from_where_the_ratio_passes_one(tmp_path: Path) -> None:
    """Between the points 0.75 s and 1 s the ratio 1.0875 falls to 1, and stays below."""
    found = sweep()
    rigid, elastic = parts_of(found)
    (crossing,) = crossings(relative(rigid, elastic, axes_of(found.study)[0]), axes_of(found.study)[0])
    assert crossing.at == pytest.approx(1.0)
    assert crossing.pays and crossing.verified
    figure = study_figure(found)
    name = "SEA pays from T_P = 1 s"
    assert marks(figure, name) == pytest.approx(np.array([[1.0, 1.0]]))
    assert name in texts(figure, tmp_path)


@pytest.mark.parametrize("name", ["x", "ratio"])
@pytest.mark.parametrize("logarithmic", [False, True])
def test_crossings_lie_between_points(logarithmic: bool, name: str) -> None:
    """Linear interpolation from 0.9 at x = 1 to 1.2 at x = 8: a third of the way, in x or in its logarithm."""
    kind = {"log": [1, 8]} if logarithmic else {"range": [1, 8]}
    rows = [row("rigid", i, {name: x}, 1.0) for i, x in enumerate((1.0, 8.0))]
    rows += [row("SEA", i, {name: x}, e) for i, (x, e) in enumerate(((1.0, 0.9), (8.0, 1.2)))]
    rows[-1] |= {"status": UNVERIFIED, "reason": REASON}
    found = result(rows, {name: kind | {"count": 2}})
    (axis,) = axes_of(found.study)
    (crossing,) = crossings(relative(*parts_of(found), axis), axis)
    assert crossing.at == pytest.approx(2.0 if logarithmic else 1 + 7 / 3)
    assert crossing.label("SEA", axis) == f"SEA pays up to {name} = {crossing.at:.3g} (not verified)"


def test_failed_points_are_gaps_and_never_crossings() -> None:
    """The ratio passes 1 at a failed point: what lies between is not known."""
    found = sweep()
    failed = (found.rows["setup"] == "SEA") & (found.rows["point"] == 2)
    assert found.rows.loc[failed, "cycle.period"].item() == 1.0
    rows = found.rows.assign(status=found.rows["status"].mask(failed, FAILED), energy=found.rows["energy"].mask(failed))
    broken = result(rows.to_dict("records"), TIME)
    assert crossings(relative(*parts_of(broken), axes_of(broken.study)[0]), axes_of(broken.study)[0]) == []
    figure = study_figure(broken)
    assert marks(figure, "SEA: failed").tolist() == [[1.0, FAILED_AT]]
    (line,) = [line for line in figure.axes[0].lines if line.get_label() == "SEA"]
    assert np.isnan(line.get_ydata()).tolist() == [False, False, True, False, False, False, False]  # type: ignore[arg-type]


def test_sweeps_show_springs_and_what_is_not_verified(tmp_path: Path) -> None:
    said = texts(study_figure(sweep()), tmp_path)
    assert "SEA: c_2" in said and "optimal stiffness" in said and "not verified" not in said
    assert "not verified" in texts(study_figure(sweep(status=UNVERIFIED, reason=REASON)), tmp_path)


def test_landscapes_show_optima_and_what_went_wrong(tmp_path: Path) -> None:
    figure = study_figure(landscape(2, failed=0, unverified=8))
    assert marks(figure, "co-optimised") == pytest.approx(np.array([[0.11, 0.12]]))
    assert marks(figure, "its other local optima") == pytest.approx(np.array([[0.5, 0.5]]))
    assert marks(figure, "its other local optima, outside the grid") == pytest.approx(np.array([[1.0, 1.0]]))
    assert marks(figure, "best point of the grid") == pytest.approx(np.array([[0.1, 0.1]]))
    assert marks(figure, "failed") == pytest.approx(np.array([[0.01, 0.01]]))
    assert marks(figure, "not verified") == pytest.approx(np.array([[1.0, 1.0]]))
    said = texts(figure, tmp_path)
    assert [text.get_text() for text in figure.axes[0].texts] == ["0.2912", "0.3500", "0.4000"]
    for written in ("made up", "co-optimised: 0.2912 J", "c_1 [N m/rad]"):
        assert written in said
    assert figure.axes[0].get_xscale() == "log"


def test_contours_have_a_gap_around_a_failed_point() -> None:
    (contours,) = [x for x in study_figure(landscape(2, failed=0)).axes[0].collections if isinstance(x, ContourSet)]
    for c, covered in ((0.011, False), (0.025, False), (0.09, True), (0.3, True)):
        assert any(path.contains_point((c, c)) for path in contours.get_paths()) == covered


def test_huge_energies_in_a_corner_do_not_flatten_the_colours(tmp_path: Path) -> None:
    rows = landscape(2).rows
    corner = rows["point"] == 0
    found = result(
        rows.assign(energy=rows["energy"].mask(corner, 1000.0)).to_dict("records"), dict(list(SPRINGS.items())[:2])
    )
    figure = study_figure(found)
    assert "in one colour" in texts(figure, tmp_path)
    assert figure.axes[1].get_ylim()[1] < 10


def test_slices_put_each_optimum_on_the_nearest_one(tmp_path: Path) -> None:
    """c_3 = 0.4 is nearer to 1 than to 0.1 on the logarithmic axis."""
    figure = study_figure(landscape(3))
    panels = {axes.get_title(): axes for axes in figure.axes if axes.get_title()}
    assert list(panels) == ["c_3 = 0.01 N m/rad", "c_3 = 0.1 N m/rad", "c_3 = 1 N m/rad"]
    stars = {title: [s for s in axes.collections if s.get_label() == "co-optimised"] for title, axes in panels.items()}
    assert [len(found) for found in stars.values()] == [0, 0, 1]
    assert "co-optimised: 0.2912 J" in texts(figure, tmp_path)


@pytest.mark.parametrize("kind", ["sobol", "search"])
def test_samples_are_drawn_against_each_parameter(kind: str, tmp_path: Path) -> None:
    vary = {"a": {"range": [0, 1]}, "b": {"log": [1, 100]}}
    energies = [3.0, 2.0, None, 4.0, 1.5, 1.0, 5.0, 1.2]
    rows = [row("SEA", i, {"a": i / 8, "b": 10 ** (i / 4)}, e) for i, e in enumerate(energies)]
    rows[5] |= {"status": UNVERIFIED, "reason": REASON}
    found = result(rows, vary, setups=["SEA"], sample={"kind": kind, "count": 8})
    figure = study_figure(found)
    assert [axes.get_xlabel() for axes in figure.axes[:2]] == ["a", "b"]
    assert marks(figure, "SEA: best, 1.2 J") == pytest.approx(np.array([[7 / 8, 1.2], [10 ** (7 / 4), 1.2]]))
    assert marks(figure, "SEA: not verified")[:, 1].tolist() == [1.0, 1.0]
    assert marks(figure, "SEA: failed")[0].tolist() == [2 / 8, FAILED_AT]
    if kind == "search":
        (best,) = [x for x in figure.axes[2].lines if x.get_drawstyle() == "steps-post"]
        assert np.asarray(best.get_ydata()).tolist() == [3.0, 2.0, 2.0, 2.0, 1.5, 1.5, 1.5, 1.2]
    assert "made up" in texts(figure, tmp_path)


@pytest.mark.parametrize("parameters", [1, 2, 3])
def test_figures_of_studies_that_were_stopped_early(parameters: int, tmp_path: Path) -> None:
    whole = landscape(parameters)
    for count in (0, 1, 2):
        stopped = StudyResult(whole.study, whole.rows.head(count), tmp_path, True)
        assert "made up" in texts(study_figure(stopped), tmp_path)


@pytest.mark.parametrize("parameters", [1, 2, 3])
def test_an_optimum_without_any_point(parameters: int, tmp_path: Path) -> None:
    whole = landscape(parameters)
    rows = whole.rows.to_dict("records")
    nothing = {
        "energy": None,
        "claimed": None,
        "status": FAILED,
        "outcome": FAILED,
        "c_1": None,
        "c_2": None,
        "c_3": None,
    }
    rows = [x | nothing if x["point"] >= 0 else x for x in rows]
    empty = StudyResult(whole.study, pd.DataFrame(rows), tmp_path, False)
    assert "made up" in texts(study_figure(empty), tmp_path)
    (part,) = study_table.study_record(empty)["results"]
    assert part["best"] is None and part["optimum"]["energy"] == 0.2912345
    assert pd.read_csv(write_points(empty, tmp_path)[1])["claimed [J]"].tolist() == [0.2912345, 0.35, 0.4]


def test_a_sweep_of_a_stiffness_shows_optima(tmp_path: Path) -> None:
    figure = study_figure(landscape(1))
    assert marks(figure, "SEA: co-optimised, 0.2912 J") == pytest.approx(np.array([[0.11, 0.2912345]]))
    assert marks(figure, "SEA: its other local optima") == pytest.approx(np.array([[0.5, 0.35], [1.0, 0.4]]))


def test_points_and_optima_as_csv(tmp_path: Path) -> None:
    found = landscape(2, failed=0)
    points, optima = (pd.read_csv(path) for path in write_points(found, tmp_path))
    table = found.table
    assert points["energy [J]"].to_numpy() == pytest.approx(table["energy"].to_numpy(float), rel=1e-15, nan_ok=True)
    assert points["c1 [N m/rad]"].to_numpy() == pytest.approx(table["c1"].to_numpy(float), rel=1e-15)
    assert points["status"].tolist() == table["status"].tolist()
    assert optima["optimum"].tolist() == [1, 2, 3]
    assert optima["energy [J]"].tolist()[0] == 0.2912345
    assert optima["claimed [J]"].tolist()[1:] == [0.35, 0.4]


def test_records_count_points_and_compare_with_the_optimum() -> None:
    record = study_table.study_record(landscape(2, failed=0, unverified=8))
    (part,) = json.loads(json.dumps(record))["results"]
    assert [part[key] for key in ("done", "verified", "not_verified", "failed")] == [9, 7, 1, 1]
    assert part["reasons"] == {FAILED: BROKEN, UNVERIFIED: f"{REASON} (8 J)"}
    assert part["best"]["parameters"] == {"c1": 0.1, "c2": 0.1}
    assert part["optimum"]["gain"] == pytest.approx(1 - 0.2912345 / 0.3)
    assert [x["claimed"] for x in part["optimum"]["other_optima"]] == [0.35, 0.4]


def test_an_optimum_that_failed_is_told(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    found = landscape(2)
    own = found.rows["point"] == -1
    rows = found.rows.assign(
        status=found.rows["status"].mask(own, FAILED), reason=found.rows["reason"].mask(own, BROKEN)
    )
    broken = result(rows.to_dict("records"), dict(list(SPRINGS.items())[:2]), setups=["SEA"], optimum=True)
    out = io.StringIO()
    monkeypatch.setattr(study_table, "console", lambda: Console(file=out, width=200))
    study_table.print_study(broken)
    assert f"all, SEA: co-optimised: {BROKEN}" in out.getvalue()
    assert "co-optimisation failed" in texts(study_figure(broken), tmp_path)


def test_the_table_tells_the_most_frequent_reason(monkeypatch: pytest.MonkeyPatch) -> None:
    found = landscape(2)
    rows = found.rows.to_dict("records")
    for i, reason in enumerate((f"{REASON} (1.2e-3 J)", "a limit is overstepped", f"{REASON} (0.4 J)")):
        rows[i] |= {"status": UNVERIFIED, "reason": reason}
    out = io.StringIO()
    monkeypatch.setattr(study_table, "console", lambda: Console(file=out, width=200))
    study_table.print_study(result(rows, dict(list(SPRINGS.items())[:2]), setups=["SEA"]))
    assert f"2 of 3 not verified: {REASON} (1.2e-3 J)" in out.getvalue()
    assert "9 of 9" in out.getvalue() and "0.3000" in out.getvalue()


def test_progress_is_silent_when_piped(capsys: pytest.CaptureFixture[str]) -> None:
    with study_table.study_progress() as tell:
        tell(Progress(done=3, failed=1, total=9, best=0.3))
    assert capsys.readouterr() == ("", "")
