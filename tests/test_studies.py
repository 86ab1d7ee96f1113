"""The study files of the examples, each run with a few points, and what physics says about their answers."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pkmsea.files import read_yaml
from pkmsea.paper.readings import calibrated_numbers, paper_tables
from pkmsea.solution import solve
from pkmsea.study import Study, StudyResult, load_study, run_study, with_drive_numbers
from pkmsea.study.study import check_names
from pkmsea.study.tasks import task_at
from pkmsea.task import load_task

STUDIES = Path(__file__).parents[1] / "examples" / "studies"
FILES = {str(file.relative_to(STUDIES)): file for file in sorted(STUDIES.rglob("*.yaml")) if "vary" in read_yaml(file)}
NUMERICAL = 2e-3  # relative: one start, two meshes
CALIBRATED = 1e-2  # relative: the study's tolerance, and its coarse splines


def reduced(file: Path, cases: Sequence[str]) -> Study:
    """The study with the ends of every interval, and the middle of up to two, the last of listed values, one start and
    two meshes."""
    data = read_yaml(file)
    for varied in data["vary"].values():
        few = {"count": 3 if len(data["vary"]) < 3 else 2}
        varied |= few if "count" in varied else {"values": varied["values"][-1:]}
    if cases:
        data["cases"] = {name: data["cases"][name] for name in cases}
    data["set"] = data.get("set", {}) | {"options.starts": 1, "options.meshes": 2}
    data |= {"task": str((file.parent / data["task"]).resolve()), "rounds": 1, "results": "none"}
    study = Study.model_validate(data)
    check_names(study)
    return study


def energies(table: pd.DataFrame, *by: str) -> pd.DataFrame:
    """Energy [J] by setup, over cases and parameters."""
    return table.pivot_table("energy", ["case", *by], "setup")


def cycle_time(result: StudyResult) -> None:
    """A shorter cycle costs more; stiff springs are rigid, so the best ones are never worse."""
    energy = energies(result.table, "cycle.period")
    for _, of_case in energy.groupby("case"):
        assert (of_case.diff().dropna() < 0).all(axis=None)
    assert (energy["PKM SEA"] < (1 + NUMERICAL) * energy["PKM RD"]).all()


def inertia_ratio(result: StudyResult) -> None:
    """Rigid drives pay for their rotors; springs let the heaviest ones swing."""
    energy = energies(result.table, "ratio")
    assert (energy["PKM RD"].diff().dropna() > 0).all()
    assert (energy["PKM SEA"] < (1 + NUMERICAL) * energy["PKM RD"]).all()
    relative = energy["PKM SEA"] / energy["PKM RD"]
    assert relative.iloc[-1] < relative.iloc[0]


def bought_spring(result: StudyResult) -> None:
    """No bought spring is better than the optimal one, and 10 % off costs little."""
    for _, energy in result.table.groupby("case"):
        middle = energy[(energy["f_1"] == 1) & (energy["f_2"] == 1)]["energy"].item()
        assert middle < 1.001 * energy["energy"].min()
        assert energy["energy"].max() < 1.03 * middle


def landscape(result: StudyResult) -> None:
    """Springs that are optimised with the motion are no worse than any on the grid."""
    for row in result.optima.itertuples():
        of_case = result.table[(result.table["case"] == row.case) & (result.table["status"] == "verified")]
        assert row.energy < (1 + NUMERICAL) * of_case["energy"].min()


def base_geometry(result: StudyResult) -> None:
    """The last values are the mirror image of the shipped base: calibrated alike, and of the same energies."""
    table = result.table
    for number, value in {**calibrated_numbers(3), **calibrated_numbers(4)}.items():
        assert np.allclose(table[number].dropna(), value, rtol=CALIBRATED), number
    shipped = load_task(STUDIES / "base_geometry" / "task.yaml").with_starts(1)
    for row in table[table["case"] == "friction"].itertuples():
        task = with_drive_numbers(shipped, copper_loss=row.copper_loss, friction=row.friction)
        assert row.energy == pytest.approx(solve(task, row.setup, workers=1).energy, rel=NUMERICAL)
    ranking = STUDIES / "base_geometry" / "ranking.py"
    csv = result.folder / "ranking.csv"
    subprocess.run([sys.executable, ranking, result.folder, csv], check=True, cwd=result.folder)
    (row,) = pd.read_csv(csv).to_dict("records")
    energy = table[(table["setup"] == "PKM SEA") & (table["case"] == "friction")]["energy"].item()
    assert row["PKM SEA 3"] == pytest.approx(100 * energy / paper_tables()[3]["rows"]["PKM RD"]["energy"], rel=1e-4)
    assert 0 < row["misfit"] < 50


def rest_time(result: StudyResult) -> None:
    """At the rest of 100 ms, the best springs save little, and the paper's own cost more than none."""
    energy = energies(result.table, "rest")
    ratio = (energy["PKM SEA"] / energy["PKM RD"]).droplevel("rest")
    assert 0.92 < ratio["table 3"] < 0.96 and 0.70 < ratio["table 4"] < 0.76
    assert 1.05 < ratio["table 3 at its springs"] < 1.2 and ratio["table 4 at its springs"] > 3
    drawing = STUDIES / "rest_time.py"
    subprocess.run([sys.executable, drawing, result.folder], check=True, cwd=result.folder, capture_output=True)
    assert (result.folder / "rest_time.png").stat().st_size > 10_000


@dataclass(frozen=True)
class Expected:
    """A study's law, the cases in which it is tested, and the share of points that one start may leave unverified."""

    law: Callable[[StudyResult], None]
    cases: tuple[str, ...] = ()
    unverified: float = 0.1


LONG = ("landscape_3_arms.yaml",)  # whose law is that of two arms
SOFT = Expected(landscape, ("friction",), 0.4)  # the softest springs need finer meshes
EXPECTED = {
    "cycle_time.yaml": Expected(cycle_time),
    "inertia_ratio.yaml": Expected(inertia_ratio),
    "bought_spring.yaml": Expected(bought_spring),
    "landscape_2_arms.yaml": SOFT,
    "landscape_3_arms.yaml": SOFT,
    "base_geometry/study.yaml": Expected(base_geometry),
    "rest_time.yaml": Expected(rest_time, unverified=0.2),
}


@pytest.mark.parametrize(
    "file",
    [pytest.param(file, id=name, marks=pytest.mark.long if name in LONG else ()) for name, file in FILES.items()],
)
def test_study(file: Path, tmp_path: Path) -> None:
    """Reduced: every point is solved, most are verified, and the study's law holds."""
    expected = EXPECTED[str(file.relative_to(STUDIES))]
    result = run_study(reduced(file, expected.cases), tmp_path, workers=1)
    faulty = result.rows[result.rows["status"] != "verified"][["case", "setup", "point", "status", "reason"]]
    assert "failed" not in set(faulty["status"]), faulty.to_string()
    assert len(faulty) <= expected.unverified * len(result.rows), faulty.to_string()
    expected.law(result)


def test_optimum_keeps_what_does_not_vary(tmp_path: Path) -> None:
    """Without the varied parameters, springs have the task's bounds again; other numbers stay as study and case say."""
    study = load_study(STUDIES / "bought_spring.yaml")
    varied, optimum = ({"f_1": 1.1, "f_2": 0.9}, None)
    (a, b), kept = (task_at(study, "friction", at, tmp_path).setup("PKM SEA").drives for at in (varied, optimum))
    assert (a.stiffness, b.stiffness) == pytest.approx((1.1 * 0.4444, 0.9 * 0.2139))
    assert all(drive.stiffness == study.base.setup("PKM SEA").drives[0].stiffness for drive in kept)
    assert {(drive.copper_loss, drive.friction) for drive in (a, b, *kept)} == {(63.29, 4.787e-3)}
