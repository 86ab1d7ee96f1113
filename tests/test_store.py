"""Result files stand alone: they hold the mechanism, with the meshes that the views show, and are read anywhere."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from conftest import SLIDER_ELASTIC, STROKE, task
from typer.testing import CliRunner

from pkmsea.cli import app
from pkmsea.errors import InputError
from pkmsea.solution import Solution, solve
from pkmsea.solution.store import changed, load, read_dataset
from pkmsea.verification import verify
from pkmsea.views import playback

SHIPPED = Path(__file__).parents[1] / "urdf" / "linear_axis_1"
FOURIER = {"trajectory": {"kind": "fourier", "order": 10}, "starts": 1}
MESH = "package://stage/meshes/carriage.stl"
CORNERS = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])


def tetrahedron() -> bytes:
    """Binary STL: 80 bytes of head, the number of facets, and per facet normal, corners, and two bytes."""
    faces = np.zeros(4, np.dtype([("normal", "<3f4"), ("corners", "<9f4"), ("attribute", "<u2")]))
    faces["corners"] = [CORNERS[list(face)].ravel() for face in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    return b"\0" * 80 + np.uint32(4).tobytes() + faces.tobytes()


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A mechanism folder of its own, whose guide is a mesh, too."""
    folder = tmp_path_factory.mktemp("home") / "stage"
    shutil.copytree(SHIPPED, folder)
    (folder / "stage" / "meshes").mkdir(parents=True)
    (folder / "stage" / "meshes" / "carriage.stl").write_bytes(tetrahedron())
    urdf = folder / "linear_axis_1.urdf"
    visual = f'<visual><geometry><mesh filename="{MESH}"/></geometry></visual></link>'
    links = urdf.read_text().split("</link>")
    urdf.write_text("</link>".join(links[:-2]) + visual + "</link>".join(links[-2:]))
    return folder


@pytest.fixture(scope="module")
def solved(home: Path) -> Solution:
    return solve(task(str(home), SLIDER_ELASTIC, cycle={"period": 2.0, "points": STROKE}, options=FOURIER), workers=1)


@pytest.fixture
def carried(solved: Solution, home: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The result file alone in the working directory, and its mechanism gone."""
    away = home.with_name("away")
    file = solved.save(tmp_path / "result.nc")
    home.rename(away)
    monkeypatch.chdir(tmp_path)
    yield file
    away.rename(home)


def test_a_carried_file_needs_nothing_else(solved: Solution, carried: Path, tmp_path: Path) -> None:
    again = load(carried)
    assert again.value == pytest.approx(solved.value, rel=1e-12) and again.optima == solved.optima
    assert again.problem.mechanism.description.digest == solved.problem.mechanism.description.digest
    assert verify(carried).verified
    for command in (["show"], ["verify"], ["plot", "-o", "a.png"], ["play", "--html", "a.html"], ["export"]):
        ended = CliRunner().invoke(app, [command[0], carried.name, *command[1:]])
        assert ended.exit_code == 0, (command, ended.output)
    assert {path.name for path in tmp_path.iterdir()} == {"result.nc", "result.csv", "a.png", "a.html"}


def test_show_prints_what_solve_printed(solved: Solution, carried: Path) -> None:
    ended = CliRunner().invoke(app, ["show", str(carried), "--json"])
    (record,) = json.loads(ended.stdout)
    assert record["verified"] and record["energy"] == pytest.approx(solved.energy, rel=1e-12)
    assert record["claimed"] == solved.claimed and record["meshes"] == [vars(mesh) for mesh in solved.meshes]


def test_meshes_are_drawn_from_the_file(solved: Solution, carried: Path, tmp_path: Path) -> None:
    """The page shows the mesh of the file, not a stick; nothing of it is left behind."""
    page = playback.write_page(load(carried), tmp_path / "a.html").read_bytes()
    alone = tmp_path / "without.nc"
    with xr.open_dataset(carried, engine="h5netcdf") as data:
        data.drop_vars("mesh_0").to_netcdf(alone, engine="h5netcdf")
    assert len(page) != len(playback.write_page(load(alone), tmp_path / "b.html").read_bytes())


@pytest.mark.parametrize("name", ["../out.stl", "package://../out.stl", "/tmp/out.stl", "out.txt"])
def test_a_forged_mesh_name_writes_nothing_outside(carried: Path, tmp_path: Path, name: str) -> None:
    with xr.open_dataset(carried, engine="h5netcdf") as data:
        data["mesh_0"].attrs["mesh"] = name
        data.to_netcdf(tmp_path / "forged.nc", engine="h5netcdf")
    with playback.mesh_folder(load(tmp_path / "forged.nc")) as folder:
        assert not list(folder.rglob("*.*"))
        assert not list(folder.parent.glob("out.*"))


def test_a_mechanism_that_has_changed_is_told(solved: Solution, home: Path, tmp_path: Path) -> None:
    file, urdf = solved.save(tmp_path / "result.nc"), home / "linear_axis_1.urdf"
    assert changed(file) == ""
    before = urdf.read_text()
    try:
        urdf.write_text(before.replace('<mass value="', '<mass value="1'))
        assert str(urdf.parent) in changed(file) and "has changed" in changed(file)
        assert load(file).value == pytest.approx(solved.value, rel=1e-12)
    finally:
        urdf.write_text(before)


@pytest.mark.parametrize(
    ("written", "words"),
    [
        ("pkmsea result 1", "An older pkmsea"),
        ("pkmsea result 99", "A newer pkmsea.*Update"),
        ("other", "not a result of pkmsea"),
    ],
)
def test_formats_of_other_versions_are_told(solved: Solution, tmp_path: Path, written: str, words: str) -> None:
    with xr.open_dataset(solved.save(tmp_path / "a.nc"), engine="h5netcdf") as data:
        data.attrs["format"] = written
        data.to_netcdf(tmp_path / "b.nc", engine="h5netcdf")
    with pytest.raises(InputError, match=words):
        read_dataset(tmp_path / "b.nc")
