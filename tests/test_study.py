"""Studies: the same table whoever solves the points, in whatever order and after whatever interruption."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import yaml
from test_cli import expect
from test_cli import run as run_command
from test_process import in_threads

from pkmsea.description import find
from pkmsea.errors import InputError, PkmseaError, Unverified, Unwritable
from pkmsea.problem import build_problem
from pkmsea.solution import solve
from pkmsea.solution.store import load
from pkmsea.study import calibrate, jobs, load_study, pool, run_study
from pkmsea.study.calibrate import with_numbers
from pkmsea.study.jobs import PointJob, run
from pkmsea.study.order import Order, Wait
from pkmsea.study.points import levels, points_of
from pkmsea.study.table import Table
from pkmsea.task import Task

TASK = {
    "name": "axis",
    "cycle": {"period": 2.0, "points": [{"at": [0.7], "rest": 0.275, "window": 1e-3},
                                        {"at": [1.1], "rest": 0.275, "window": 1e-3}]},
    "setups": [
        {"name": "rigid", "mechanism": "linear_axis_1",
         "drives": {"kind": "rigid", "inertia": 5, "friction": 2, "copper_loss": 1.5e-3}},
        {"name": "elastic", "mechanism": "linear_axis_1",
         "drives": {"kind": "sea", "inertia": 5, "friction": 2, "copper_loss": 1.5e-3,
                    "stiffness": {"bounds": [5, 1000]}}},
    ],
    "options": {"starts": 1, "meshes": 2, "trajectory": {"kind": "fourier", "order": 8}},
}  # fmt: skip
ROOM = 60_000  # bytes: the table has room, a result file has not
STUDY: dict[str, Any] = {
    "name": "springs and time", "task": "task.yaml", "setups": ["elastic"],
    "vary": {"c": {"log": [40, 160], "count": 3}, "cycle.period": {"range": [1.8, 2.2], "count": 2}},
    "set": {"drives.0.stiffness": "c"}, "rounds": 2, "results": "none",
}  # fmt: skip


def write(folder: Path, study: dict[str, Any], task: dict[str, Any] = TASK) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "task.yaml").write_text(yaml.safe_dump(task))
    (folder / "study.yaml").write_text(yaml.safe_dump(study))
    return folder / "study.yaml"


def plain(table: pd.DataFrame) -> pd.DataFrame:
    """A table without what a clock says."""
    return table.drop(columns="seconds")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("study")
    write(folder, STUDY)
    return folder


@pytest.fixture(scope="module")
def undisturbed(folder: Path) -> pd.DataFrame:
    """The study in one go, in this process."""
    result = run_study(folder / "study.yaml", folder / "alone", workers=1)
    assert (result.table["status"] == "verified").all()
    return plain(result.table)


def test_every_point_is_in_one_level(folder: Path) -> None:
    nine = {"c": {"log": [40, 160], "count": 3}, "cycle.period": {"range": [1.8, 2.2], "count": 3}}
    points = points_of(load_study(write(folder / "nine", STUDY | {"vary": nine})))
    order = [point for level in levels(points) for point in level]
    assert sorted(order) == list(range(9))
    assert [len(level) for level in levels(points)] == [8, 1]
    assert {tuple(points.values[i]) for i in order[:5]} >= {(40, 1.8), (160, 2.2)}  # the corners come early


def test_two_workers_find_the_same_table(folder: Path, undisturbed: pd.DataFrame) -> None:
    """Beside another study in another thread."""
    runs = [lambda n=n: run_study(folder / "study.yaml", folder / f"by_{n}", workers=n) for n in (1, 2)]
    for found in in_threads(runs):
        pd.testing.assert_frame_equal(plain(found.table), undisturbed)


def test_no_cluster_at_the_address(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    cluster = pytest.importorskip("pkmsea.study.cluster")
    monkeypatch.setattr(cluster, "PATIENCE", 2)
    with pytest.raises(InputError, match="scheduler"):
        run_study(folder / "study.yaml", folder / "nowhere", scheduler="tcp://127.0.0.1:9")


STOPPED = """
import os, sys, threading
from pkmsea.study import run_study

def stop(progress):
    if progress.done == 4:
        threading.Timer(0.02, os.kill, (os.getpid(), int(sys.argv[3]))).start()

run_study(sys.argv[1], sys.argv[2], workers=1, progress=stop)
"""


@pytest.mark.parametrize("how", [signal.SIGINT, signal.SIGKILL])
def test_a_stopped_study_goes_on(folder: Path, undisturbed: pd.DataFrame, how: signal.Signals) -> None:
    """Stopped after some of its points, and run again: the same table; nothing is solved twice."""
    out = folder / how.name
    subprocess.run([sys.executable, "-c", STOPPED, "study.yaml", out, str(int(how))], cwd=folder, check=False)
    before = _rows(out)
    assert 4 <= before < 12
    solved: list[int] = []
    found = run_study(folder / "study.yaml", out, workers=1, progress=lambda p: solved.append(p.done))
    assert solved[0] == before
    pd.testing.assert_frame_equal(plain(found.table), undisturbed)


def _rows(out: Path) -> int:
    if not (out / "study.sqlite").exists():
        return 0
    try:
        with sqlite3.connect(f"file:{out / 'study.sqlite'}?mode=ro", uri=True) as base:
            return int(base.execute("SELECT count(*) FROM points").fetchone()[0])
    except sqlite3.OperationalError:
        return 0


def own_mechanism(folder: Path) -> Path:
    """A study of a task that lies with its mechanism, as `pkmsea new` writes it."""
    shutil.copytree(find("linear_axis_1"), folder / "robot")
    task = TASK | {"setups": [TASK["setups"][0] | {"mechanism": "."}]}  # type: ignore[index]
    study = {"name": "period", "task": "robot/task.yaml", "vary": {"cycle.period": {"values": [1.9, 2.0]}}}
    path = write(folder, study, task)
    (folder / "task.yaml").rename(folder / "robot" / "task.yaml")
    return path


def test_from_any_folder_with_any_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parameters that differ in case, a deep expression, results from another folder than the task's; and what else
    lies beside a mechanism changes nothing."""
    path = own_mechanism(tmp_path / "files")
    study = yaml.safe_load(path.read_text()) | {
        "vary": {"k": {"values": [1.8, 2.0]}, "K": {"values": [1.0, 1.1]}},
        "set": {"cycle.period": "-" * 400 + "k*K"},
        "results": "all",
    }
    path.write_text(yaml.safe_dump(study))
    monkeypatch.chdir(tmp_path)
    result = run_study("files/study.yaml", "out", workers=1)
    (best,) = (tmp_path / "out" / "best").iterdir()
    verified = result.table[result.table["status"] == "verified"]
    assert load(best).energy == verified["energy"].min()
    assert sorted(result.table["k"] * result.table["K"]) == pytest.approx([1.8, 1.98, 2.0, 2.2])
    for row in result.table.itertuples():
        solution = load(f"out/results/all/rigid/{row.point}_0.nc")
        assert solution.problem.cycle.period == pytest.approx(row.k * row.K)
        assert result.solution("all", "rigid", row.point).energy == row.energy == solution.energy
    (tmp_path / "files" / "robot" / "notes.txt").write_text("about this robot")
    told: list[int] = []
    run_study("files/study.yaml", "out", workers=1, progress=lambda reached: told.append(reached.done))
    assert told == [4]
    urdf = tmp_path / "files" / "robot" / "linear_axis_1.urdf"
    urdf.write_text(urdf.read_text().replace('mass value="', 'mass value="1'))
    with pytest.raises(InputError, match="its mechanism differed"):
        run_study("files/study.yaml", "out", workers=1)


def test_a_full_disk_leaves_no_failed_row(tmp_path: Path) -> None:
    """The study ends with a word; when there is room, the same call goes on to the end."""
    path = own_mechanism(tmp_path)
    path.write_text(yaml.safe_dump(yaml.safe_load(path.read_text()) | {"results": "all"}))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (ROOM, before[1]))
    try:
        with pytest.raises(Unwritable, match="cannot be written"):
            run_study(path, tmp_path / "out", workers=1)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert (run_study(path, tmp_path / "out", workers=1).table["status"] == "verified").all()


def test_what_crashed_is_solved_again(tmp_path: Path) -> None:
    table = Table(tmp_path / "study.sqlite", ["x"], 1, {})
    for point, outcome in enumerate(("done", "crashed", "failed")):
        table.add({"case": "a", "setup": "s", "point": point, "round": 0, "outcome": outcome})
    table.close()
    assert list(Table(tmp_path / "study.sqlite", ["x"], 1, {}).rows()["outcome"]) == ["done", "failed"]


def test_setups_share_calibrated_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Friction with which the rigid robot needs what it needs with a friction of 3; found once, and kept."""
    finer = TASK | {"options": TASK["options"] | {"meshes": 4, "starts": 1}}  # type: ignore[operator]
    rigid = build_problem(Task.model_validate(finer), "rigid")
    energy = solve(with_numbers(rigid, friction=3.0), workers=1).energy
    calibrate = {"number": "friction", "setup": "rigid", "energy": energy, "start": 2.5, "tolerance": 1e-3}
    vary, cases = {"drives.*.inertia": {"values": [5.0]}}, {"c": {"calibrate": [calibrate]}}
    path = write(tmp_path, {"name": "s", "task": "task.yaml", "vary": vary, "cases": cases}, finer)
    result = run_study(path, tmp_path / "out", workers=1)
    assert list(result.table["friction"]) == pytest.approx([3.0, 3.0], rel=1e-3)
    assert result.table["energy"][1] == pytest.approx(energy, rel=1e-3)
    assert result.solution("c", "rigid", 0).problem.drives[0].friction == result.table["friction"][1]
    with sqlite3.connect(tmp_path / "out" / "study.sqlite") as base:
        base.execute("DELETE FROM points")
    monkeypatch.setattr(jobs, "calibrated", lambda *_: pytest.fail("searched again"))
    again = run_study(path, tmp_path / "out", workers=1)
    pd.testing.assert_frame_equal(plain(again.table), plain(result.table))


def test_an_interrupt_ends_a_calibration(monkeypatch: pytest.MonkeyPatch) -> None:
    module = sys.modules[calibrate.__module__]
    cut = replace(solve(Task.model_validate(TASK), "rigid", workers=1), interrupted=True)
    monkeypatch.setattr(module, "solve", lambda *_, **__: cut)
    with pytest.raises(KeyboardInterrupt):
        calibrate(Task.model_validate(TASK), "rigid", "friction", 4.0, 2.0)


def test_an_energy_that_is_not_verified_calibrates_nothing() -> None:
    coarse = TASK["options"] | {"meshes": 1, "energy_tolerance": 1e-9}  # type: ignore[operator]
    with pytest.raises(Unverified, match=r"friction = 2.* not verified"):
        calibrate(Task.model_validate(TASK | {"options": coarse}), "rigid", "friction", 4.0, 2.0)


def test_a_changed_study_is_noticed(folder: Path, undisturbed: pd.DataFrame) -> None:
    changed = write(folder / "changed", STUDY | {"starts": 2})
    with pytest.raises(InputError, match="study file differed"):
        run_study(changed, folder / "alone")
    task = TASK | {"options": TASK["options"] | {"seed": 1}}  # type: ignore[operator]
    with pytest.raises(InputError, match="its task differed"):
        run_study(write(folder / "changed", STUDY, task), folder / "alone")


def test_failed_points_are_rows(folder: Path) -> None:
    """A period too short for the rests, and one in which the end effector leaves the guide."""
    study = STUDY | {"vary": {"cycle.period": {"values": [0.5, 2.0]}}, "set": {}, "rounds": 1, "optimum": True}
    result = run_study(write(folder / "failing", study), folder / "failing" / "out", workers=1)
    assert list(result.table["status"]) == ["failed", "verified"]
    assert result.solution("all", "elastic", 1).energy == pytest.approx(result.table["energy"][1], rel=1e-12)
    with pytest.raises(InputError, match="no solution"):
        result.solution("all", "elastic", 0)
    assert "overlap" in result.table["reason"][0]
    assert result.optima["energy"][0] == pytest.approx(result.table["energy"][1], rel=1e-3)  # the period is 2 s already


def test_search_finds_the_best_period(folder: Path) -> None:
    """An outer loop over the period: longer is cheaper, and the same trials come again after a stop."""
    pytest.importorskip("optuna")
    study = STUDY | {"vary": {"cycle.period": {"range": [1.5, 2.5]}}, "set": {}, "rounds": 1, "starts": 1,
                     "sample": {"kind": "search", "count": 6, "together": 3}}  # fmt: skip
    path = write(folder / "search", study)
    result = run_study(path, folder / "search" / "out", workers=1)
    best = result.table.sort_values("energy").iloc[0]
    assert best["cycle.period"] == result.table["cycle.period"].max() > 2.2
    again = run_study(path, folder / "search" / "again", workers=1)
    pd.testing.assert_frame_equal(plain(again.table), plain(result.table))


class Deadly:
    """Dies once at one of its jobs, taking the worker's process with it."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __call__(self, job: int) -> int:
        if job == 1 and not self.mark.exists():
            self.mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return job


def test_a_killed_worker_costs_no_point(tmp_path: Path) -> None:
    more = iter([range(4), (4, 5)])
    rows = list(pool.Pool(2).unordered(Deadly(tmp_path / "mark"), lambda: next(more, ()), lambda job: -job))
    assert sorted(rows) == list(range(6))


def test_a_key_is_ready_once_all_that_it_waits_for_is_settled() -> None:
    """b waits for a; c for b, and has nothing to do; d for c."""
    needs = {"a": "", "b": "a", "c": "b", "d": "c"}

    def examine(key: str) -> str | Wait[str] | None:
        if needs[key] and needs[key] not in order.settled:
            return Wait(needs[key])
        return None if key == "c" else key.upper()

    order: Order[str, str] = Order(examine)
    assert order.add("dcb") == ["A"]  # nobody adds a
    assert order.add("a") == []
    assert order.settle("a") == ["B"]
    assert order.settle("b") == ["D"] and order.settled == {"a", "b", "c"}


def test_an_unexpected_error_is_a_row() -> None:
    """That tells nothing of the point: it is solved again the next time."""
    row = run(PointJob(key=("all", "elastic", 0, 0), problem=None)).found  # type: ignore[arg-type]
    assert (row["status"], row["outcome"]) == ("failed", "crashed") and "AttributeError" in row["reason"]


def test_command(tmp_path: Path) -> None:
    """Solves, draws and tells; goes on with what is there; bad input ends with exit code 2 and no traceback."""
    study = STUDY | {"vary": {"cycle.period": {"values": [1.9, 2.1]}}, "set": {}, "setups": ["rigid", "elastic"],
                     "results": "best"}  # fmt: skip
    path, out = write(tmp_path / "files", study), tmp_path / "out"
    command = [str(Path(sys.executable).with_name("pkmsea")), "study", str(path), "-o", str(out), "--workers", "1"]
    first = subprocess.run(command, capture_output=True, text=True)
    assert first.returncode == 0, first.stderr
    assert first.stderr == ""  # no progress where nobody looks
    written = {file.relative_to(out).as_posix() for file in out.rglob("*") if file.is_file()}
    assert written == {
        "study.sqlite",
        "points.csv",
        "optima.csv",
        "study.png",
        "best/all_rigid.nc",
        "best/all_elastic.nc",
    }
    assert run_command(*command[1:]).stdout == first.stdout
    write(tmp_path / "files", study | {"vary": {"cycle.period": {"values": [float("nan")]}}})
    expect(run_command(*command[1:]), 2, "study.yaml, vary.cycle.period.values.0")


@pytest.fixture
def base(tmp_path: Path) -> Iterator[Path]:
    yield tmp_path


@pytest.mark.parametrize(
    ("change", "key", "text"),
    [
        ({"vary": {"drives.0.stifness": {"values": [1.0]}}, "set": {}}, "vary.drives.0.stifness", "stiffness"),
        ({"vary": {"cycle.periode": {"values": [1.0]}}, "set": {}}, "vary.cycle.periode", "period"),
        ({"vary": {"mechanism.joint.nobody.origin.x": {"values": [1.0]}}, "set": {}}, "vary.mechanism", "joint"),
        ({"vary": {"c": {"log": [1, 100]}}}, None, "vary.c has no count"),
        ({"vary": {"c": {"values": []}}}, "vary.c.values", "at least 1"),
        ({"vary": {"c": {"range": [5, 5], "count": 3}}}, "vary.c", "empty"),
        ({"vary": {"c": {"range": [float("nan"), 5], "count": 3}}}, "vary.c.range.0", "finite"),
        ({"vary": {"c": {"log": [0, 5], "count": 3}}}, "vary.c.log.0", "greater than 0"),
        ({"vary": {f"{x}": {"log": [1, 5], "count": 1000} for x in "abc"}, "set": {"cycle.period": "a*b*c"}}, None,
         "points, more than"),
        ({"vary": {"energy": {"values": [1.0]}}}, None, "names a column"),
        ({"set": {"drives.0.stiffness": "k"}}, "set.drives.0.stiffness", "'k'"),
        ({"set": {"drives.0.stiffness": "c.__class__"}}, "set.drives.0.stiffness", "arithmetic"),
        ({"set": {"drives.0.stiffness": "c", "cycle.period": "9**9**9**9"}}, "set.cycle.period", "power"),
        ({"setups": ["nobody"]}, "setups", "elastic"),
        ({"task": "nowhere.yaml"}, None, "does not exist"),
        ({"sample": {"kind": "sobol", "count": 5}}, "sample", "power of two"),
        ({"starts": 0, "neighbours": 0}, None, "nothing to begin from"),
        ({"unknown": 1}, "unknown", "not known"),
    ],
)  # fmt: skip
def test_bad_study_files(base: Path, change: dict[str, Any], key: str | None, text: str) -> None:
    with pytest.raises(PkmseaError, match=text) as caught:
        run_study(write(base, STUDY | change), base / "out")
    assert caught.value.exit_code == 2
    assert key is None or str(caught.value.key).startswith(key), caught.value
    assert not list(base.glob("out/*.sqlite"))


def test_changed_geometry(tmp_path: Path) -> None:
    """A joint moved, and a link stretched as a rod, arrive in the model."""
    from pkmsea.mechanism import load_mechanism
    from pkmsea.study.geometry import changed_mechanism

    before = load_mechanism("pkm_2rrr")
    folder, missing = changed_mechanism(
        find("pkm_2rrr"), {"joint.A.origin.x": 0.01, "link.upper_B.length": 0.22, "joint.Z.origin.x": 1.0}, tmp_path
    )
    after = load_mechanism(folder)
    assert list(missing) == ["joint.Z.origin.x"]
    moved, stretched = (before.model.getJointId(name) for name in ("A", "elbow_B"))
    offset = after.model.jointPlacements[moved].translation - before.model.jointPlacements[moved].translation
    np.testing.assert_allclose(offset, [0.01, 0, 0], atol=1e-9)
    lengths = [np.linalg.norm(m.model.jointPlacements[stretched].translation) for m in (before, after)]
    np.testing.assert_allclose(lengths, [0.2, 0.22])
    upper = before.model.getJointId("B")
    rods = [m.model.inertias[upper] for m in (before, after)]
    np.testing.assert_allclose(rods[1].mass, 1.1 * rods[0].mass)
    np.testing.assert_allclose(rods[1].inertia, 1.1**3 * rods[0].inertia, rtol=1e-6)
    assert np.abs(after.closure_residual(after.seed)).max() < 1e-9


def test_drives_are_found_in_the_files_as_they_are(tmp_path: Path) -> None:
    """The sidecar names the drives in another order between two calls: each changes the drive that has the name."""
    from conftest import RIGID

    from pkmsea.study.changes import changed_task

    robot = tmp_path / "robot"
    shutil.copytree(find("pkm_2rrr"), robot)
    setup = {"name": "arms", "mechanism": str(robot), "drives": [RIGID, RIGID]}
    task = Task.model_validate(TASK | {"setups": [setup]})
    sidecar = yaml.safe_load((robot / "mechanism.yaml").read_text())
    changed = []
    for order in (["A", "B"], ["B", "A"]):
        (robot / "mechanism.yaml").write_text(yaml.safe_dump(sidecar | {"actuated": order}))
        drives = changed_task(task, {"drives.B.inertia": 1.0}, tmp_path).setups[0].drives
        changed.append([drive.inertia == 1.0 for drive in drives])
    assert changed == [[False, True], [True, False]]
