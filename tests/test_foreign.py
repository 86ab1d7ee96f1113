"""Mechanisms of others: from their file, by the commands that the guide gives, to a verified cycle with springs."""

from __future__ import annotations

from pathlib import Path

import five_bar
import pytest
from test_cli import expect, run

from pkmsea.description.robots import find_robot
from pkmsea.mechanism import load_mechanism
from pkmsea.new import new
from pkmsea.solution import solve
from pkmsea.task import load_task

SHARED = Path(__file__).parents[2] / "shared" / "mechanisms"  # beside the checkout, where there are any
EXAMPLES = Path(__file__).parents[1] / "examples" / "mechanisms"
FILES = {  # file, mobility, joints that a user has to lock
    "crank": (EXAMPLES / "four_bar.urdf", 1, ""),
    "gepetto": (SHARED / "gepetto_5bar_linkage_iso3d" / "robot.urdf", 2, ""),
    "four_bar": (SHARED / "grbda_urdfplus" / "four_bar.urdf", 1, ""),
    "six_bar": (SHARED / "grbda_urdfplus" / "six_bar.urdf", 2, "locked: {joint2: 0.5}\n"),
    "two_link_arm": (find_robot("example-robot-data/TwoDofs.urdf"), 2, ""),
    "ur5": (
        find_robot("example-robot-data/ur5_robot.urdf"), 3,
        "locked: {wrist_1_joint: 0, wrist_2_joint: 0, wrist_3_joint: 0}\n",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FILES)
def test_from_file_to_verified_cycle(name: str, tmp_path: Path) -> None:
    file, mobility, locked = FILES[name]
    if not file.is_file():
        pytest.skip(f"{file} is not there")
    folder = tmp_path / name
    sidecar, task = folder / "mechanism.yaml", folder / "task.yaml"
    if name == "six_bar":
        expect(run("new", folder, "--urdf", file), 2, "mechanism.yaml, end_effector", "locked", "again")
        sidecar.write_text(sidecar.read_text() + locked)
        new(folder, None)
    else:
        new(folder, file)
    if name == "ur5":
        assert load_mechanism(folder).description.end_effector.joints == tuple(load_mechanism(folder).joints)
        task.unlink()
        sidecar.write_text(sidecar.read_text() + locked)
        expect(run("new", folder), 2, "actuated: The joint 'wrist_1_joint' is locked", "left out, they are proposed")
        sidecar.write_text(locked)
        new(folder, None)
    mechanism = load_mechanism(folder)
    assert mechanism.mobility == mobility
    assert min(mechanism.singularity(mechanism.seed)) > 0.05
    assert load_task(task).limits.urdf == (name != "gepetto")  # whose drives of 1 N m bear less than their links
    solution = solve(load_task(task).with_starts(1), "elastic", workers=1)
    assert solution.verified, solution.status


def test_check_writes_once_and_completes(tmp_path: Path) -> None:
    folder = five_bar.gepetto(tmp_path / "robot")
    (folder / "robot.yaml").write_text("closed_loop: [[tip_1, tip_2]]\ntype: [3d]\nname_mot: [A, B]\n")
    process = run("check", folder / "robot.urdf", "--write")
    assert process.returncode == 0, process.stderr
    assert "proposed" in process.stdout and "end_effector" in process.stdout
    text = (folder / "mechanism.yaml").read_text()
    assert "PROPOSED, correct it" in text and "actuated: [A, B]  # joint of each drive" in text
    assert load_mechanism(folder).description.end_effector.frame == "tool"
    assert run("check", folder, "--write").returncode == 0
    assert (folder / "mechanism.yaml").read_text() == text
    (folder / "mechanism.yaml").write_text(text.replace("end_effector:", "# end_effector:"))
    expect(run("solve", new_task(folder)), 2, "end_effector", "missing", "--write")
    assert run("check", folder, "--write").returncode == 0
    assert load_mechanism(folder).description.end_effector.frame == "tool"


def new_task(folder: Path) -> Path:
    path = folder / "task.yaml"
    drives = "{kind: rigid, inertia: 1.0e-4, copper_loss: 60}"
    points = "[{at: [0, 0], window: 0.001}, {at: [0.05, 0.05], window: 0.001}]"
    path.write_text(
        f"name: t\ncycle: {{period: 1.0, points: {points}}}\nsetups: [{{name: r, mechanism: ., drives: {drives}}}]\n"
    )
    return path


def test_new_overwrites_nothing(tmp_path: Path) -> None:
    folder = five_bar.native(tmp_path / "robot")
    before = {path.name: path.read_text() for path in folder.iterdir()}
    expect(run("new", folder, "--urdf", folder / "robot.urdf"), 2, "not empty", "Name a new one")
    assert run("new", folder).returncode == 0
    expect(run("new", folder), 2, "task.yaml", "not overwritten")
    after = {path.name: path.read_text() for path in folder.iterdir() if path.name != "task.yaml"}
    assert {name: text.startswith(before[name]) for name, text in after.items()} == dict.fromkeys(before, True)
