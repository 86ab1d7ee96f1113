"""What is not verified, or has failed, is marked so wherever it is shown, and never comes first."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest
import xarray as xr
import yaml
from conftest import RIGID, task
from test_cli import TASK, run

from pkmsea.errors import NotConverged, SolveError
from pkmsea.paper import Row, reproduce
from pkmsea.solution import Solution, solve
from pkmsea.solution.store import load, read_dataset
from pkmsea.task import Task
from pkmsea.verification import verify
from pkmsea.views import figures, playback, records, tables

FAILURE = NotConverged("No start found an optimum.", "Raise options.starts.")
MARK = "(not verified)"
HEAVY = RIGID | {"inertia": 4.4e-4}


@pytest.fixture(scope="module")
def good() -> Solution:
    changes = {"setups": [{"name": name, "mechanism": "pkm_2rrr", "drives": HEAVY} for name in ("good", "bad")]}
    return solve(task("pkm_2rrr", HEAVY, **changes), "good", workers=1)


@pytest.fixture(scope="module")
def bad(good: Solution) -> Solution:
    """Claims less than its motion takes."""
    problem = replace(good.problem, name="bad")
    return replace(good, problem=problem, claimed=0.9 * good.energy)


def test_solution_says_so(good: Solution, bad: Solution) -> None:
    assert (good.label, bad.label) == ("good", f"bad {MARK}")
    assert "verified" in str(good) and "not verified" not in str(good)
    assert "not verified: the transcription claims" in repr(bad)


def test_table_of_solve(good: Solution, bad: Solution, capsys: pytest.CaptureFixture[str]) -> None:
    """The unverified reference comes behind, its ratios carry a star; what failed comes last, with the reason."""
    tables.print_solutions([bad, good], bad, {"stuck": FAILURE})
    out = capsys.readouterr().out
    rows = [line.split()[0] for line in out.splitlines() if line.split()[:1] in (["good"], ["bad"], ["stuck"])]
    assert rows == ["good", "bad", "stuck"]
    assert "100.0%*" in out and "* relative to 'bad', which is not verified" in out
    assert "not verified: the" in out and "failed: No start found an optimum." in " ".join(out.split())
    assert "1, best 1x of 1 starts" in out
    tables.print_solutions([good, bad], good, {})
    assert "*" not in capsys.readouterr().out


def test_records_of_solve(good: Solution, bad: Solution) -> None:
    found = json.loads(json.dumps(records.solutions([bad, good], bad, {"stuck": FAILURE}), allow_nan=False))
    assert [(r["setup"], r["verified"]) for r in found] == [("good", True), ("bad", False), ("stuck", False)]
    assert [r["status"].split(":")[0] for r in found] == ["verified", "not verified", "failed"]
    assert found[0]["reference_verified"] is False and found[2]["energy"] is None
    assert found[0]["optima"][0]["count"] == 1 and found[0]["optimality"]["kind"] == "minimum"


def row(solution: Solution, rigid: Solution | None) -> Row:
    return Row(2, "printed", "title", solution, None, rigid, 0.3, 1.0, (), {})


def test_rows_of_reproduce(good: Solution, bad: Solution, capsys: pytest.CaptureFixture[str]) -> None:
    rows, failures = [row(bad, bad), row(good, bad)], {(2, "printed", "stuck"): FAILURE}
    found = json.loads(json.dumps(records.rows(rows, failures), allow_nan=False))
    assert [(r["setup"], r["verified"]) for r in found] == [("good", True), ("bad", False), ("stuck", False)]
    assert found[0]["reference_verified"] is False and "rigid row is not verified" in found[0]["remark"]
    tables.print_rows(rows, failures)
    out = capsys.readouterr().out
    assert out.index(" good ") < out.index(" bad ") < out.index(" stuck ")
    assert "100.0%*" in out and "not verified:" in out and "failed: No" in out
    tables.print_rows([row(good, None)], {})
    assert "the rigid row has failed" in " ".join(capsys.readouterr().out.split())


def test_a_failed_row_does_not_stop_reproduce(monkeypatch: pytest.MonkeyPatch, good: Solution) -> None:
    def solve_all_but_the_first(task: object, name: str, **_: object) -> Solution:
        if name == "FA-RD":
            raise FAILURE
        return good

    monkeypatch.setattr(import_module("pkmsea.paper.reproduce"), "solve", solve_all_but_the_first)
    failures: list[tuple[int, str, str, SolveError]] = []
    rows = list(reproduce([1], readings=["printed"], failed=lambda *what: failures.append(what)))
    assert failures == [(1, "printed", "FA-RD", FAILURE)]
    assert [(r.ratio, r.reference_verified) for r in rows] == [(None, None)] * 2
    with pytest.raises(NotConverged):
        list(reproduce([1]))


@pytest.mark.parametrize("error", [FAILURE, KeyboardInterrupt()])
def test_a_row_is_kept_where_the_papers_springs_have_no_motion(
    monkeypatch: pytest.MonkeyPatch, good: Solution, error: BaseException
) -> None:
    def solve_free_springs(task: Task, name: str, **_: object) -> Solution:
        if isinstance(task.setup(name).drives[0].stiffness, float):
            raise error
        return good

    monkeypatch.setattr(import_module("pkmsea.paper.reproduce"), "solve", solve_free_springs)
    rows = reproduce([1], readings=["printed"], setups=["FA-RD", "FA-SEA"])
    assert [next(rows).at_paper for _ in range(2)] == [None, None]
    with pytest.raises(KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else StopIteration):
        next(rows)


def test_verify_does_not_confirm_what_the_audit_rejects(bad: Solution, capsys: pytest.CaptureFixture[str]) -> None:
    """The simulation agrees with the motion, but the result claims less; in the table it comes behind."""
    simulated = verify(bad)
    (fault,) = simulated.faults
    assert "by the result's own audit, the transcription claims" in fault
    found = {"bad.nc": simulated, "good.nc": replace(simulated, faults=())}
    failures = {"stuck.nc": FAILURE}
    listed = json.loads(json.dumps(records.verifications(found, failures), allow_nan=False))
    assert [(r["result"], r["verified"]) for r in listed] == [("good.nc", True), ("bad.nc", False), ("stuck.nc", False)]
    tables.print_verifications(found, failures)
    out = capsys.readouterr().out
    assert out.index("good.nc") < out.index("bad.nc") < out.index("stuck.nc") < out.index("bad.nc: not verified")
    papers = replace(found["good.nc"], optimality=None)
    tables.print_verifications({"papers.nc": papers}, {})
    assert "not available" in " ".join(capsys.readouterr().out.split())


def test_figure(good: Solution, bad: Solution) -> None:
    figure = figures.overview([bad, good], ["stuck"])
    panels = [axes for part in figure.subfigs for axes in part.axes]
    titles = {axes.get_title() for axes in panels}
    assert {f"bad {MARK}: positions", f"bad {MARK}: motor torque", "good: positions"} <= titles
    named = [{line.get_label() for line in axes.get_lines()} for axes in panels[:3]]
    assert all(any(f"bad {MARK}" in label for label in labels) for labels in named)
    assert "no result: stuck" in figure.get_suptitle()


def test_playback_page(bad: Solution, tmp_path: Path) -> None:
    page = playback.write_page(bad, tmp_path / "bad.html").read_text(encoding="utf-8")
    assert f"bad {MARK}</title>" in page
    assert "not verified: the transcription claims" in page


def forged(source: Path, target: Path, change: Callable[[xr.Dataset], None]) -> Path:
    with xr.open_dataset(source, engine="h5netcdf") as dataset:
        change(dataset)
        dataset.to_netcdf(target, engine="h5netcdf")
    return target


def test_a_file_is_not_believed(good: Solution, bad: Solution, tmp_path: Path) -> None:
    """Status and energy are those of the motion, whatever the file states; `play` shows what was recomputed."""
    path = bad.save(tmp_path / "bad.nc")
    assert read_dataset(path).attrs["status"].startswith("not verified: ")
    claims = forged(path, tmp_path / "claims.nc", lambda data: data.attrs.update(status="verified"))
    assert load(claims).status == bad.status
    process = run("play", claims, "--html", tmp_path / "claims.html")
    assert "not verified" in process.stdout and "not verified" in (tmp_path / "claims.html").read_text()
    again = load(good.save(tmp_path / "good.nc"))
    assert again.verified and again.optima == good.optima
    cheaper = forged(
        tmp_path / "good.nc", tmp_path / "less.nc", lambda data: data.attrs.update(energy=0.9 * good.energy)
    )
    assert load(cheaper).energy == pytest.approx(good.energy)
    assert "the file states" in load(cheaper).status


def test_command_with_a_failed_setup(tmp_path: Path) -> None:
    """The first setup cannot be solved: the other one has no ratio, and the failure stands last."""
    setups = [
        {"name": "stuck", "mechanism": "pkm_2rrr", "drives": HEAVY | {"torque": 1e-3}},
        {"name": "fine", "mechanism": "pkm_2rrr", "drives": HEAVY},
    ]
    path = tmp_path / "task.yaml"
    path.write_text(yaml.safe_dump(TASK | {"setups": setups, "options": {"starts": 1, "iterations": 50}}))
    process = run("solve", path, "--json", "--workers", "1")
    assert process.returncode == 1 and "No motion was found" in process.stderr
    first, last = json.loads(process.stdout)
    assert (first["setup"], first["verified"], first["ratio"]) == ("fine", True, None)
    assert last["setup"] == "stuck" and last["status"].startswith("failed: No motion was found")
