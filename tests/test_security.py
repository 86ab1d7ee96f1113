"""Files of unknown origin: they run nothing, fill no memory, reach nothing outside their folder, and their names stay
names."""

from __future__ import annotations

import contextlib
import json
import pickle
import re
import socket
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import urlsplit

import five_bar
import h5py
import meshcat
import numpy as np
import pytest
from conftest import DIAGONAL, RIGID, task
from typer.testing import CliRunner

from pkmsea import cli
from pkmsea.description import meshes
from pkmsea.errors import InputError
from pkmsea.files import MAX_DEPTH, file_name, read_yaml
from pkmsea.mechanism import load_mechanism
from pkmsea.problem import build_problem
from pkmsea.solution import Solution, solve
from pkmsea.solution.store import load
from pkmsea.task import Task, load_task
from pkmsea.views.figures import overview, save_figure
from pkmsea.views.playback import write_page
from pkmsea.views.server import serve

QUICK = {"trajectory": {"kind": "fourier", "order": 8}, "starts": 1}
CANARY = "canary"  # a file that appears where something was run
HOSTILE = [
    f"$(touch {CANARY})", f"`touch {CANARY}`", f'"; system("touch {CANARY}"); //', f"'; touch {CANARY} #",
    f"../../{CANARY}", f"/tmp/{CANARY}", "*/ #error", "a\\\\", "<script>alert(1)</script>", "[/bold]", "$x_{", "%s{0}",
]  # fmt: skip


@pytest.mark.parametrize(
    "text", ["a: " + "[" * (MAX_DEPTH + 1) + "]" * (MAX_DEPTH + 1), "{a: " * 200_000, "- " * 400_000]
)
def test_deep_yaml_is_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "deep.yaml").write_text(text)
    with pytest.raises(InputError, match=rf"deep\.yaml: .*more than {MAX_DEPTH} levels"):
        read_yaml(tmp_path / "deep.yaml")


@pytest.mark.parametrize("content", ["!!python/object/apply:os.system ['touch canary']", "!!binary 'x'", "? [a]\n: b"])
def test_yaml_makes_no_objects(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: str) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "task.yaml").write_text(f"name: {content}" if content.startswith("!!") else content)
    with pytest.raises(InputError, match=r"task\.yaml"):
        read_yaml(tmp_path / "task.yaml")
    assert not (tmp_path / CANARY).exists()


BOMB = "".join(f'<!ENTITY e{i} "{f"&e{i - 1};" * 10}">' for i in range(1, 12))
DOCTYPES = {
    "bomb": f'<!DOCTYPE r [<!ENTITY e0 "ha">{BOMB}]>',
    "file": '<!DOCTYPE r [<!ENTITY e11 SYSTEM "file:///etc/passwd">]>',
    "net": '<!DOCTYPE r [<!ENTITY % p SYSTEM "http://127.0.0.1:9/x.dtd">%p;]>',
}


@pytest.mark.parametrize("kind", sorted(DOCTYPES))
@pytest.mark.parametrize(
    ("name", "tree"),
    [
        ("a.urdf", '<robot name="r"><link name="&e11;"/></robot>'),
        ("a.xml", '<mujoco model="r"><worldbody><body name="&e11;"/></worldbody></mujoco>'),
        ("a.xacro", '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><link name="&e11;"/></robot>'),
    ],
)
def test_entities_are_refused(tmp_path: Path, name: str, tree: str, kind: str) -> None:
    text = tree if kind != "net" else tree.replace("&e11;", "x")
    (tmp_path / name).write_text(DOCTYPES[kind] + text)
    with pytest.raises(InputError, match=rf"{name}: .*(document type|does not parse)") as caught:
        load_mechanism(tmp_path / name, guess=True)
    assert "root:" not in str(caught.value)


def test_meshes_behind_links_are_left_out(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "outside").mkdir()
    (tmp_path / "outside" / "a.stl").write_text("solid")
    package = tmp_path / "robot"
    package.mkdir()
    (package / "meshes").symlink_to(tmp_path / "outside")
    monkeypatch.setenv(meshes.PATH, str(package))
    for name in (
        "meshes/a.stl",
        "package://robot/meshes/a.stl",
        "package://../outside/a.stl",
        "package://./meshes/a.stl",
    ):
        assert meshes.resolve(name, package) is None, name
    monkeypatch.delenv(meshes.PATH)
    assert meshes.resolve("package://meshes/a.stl", package) is None


ROBOT = '<worldbody><body><joint/><geom size="1"/></body></worldbody>'
OUTSIDE = {  # models that name a file beside their folder, or by way of a file that is inside
    "include": '<include file="../part.xml"/>',
    "absolute": '<include file="{outside}/part.xml"/>',
    "model": '<asset><model name="m" file="../part.xml"/></asset>',
    "mesh": '<asset><mesh name="m" file="../a.stl"/></asset>',
    "backslashes": '<asset><mesh name="m" file="..\\a.stl"/></asset>',
    "reduced": '<asset><mesh name="m" file="nowhere/../../a.stl"/></asset>',
    "meshdir": '<compiler meshdir="{outside}"/><asset><mesh name="m" file="a.stl"/></asset>',
    "texturedir": '<compiler texturedir="inside/../.."/><asset><texture name="t" type="2d" file="a.png"/></asset>',
    "texture": '<asset><texture name="t" type="cube" fileright="../a.png"/></asset>',
    "height field": '<asset><hfield name="h" file="../a.png" size="1 1 1 1"/></asset>',
    "skin": '<asset><skin name="s" file="../a.skn"/></asset>',
    "link": '<asset><mesh name="m" file="link.stl"/></asset>',
    "included": '<include file="inside/outside.xml"/>',
    "attached": '<asset><model name="m" file="inside/outside.xml"/></asset>',
}


@pytest.mark.parametrize("kind", OUTSIDE)
def test_mjcf_names_no_file_outside_its_folder(tmp_path: Path, kind: str) -> None:
    folder = tmp_path / "robot"
    (folder / "inside").mkdir(parents=True)
    for name in ("part.xml", "a.stl", "a.png", "a.skn"):
        (tmp_path / name).write_text("<mujoco/>")
    (folder / "link.stl").symlink_to(tmp_path / "a.stl")
    (folder / "inside" / "outside.xml").write_text(
        '<mujoco><asset><mesh name="m" file="../../a.stl"/></asset></mujoco>'
    )
    (folder / "robot.xml").write_text(f"<mujoco>{OUTSIDE[kind].format(outside=tmp_path)}{ROBOT}</mujoco>")
    with pytest.raises(InputError, match=r"xml, <\w+> file = .*: This is no file inside the model's folder"):
        load_mechanism(folder)


def test_mjcf_is_utf_8(tmp_path: Path) -> None:
    """MuJoCo would find other names in it than the check does."""
    text = f'<?xml version="1.0" encoding="UTF-16"?><mujoco>{ROBOT}</mujoco>'
    (tmp_path / "robot.xml").write_text(text, encoding="utf-16")
    with pytest.raises(InputError, match=r"robot\.xml, encoding = 'UTF-16': MuJoCo reads UTF-8 alone"):
        load_mechanism(tmp_path / "robot.xml")


MANY = {
    "nested": f'<replicate count="1000"><replicate count="1000">{ROBOT[11:-12]}</replicate></replicate>',
    "composite": '<body><composite type="cable" count="20000 1 1"/></body>',
    "flexcomp": '<body name="b"><flexcomp name="f" type="grid" count="50 50 50"/></body>',
}


@pytest.mark.parametrize("content", [
    *(f"<worldbody>{content}</worldbody>" for content in MANY.values()),
    '<asset><texture name="t" type="2d" builtin="flat" width="100000" height="100000"/></asset>' + ROBOT,
    '<asset><model name="m" file="part.xml"/></asset><worldbody><replicate count="1000"><attach model="m" body="b" '
    'prefix="p"/></replicate></worldbody>',
])  # fmt: skip
def test_mjcf_does_not_multiply_itself(tmp_path: Path, content: str) -> None:
    part = "".join(f'<body name="b{i}"><geom size="1"/></body>' for i in range(100))
    (tmp_path / "part.xml").write_text(f'<mujoco><worldbody><body name="b">{part}</body></worldbody></mujoco>')
    (tmp_path / "robot.xml").write_text(f"<mujoco>{content}</mujoco>")
    with pytest.raises(InputError, match=r"robot\.xml, <\w+>: The model multiplies itself beyond"):
        load_mechanism(tmp_path / "robot.xml")


@pytest.fixture(scope="module")
def solved(tmp_path_factory: pytest.TempPathFactory) -> Solution:
    """A five-bar and a task whose names are all hostile."""
    names = {"A": HOSTILE[0], "B": HOSTILE[2], "elbow_A": HOSTILE[4], "elbow_B": HOSTILE[8]}
    folder = tmp_path_factory.mktemp("hostile")
    variant = five_bar.Variant(
        names={joint: name.replace("<", "&lt;").replace('"', "&quot;") for joint, name in names.items()}
    )
    keys = five_bar.sidecar(five_bar.Variant(names=names)) | {"closures": [{"frames": ["tip_1", "tip_2"]}]}
    robot = five_bar.write(folder / "$(touch canary)", "robot.urdf", five_bar.urdf(variant), keys)
    setups = [{"name": HOSTILE[8], "mechanism": str(robot), "drives": RIGID}]
    with contextlib.chdir(folder):
        return solve(task("pkm_2rrr", RIGID, name=HOSTILE[0] + HOSTILE[8], setups=setups, options=QUICK), workers=1)


def test_names_are_only_names(solved: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Solved, saved, drawn and printed: nothing is run, and nothing is written elsewhere."""
    monkeypatch.chdir(tmp_path)
    again = solve(solved.problem, workers=1)
    assert again.energy == pytest.approx(solved.energy, rel=1e-9)
    out = tmp_path / "out"
    name = file_name(again.name)
    load(again.save(out / f"{name}.nc"))
    save_figure(overview([again]), out / f"{name}.png")
    for command in (["check", str(again.problem.actuation.mechanism.folder)], ["verify", str(out / f"{name}.nc")]):
        result = CliRunner().invoke(cli.app, command)
        assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
        assert HOSTILE[0] in result.output or command[0] == "verify"
    assert {file.name for file in out.iterdir()} == {f"{name}.nc", f"{name}.png"}
    assert not [
        file for root in (tmp_path, Path("/tmp")) for file in root.glob(f"**/{CANARY}" if root == tmp_path else CANARY)
    ]


@pytest.mark.parametrize("name", ["a\nb", "a\x1b[2Jb", "a\0b", "a\u202eb", "x" * 201, ""])
def test_names_that_cannot_be_printed_are_refused(tmp_path: Path, name: str) -> None:
    data = {
        "name": "t",
        "cycle": {"period": 1.0, "points": DIAGONAL},
        "setups": [{"mechanism": "pkm_2rrr", "drives": RIGID}],
    }
    data["setups"][0]["name"] = name
    (tmp_path / "task.yaml").write_text(json.dumps(data))
    error = CliRunner().invoke(cli.app, ["solve", str(tmp_path / "task.yaml")]).exception
    assert isinstance(error, InputError) and "setups.0.name" in str(error) and "\x1b" not in str(error)
    folder = five_bar.write(tmp_path / "robot", "robot.urdf", five_bar.urdf(five_bar.Variant()), None)
    text = (folder / "robot.urdf").read_text().replace('name="elbow_A"', 'name="a&#10;b"')
    (folder / "robot.urdf").write_text(text)
    with pytest.raises(InputError, match=r"robot\.urdf, joint \d: name = 'a\\nb'"):
        load_mechanism(folder, guess=True)


def test_setups_never_share_a_file() -> None:
    names = [
        "a b",
        "a_b",
        "A B",
        "a b-2",
        "../a b",
        "..",
        "/",
        "é",
        "e\u0301",
        "Ω" * 200,
        "Ω" * 199 + "x",
        "nul\\",
        *HOSTILE,
    ]
    made = [file_name(name, names) for name in names]
    assert len({name.casefold() for name in made}) == len(names), made
    assert made[0] == "a_b"
    assert all(re.fullmatch(r"[\w+-][\w.+-]*", name) and len(name.encode()) < 200 for name in made), made


class Page(HTMLParser):
    """Collects tags, and the text of the title and of the caption."""

    def __init__(self) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.texts: list[str] = []

    def handle_starttag(self, tag: str, attributes: object) -> None:
        self.tags.append(tag)

    def handle_data(self, data: str) -> None:
        if self.tags[-1:] != ["script"]:
            self.texts.append(data)


def test_names_in_a_page_are_text(solved: Solution, tmp_path: Path) -> None:
    page = Page()
    page.feed(write_page(solved, tmp_path / "page.html").read_text(encoding="utf-8"))
    assert page.tags.count("script") == 2  # the viewer and its commands
    assert sum(HOSTILE[8] in text for text in page.texts) == 2  # title and caption


def damage(path: Path, kind: str) -> None:
    """Make a result file do what it must not."""
    with h5py.File(path, "r+") as file:
        if kind == "external link":
            del file["tau"]
            file["tau"] = h5py.ExternalLink("/etc/hostname", "/tau")
        elif kind == "soft link":
            del file["tau"]
            file["tau"] = h5py.SoftLink("/v")
        elif kind in ("bytes of other files", "huge", "virtual"):
            shape, dims = file["q"].shape, [d.keys() for d in file["q"].dims]
            del file["q"]
            if kind == "huge":
                file.create_dataset("q", (10**7, 10**6), dtype="f8", chunks=(1000, 1000))
            elif kind == "virtual":
                layout = h5py.VirtualLayout(shape=shape, dtype="f8")
                layout[:] = h5py.VirtualSource("/etc/hostname", "q", shape=shape)
                file.create_virtual_dataset("q", layout)
            else:
                file.create_dataset("q", shape, dtype="f8", external=[("/etc/passwd", 0, h5py.h5f.UNLIMITED)])
            assert dims
        elif kind == "a pickle":
            file.attrs["task"] = np.void(pickle.dumps(Canary()))
        elif kind == "a pickled series":
            del file["flat_output"]
            file["flat_output"] = np.void(pickle.dumps(Canary()))
        elif kind == "text for numbers":
            del file["stiffness"]
            file.create_dataset("stiffness", data=["__import__('os')", "b"], dtype=h5py.string_dtype())


class Canary:
    def __reduce__(self) -> tuple:
        return Path(CANARY).touch, ()


@pytest.mark.parametrize(
    "kind",
    ["external link", "soft link", "bytes of other files", "virtual", "huge", "a pickle", "a pickled series",
     "text for numbers"],
)  # fmt: skip
def test_result_files_execute_nothing(
    solved: Solution, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str
) -> None:
    monkeypatch.chdir(tmp_path)
    path = solved.save(tmp_path / "result.nc")
    damage(path, kind)
    with pytest.raises(InputError, match=r"result\.nc: The result file (cannot be read|is damaged)"):
        load(path)
    assert not (tmp_path / CANARY).exists()


def test_the_playback_listens_on_the_loopback_address_only() -> None:
    zmq_url = serve()
    viewer = meshcat.Visualizer(zmq_url=zmq_url)
    for url in (zmq_url, viewer.url()):
        port = urlsplit(url).port
        assert answers("127.0.0.1", port)
        assert not answers("127.0.0.2", port)  # another address of this machine; a server on all of them has it, too
        assert not answers("::1", port)


def answers(address: str, port: int | None) -> bool:
    try:
        with socket.create_connection((address, port), timeout=5):
            return True
    except OSError:
        return False


def test_the_mechanism_of_a_task_is_read_and_never_run(tmp_path: Path) -> None:
    data = Task.model_validate({
        "name": "t", "cycle": {"period": 1.0, "points": DIAGONAL},
        "setups": [{"name": "s", "mechanism": f"$(touch {tmp_path / CANARY})", "drives": RIGID}],
    })  # fmt: skip
    with pytest.raises(InputError, match="no mechanism folder"):
        build_problem(data)
    assert not (tmp_path / CANARY).exists()


@pytest.mark.parametrize("path", ["x" * 300, "x" * 300 + ".yaml", "x" * 300 + ".nc", "a\0b"])
def test_impossible_paths_are_bad_input(tmp_path: Path, path: str) -> None:
    for use in (load_mechanism, load_task, load):
        with pytest.raises(InputError):
            use(tmp_path / path)
