"""Every entry of the gallery, with one start: verified, and springs save energy."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from test_cli import expect, run

from pkmsea.description.robots import PACKAGE, find_robot
from pkmsea.mechanism import load_mechanism
from pkmsea.solution import solve_all
from pkmsea.task import load_task

GALLERY = Path(__file__).parents[1] / "examples" / "gallery"
ENTRIES = {  # mobility; most that springs in series may leave of the rigid energy
    "five_bar": (2, 0.85),
    "planar_delta": (2, 0.95),
    "four_bar_press": (1, 0.65),
    "two_link_arm": (2, 0.9),
    "elastic_arm": (2, 0.75),
    "ur5": (3, 0.9),
    "linear_axis": (1, 0.75),
}
LONG = ("five_bar", "two_link_arm")


def test_no_entry_is_forgotten() -> None:
    assert {path.parent.name for path in GALLERY.glob("*/task.yaml")} == set(ENTRIES)


@pytest.mark.parametrize(
    "entry", [pytest.param(entry, marks=pytest.mark.long) if entry in LONG else entry for entry in ENTRIES]
)
def test_entry(entry: str) -> None:
    """Rigid, then springs in series, then other springs, each of which beats those in series."""
    mobility, most = ENTRIES[entry]
    rigid, series, *others = solve_all(load_task(GALLERY / entry / "task.yaml").with_starts(1), workers=1)
    assert [s.status for s in (rigid, series, *others)] == ["verified"] * (2 + len(others))
    assert rigid.problem.actuation.mechanism.mobility == mobility
    assert series.energy < most * rigid.energy
    assert all(other.energy < series.energy for other in others)


def test_planar_delta_keeps_its_platform_level() -> None:
    delta = load_mechanism(GALLERY / "planar_delta")
    chain = [delta.joints.index(f"{name}_joint") for name in ("knuckle", "forearm_A", "platform")]
    for point in ((-0.1, -0.5), (0.1, -0.5), (0.05, -0.45)):
        q = delta.configuration(point)
        assert abs(q[delta.actuated[0]] + q[chain].sum()) < 1e-9  # all joints turn about one direction


def test_script(tmp_path: Path) -> None:
    """Picture and table of one entry."""
    arguments = ["--starts", "1", "--only", "elastic_arm", "-o", str(tmp_path)]
    command = [sys.executable, str(GALLERY / "gallery.py"), *arguments]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert "SEA 6" in (tmp_path / "gallery.md").read_text() and (tmp_path / "gallery.png").stat().st_size > 0


def test_robots_by_name(tmp_path: Path) -> None:
    ur5 = find_robot(f"{PACKAGE}/ur5_robot.urdf")
    assert find_robot(f"{PACKAGE}/ur_description/urdf/ur5_robot.urdf") == ur5
    assert load_mechanism(GALLERY / "ur5").description.origin.tree == ur5
    expect(run("check", f"{PACKAGE}/ur6.urdf"), 2, "'ur6.urdf'", "ur5_robot.urdf", "panda.urdf")
    expect(run("check", f"{PACKAGE}/anymal.urdf"), 2, "2 robots", "anymal_c_simple_description")
    sidecar = tmp_path / "mechanism.yaml"
    sidecar.write_text(f"urdf: {PACKAGE}/../ur6.urdf\n")
    expect(run("check", tmp_path), 2, "mechanism.yaml, urdf", "ur6.urdf", "ur5_robot.urdf")
    sidecar.write_text(f"urdf: {PACKAGE}/TwoDofs.urdf\n")
    (tmp_path / PACKAGE).mkdir()  # as 'pkmsea new' makes one for meshes
    assert load_mechanism(tmp_path, guess=True).description.origin.tree.name == "TwoDofs.urdf"
