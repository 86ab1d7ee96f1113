"""The command line: bad input gets one paragraph with cause and remedy, exit code 2, and never a traceback."""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from conftest import DIAGONAL, ELASTIC, RIGID
from typer.testing import CliRunner

from pkmsea.cli import app
from pkmsea.description import find
from pkmsea.ending import print_error
from pkmsea.errors import PkmseaError

TASK = {
    "name": "test",
    "cycle": {"period": 1.0, "points": DIAGONAL},
    "setups": [{"name": "robot", "mechanism": "pkm_2rrr", "drives": RIGID}],
    "options": {"starts": 2},
}


Ended = subprocess.CompletedProcess[str]


def start(*arguments: str | Path) -> Ended:
    command = [str(Path(sys.executable).with_name("pkmsea")), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=300)


def run(*arguments: str | Path) -> Ended:
    """The same in this process, which has imported everything."""
    command, errors = list(map(str, arguments)), io.StringIO()
    ended = CliRunner().invoke(app, command)
    if isinstance(ended.exception, PkmseaError):
        with contextlib.redirect_stderr(errors):
            print_error(ended.exception)
        return Ended(command, ended.exception.exit_code, ended.stdout, ended.stderr + errors.getvalue())
    if ended.exception is not None and not isinstance(ended.exception, SystemExit):
        raise ended.exception
    return Ended(command, ended.exit_code, ended.stdout, ended.stderr)


def write_task(folder: Path, **changes: object) -> Path:
    path = folder / "task.yaml"
    path.write_text(yaml.safe_dump(TASK | changes))
    return path


def copy_mechanism(folder: Path, urdf: tuple[str, str] = ("", ""), sidecar: tuple[str, str] = ("", "")) -> Path:
    """A copy of pkm_2rrr with one text replaced in its files."""
    target, source = folder / "robot", find("pkm_2rrr")
    target.mkdir()
    for name, (old, new) in (("pkm_2rrr.urdf", urdf), ("mechanism.yaml", sidecar)):
        text = (source / name).read_text()
        assert old in text
        (target / name).write_text(text.replace(old, new, 1) if old else text)
    return target


def expect(process: Ended, code: int, *parts: str) -> None:
    assert process.returncode == code, process.stderr
    message = " ".join(process.stderr.split())
    for part in parts:
        assert part in message, message
    assert "Traceback" not in process.stderr + process.stdout
    assert len(process.stderr.strip().split("\n\n")) == 1


def test_urdf_that_does_not_parse(tmp_path: Path) -> None:
    folder = copy_mechanism(tmp_path, urdf=("</robot>", ""))
    for command in (start, run):
        expect(command("check", folder), 2, "pkm_2rrr.urdf", "does not parse", "Mend the XML at that line")


def test_closure_of_an_unknown_frame(tmp_path: Path) -> None:
    folder = copy_mechanism(tmp_path, sidecar=("[tip_A, tip_B]", "[tip_A, tip_X]"))
    expect(run("check", folder), 2, "mechanism.yaml", "closures.0.frames", "'tip_X'", "tip_B")


def test_negative_mass(tmp_path: Path) -> None:
    folder = copy_mechanism(tmp_path, urdf=('mass value="0.1104"', 'mass value="-0.1104"'))
    expect(run("check", folder), 2, "pkm_2rrr.urdf", "link 'upper_A': mass = -0.1104", "cannot be negative")


def test_unreachable_operating_point(tmp_path: Path) -> None:
    points = [DIAGONAL[0], {"at": [0.4, 0.4], "rest": 0.1, "window": 1e-3}]
    path = write_task(tmp_path, cycle={"period": 1.0, "points": points})
    expect(run("solve", path), 2, "task.yaml", "cycle.points.1.at", "out of reach", "gets as far as", "Move it")


def test_rest_window_outside_the_workspace(tmp_path: Path) -> None:
    points = [DIAGONAL[0], {"at": [0.07, 0.07], "rest": 0.1, "window": 0.2}]
    path = write_task(tmp_path, cycle={"period": 1.0, "points": points})
    expect(run("solve", path), 2, "rest window of operating point 2 is out of reach", "shrink its window")


def test_stiffness_bound_of_zero(tmp_path: Path) -> None:
    drives = ELASTIC | {"stiffness": {"bounds": [0.0, 1.0]}}
    path = write_task(tmp_path, setups=[TASK["setups"][0] | {"drives": drives}])
    expect(run("solve", path), 2, "task.yaml", "stiffness", "bounds.0 = 0.0", "greater than 0")


def test_infeasible_period(tmp_path: Path) -> None:
    drives = RIGID | {"torque": 0.01}
    points = [point | {"rest": 0.02} for point in DIAGONAL]
    setups = [TASK["setups"][0] | {"drives": drives}]
    options = {"starts": 2, "iterations": 100}
    path = write_task(tmp_path, cycle={"period": 0.25, "points": points}, setups=setups, options=options)
    expect(run("solve", path, "--workers", "1"), 1, "No motion was found", "Lengthen the period")


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("name: [", ("not valid YAML",)),
        ("- 1\n- 2\n", ("valid dictionary",)),
        ("a: &x [1]\nb: *x\n", ("aliases",)),
        ("name: a\nname: b\n", ("'name' stands twice",)),
        ("name: t\ncycle: {period: .nan, points: []}\nsetups: []\n", ("cycle.period = nan", "finite")),
        ("name: t\nperiod: 1\ncycle: {}\nsetups: []\n", ("cycle.period", "missing")),
    ],
)
def test_bad_task_files(tmp_path: Path, text: str, parts: tuple[str, ...]) -> None:
    path = tmp_path / "task.yaml"
    path.write_text(text)
    expect(run("solve", path), 2, "task.yaml", *parts)


def test_missing_files(tmp_path: Path) -> None:
    expect(run("solve", tmp_path / "none.yaml"), 2, "does not exist")
    expect(run("check", "no_such_robot"), 2, "pkm_3rrr")
    expect(run("plot", tmp_path / "none.nc"), 2, "no such result file")


def test_solve_plot_and_play(tmp_path: Path) -> None:
    out = tmp_path / "out"
    process = run("solve", write_task(tmp_path), "-o", out, "--json", "--workers", "1")
    assert process.returncode == 0, process.stderr
    (record,) = json.loads(process.stdout)
    assert record["status"] == "verified"
    assert {path.name for path in out.iterdir()} == {"robot.nc", "robot.html", "overview.png"}
    assert run("plot", out / "robot.nc", "-o", tmp_path / "again.pdf").returncode == 0
    page = tmp_path / "again.html"
    assert run("play", out / "robot.nc", "--html", page).returncode == 0
    text = page.read_text()
    assert "MeshCat.Viewer" in text and "<script src" not in text and "<link" not in text


def test_check_prints_what_design_asks_for() -> None:
    process = start("check", "pkm_3rrr", "--json")
    record = json.loads(process.stdout)
    assert record["mobility"] == 2
    assert record["actuation_class"] == "redundantly actuated"
    assert np_shape(record["H_A"]) == (3, 2)


def np_shape(rows: list[list[float]]) -> tuple[int, int]:
    return len(rows), len(rows[0])


@pytest.mark.parametrize("kind", ["mechanism", "task"])
def test_schema(kind: str) -> None:
    assert json.loads(run("schema", kind).stdout)["type"] == "object"
