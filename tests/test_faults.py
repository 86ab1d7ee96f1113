"""What goes wrong around a solve: signals, full disks, dead workers, locales, odd paths. Files are whole or none."""

from __future__ import annotations

import json
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import SLIDER_ELASTIC, SLIDER_RIGID, STROKE, task
from matplotlib.image import imread
from typer.testing import CliRunner

from pkmsea import cli, solution
from pkmsea.description import find
from pkmsea.errors import InputError, SolveError
from pkmsea.files import LEFT_OVER, PARTIAL, write_whole
from pkmsea.problem import build_problem
from pkmsea.solution import Solution, solve
from pkmsea.solution.store import load
from pkmsea.solver.spread import spread
from pkmsea.transcription import Transcription, transcribe
from pkmsea.views.figures import overview, save_figure
from pkmsea.views.playback import write_page

COMMAND = str(Path(sys.executable).with_name("pkmsea"))
FOURIER = {"trajectory": {"kind": "fourier", "order": 8}, "starts": 2}
TASK: dict[str, Any] = {
    "name": "slider",
    "cycle": {"period": 2.0, "points": STROKE},
    "setups": [{"name": f"slider {i}", "mechanism": "linear_axis_1", "drives": SLIDER_RIGID} for i in range(8)],
    "options": FOURIER,
}
MANY = [TASK["setups"][0] | {"name": f"slider {i}"} for i in range(40)]  # seconds of solving after the first
PATIENCE = 600.0  # [s], for a busy machine
HALF = 0.5
ENOUGH = 2000  # bytes that a full disk still takes
TURNED = {"trajectory": {"kind": "fourier", "order": 4}, "starts": 1}


@pytest.fixture(scope="module")
def solved() -> Solution:
    return solve(task("linear_axis_1", SLIDER_ELASTIC, options=FOURIER), workers=1)


def write_task(folder: Path, **changes: Any) -> Path:
    path = folder / "task.yaml"
    path.write_text(json.dumps(TASK | changes), encoding="utf-8")  # JSON is YAML
    return path


def whole_files(folder: Path) -> set[str]:
    """Names of the files under `folder`, each read to its end; temporaries, which are recognisable, are left out."""
    names = set()
    for file in folder.rglob("*"):
        if file.is_dir() or (file.name.startswith(".") and file.suffix == PARTIAL):
            continue
        if file.suffix == ".nc":
            assert load(file).energy >= 0
        elif file.suffix == ".png":
            assert imread(file).size
        else:
            assert file.suffix == ".html" and file.read_text().endswith("</html>\n"), file
        names.add(file.relative_to(folder).as_posix())
    return names


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGKILL"])
def test_a_killed_solve_keeps_what_was_finished(tmp_path: Path, name: str) -> None:
    out, rng = tmp_path / "out", random.Random(name)
    file = write_task(tmp_path, setups=MANY)
    command = [COMMAND, "solve", str(file), "-o", str(out), "--workers", "1", "--json"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + PATIENCE
    while not (out / "slider_0.nc").exists():
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.01)
    time.sleep(rng.uniform(0, 0.5))
    process.send_signal(getattr(signal, name))
    output, errors = process.communicate(timeout=PATIENCE)
    stored = {file.removesuffix(".nc") for file in whole_files(out) if file.endswith(".nc")}
    assert "slider_0" in stored
    if name == "SIGKILL":
        assert process.returncode == -signal.SIGKILL
        return
    assert process.returncode == 1
    assert "stopped" in errors and "Traceback" not in errors
    assert {record["setup"].replace(" ", "_") for record in json.loads(output)} == stored
    assert "slider_0.html" in {file.name for file in out.iterdir()}
    assert not list(out.glob(f".*{PARTIAL}"))


def table_of(output: str) -> list[dict[str, Any]]:
    """The rows of a run, without what may differ from run to run."""
    return [{key: value for key, value in row.items() if key != "seconds"} for row in json.loads(output)]


def kill_again_and_again(arguments: list[str], kills: int, folder: Path) -> list[int]:
    """Run to the end; then, elsewhere, killed at random moments, and to the end again: the same table.

    Returns the number of whole files after each kill.
    """
    rng, seen = random.Random(0), []
    command = [COMMAND, *arguments, "--workers", "1", "--json", "-o"]
    begin = time.monotonic()
    undisturbed = subprocess.run([*command, str(folder / "once")], capture_output=True, text=True, check=True).stdout
    length = time.monotonic() - begin
    for _ in range(kills):
        process = subprocess.Popen([*command, str(folder / "out")], stdout=subprocess.DEVNULL)
        time.sleep(rng.uniform(0, length))
        process.kill()
        process.wait()
        seen.append(len(whole_files(folder / "out")))
        if rng.random() < HALF:
            shutil.rmtree(folder / "out", ignore_errors=True)  # else the next run writes over what is there
    again = subprocess.run([*command, str(folder / "out")], capture_output=True, text=True, check=True).stdout
    assert table_of(again) == table_of(undisturbed)
    assert whole_files(folder / "out") == whole_files(folder / "once")
    return seen


def test_reproduce_killed(tmp_path: Path) -> None:
    command = ["reproduce", "--table", "1", "--reading", "printed", "--starts", "1"]
    assert len(kill_again_and_again(command, 1, tmp_path)) == 1


@pytest.mark.long
def test_reproduce_killed_twenty_times(tmp_path: Path) -> None:
    seen = kill_again_and_again(["reproduce", "--reading", "printed", "--starts", "2"], 20, tmp_path)
    print(seen, sorted(str(file.relative_to(tmp_path)) for file in tmp_path.rglob(f".*{PARTIAL}")))
    assert max(seen) > 0


def test_what_a_killed_write_leaves_is_no_result_and_goes(tmp_path: Path) -> None:
    script = (
        "import os, signal; from pathlib import Path; from pkmsea.files import write_whole\n"
        f"write_whole(Path({str(tmp_path)!r}) / 'a.nc', lambda t: (t.write_text('half'), os.kill(os.getpid(), 9)))"
    )
    assert subprocess.run([sys.executable, "-c", script], cwd=tmp_path.parent).returncode == -signal.SIGKILL
    (left,) = tmp_path.iterdir()
    assert left.suffix == PARTIAL and left.name.startswith(".a.nc-")
    write_whole(tmp_path / "a.nc", lambda temporary: temporary.write_text("whole"))
    assert left.exists()  # it may be of a process that is still writing
    os.utime(left, (0, time.time() - 2 * LEFT_OVER))
    write_whole(tmp_path / "a.nc", lambda temporary: temporary.write_text("whole"))
    assert [file.name for file in tmp_path.iterdir()] == ["a.nc"]


def limit_files() -> None:
    """Let no file of this process grow beyond ENOUGH, as on a full disk."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (ENOUGH, resource.getrlimit(resource.RLIMIT_FSIZE)[1]))


WRITERS: dict[str, Callable[[Solution, Path], Any]] = {
    "result.nc": lambda solution, path: solution.save(path),
    "figure.png": lambda solution, path: save_figure(overview([solution]), path),
    "page.html": lambda solution, path: write_page(solution, path),
}


@pytest.mark.parametrize("name", sorted(WRITERS))
def test_a_full_disk_leaves_nothing(solved: Solution, tmp_path: Path, name: str) -> None:
    assert solved.verified
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    limit_files()
    try:
        with pytest.raises(InputError, match=rf"{name}: The file cannot be written"):
            WRITERS[name](solved, tmp_path / name)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_loses_no_solve(tmp_path: Path) -> None:
    """What could not be written is printed."""
    command = [COMMAND, "solve", str(write_task(tmp_path)), "-o", str(tmp_path / "out"), "--workers", "1", "--json"]
    process = subprocess.run(command, capture_output=True, text=True, timeout=PATIENCE, preexec_fn=limit_files)
    assert process.returncode == 2
    assert "cannot be written" in process.stderr and "Traceback" not in process.stderr
    (record,) = json.loads(process.stdout)
    assert record["verified"]
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.parametrize("command", ["solve", "reproduce"])
@pytest.mark.parametrize("where", ["a file", "below a file", "read-only"])
def test_an_output_that_cannot_be_written_is_told_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, where: str
) -> None:
    (tmp_path / "file").write_text("")
    out = tmp_path / "file" / "out" if where == "below a file" else tmp_path / "file"
    if where == "read-only":
        out = Path("/proc/pkmsea") if os.geteuid() == 0 else tmp_path / "locked"  # root may write to any real folder
        (tmp_path / "locked").mkdir(mode=0o500)
    for place in (solution, import_module("pkmsea.paper.reproduce")):
        monkeypatch.setattr(place, "solve", lambda *_, **__: pytest.fail("solved first"))
    arguments = [command, "-o", str(out), *([str(write_task(tmp_path))] if command == "solve" else [])]
    result = CliRunner().invoke(cli.app, arguments)
    assert isinstance(result.exception, InputError), result
    assert "cannot be written" in str(result.exception) and result.exception.exit_code == 2


def test_new_tells_where_it_cannot_write(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    result = CliRunner().invoke(
        cli.app, ["new", str(tmp_path / "file" / "robot"), "--urdf", str(find("linear_axis_1"))]
    )
    assert isinstance(result.exception, InputError) and "cannot be written" in str(result.exception)


def test_bad_input_of_a_later_setup_is_told_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(solution, "solve", lambda *_, **__: pytest.fail("solved first"))
    setups = [*TASK["setups"], {"name": "none", "mechanism": "nowhere", "drives": SLIDER_RIGID}]
    result = CliRunner().invoke(cli.app, ["solve", str(write_task(tmp_path, setups=setups))])
    assert "nowhere" in str(result.exception)


def die(transcription: Transcription, argument: tuple[int, Path, int]) -> int:
    """A call that kills its process the first few times."""
    number, folder, deaths = argument
    for death in range(deaths):
        mark = folder / f"{number} {death}"
        if not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
    return number


@pytest.fixture(scope="module")
def transcription() -> Transcription:
    return transcribe(build_problem(task("linear_axis_1", SLIDER_RIGID, options=TURNED)))


def test_starts_of_a_dead_worker_run_again(transcription: Transcription, tmp_path: Path) -> None:
    calls = [(die, (number, tmp_path, int(number == 2))) for number in range(5)]
    assert sorted(spread(transcription, 2, calls)) == [0, 1, 2, 3, 4]


def test_a_worker_that_dies_again_is_a_typed_error(transcription: Transcription, tmp_path: Path) -> None:
    calls = [(die, (number, tmp_path, 3 * int(number == 0))) for number in range(3)]
    finished = []
    with pytest.raises(SolveError, match=r"setup 'setup': A worker process has died again.*--workers"):
        for number in spread(transcription, 2, calls):
            finished.append(number)
    assert len(set(finished)) == len(finished)


def test_workers_end_with_their_parent(tmp_path: Path) -> None:
    script = tmp_path / "parent.py"
    script.write_text(
        "import os, sys, time\n"
        f"sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from pathlib import Path\n"
        "from conftest import SLIDER_RIGID, task\n"
        "from test_faults import TURNED, linger\n"
        "from pkmsea.problem import build_problem\n"
        "from pkmsea.solver.spread import spread\n"
        "from pkmsea.transcription import transcribe\n"
        "t = transcribe(build_problem(task('linear_axis_1', SLIDER_RIGID, options=TURNED)))\n"
        f"list(spread(t, 2, [(linger, Path({str(tmp_path)!r}))] * 2))\n"
    )
    parent = subprocess.Popen([sys.executable, str(script)], stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + PATIENCE
    while len(list(tmp_path.glob("worker *"))) < 2:
        assert time.monotonic() < deadline and parent.poll() is None
        time.sleep(0.05)
    parent.kill()
    parent.wait()
    workers = [int(file.name.split()[1]) for file in tmp_path.glob("worker *")]
    while any(alive(worker) for worker in workers):
        assert time.monotonic() < deadline
        time.sleep(0.05)


def linger(transcription: Transcription, folder: Path) -> None:
    (folder / f"worker {os.getpid()}").touch()
    time.sleep(2 * PATIENCE)


def alive(process: int) -> bool:
    try:
        state = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[0]
    except FileNotFoundError:
        return False
    return state != "Z"


@pytest.mark.parametrize("share", [0.0, 0.1, 0.5, 0.9, 0.999])
def test_a_truncated_result_is_bad_input(solved: Solution, tmp_path: Path, share: float) -> None:
    path = solved.save(tmp_path / "result.nc")
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    for command in (["verify", str(path)], ["plot", str(path)]):
        error = CliRunner().invoke(cli.app, command).exception
        assert isinstance(error, InputError) and error.exit_code == 2 and "result.nc" in str(error)


SOLVE_ABROAD = """
import locale, sys
from pathlib import Path
if sys.argv[1]:
    locale.setlocale(locale.LC_ALL, sys.argv[1])
    assert locale.str(1.5) == "1,5"
import pkmsea
mechanism = pkmsea.load_mechanism(sys.argv[3])
print(repr(float(pkmsea.solve(sys.argv[2], workers=1).energy)), repr(mechanism.mass_matrix(mechanism.seed).tolist()))
"""


def test_decimal_commas_change_nothing(tmp_path: Path) -> None:
    """Functions go into the bridge as text, and MJCF is parsed, where 1.5 is written 1,5."""
    import five_bar

    if shutil.which("localedef") is None:
        pytest.skip("there is no localedef to make a locale with")
    made = subprocess.run(["localedef", "-i", "de_DE", "-f", "UTF-8", str(tmp_path / "de_DE.UTF-8")], check=False)
    if made.returncode > 1:  # 1 is a warning
        pytest.skip("localedef has no sources of de_DE")
    mjcf = five_bar.CONVENTIONS["mjcf"](tmp_path / "mjcf")
    file = write_task(tmp_path, setups=TASK["setups"][:1])
    answers = []
    for name in ("", "de_DE.UTF-8"):
        environment = os.environ | {"LOCPATH": str(tmp_path)}
        command = [sys.executable, "-c", SOLVE_ABROAD, name, str(file), str(mjcf)]
        process = subprocess.run(
            command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE, env=environment
        )
        assert process.returncode == 0, process.stderr
        answers.append(process.stdout)
    assert answers[0] == answers[1]


def test_paths_with_spaces_and_other_letters(solved: Solution, tmp_path: Path) -> None:
    base = tmp_path / "Prüfung mit Leerzeichen Ω 'x'"
    base.mkdir()
    shutil.copytree(find("linear_axis_1"), base / "Achse 1 ö")
    setups = [{"name": "schön é", "mechanism": "Achse 1 ö", "drives": SLIDER_ELASTIC}]
    file, out = write_task(base, setups=setups), base / "Ergebnis ß"
    command = [COMMAND, "solve", str(file), "-o", str(out), "--workers", "1"]
    environment = os.environ | {"LC_ALL": "C"}
    process = subprocess.run(command, capture_output=True, timeout=PATIENCE, env=environment)
    assert process.returncode == 0, process.stderr
    assert whole_files(out) == {"schön_é.nc", "schön_é.html", "overview.png"}
    np.testing.assert_allclose(load(out / "schön_é.nc").energy, solved.energy, rtol=1e-6)


@pytest.mark.parametrize("home", [None, "/dev/null", pytest.param("/proc", marks=pytest.mark.long)])
def test_neither_a_compiler_nor_a_home_is_needed(tmp_path: Path, home: str | None) -> None:
    """No program in the path, no home or one that cannot be written: no hint, and no file outside the output folder."""
    file, out = write_task(tmp_path, setups=TASK["setups"][:1]), tmp_path / "out"
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    environment = {"PATH": str(tmp_path), "TMPDIR": str(temporary)} | ({"HOME": home} if home else {})
    command = [COMMAND, "solve", str(file), "-o", str(out), "--workers", "1"]
    process = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=PATIENCE, env=environment)
    assert process.returncode == 0, process.stderr
    assert not process.stderr
    assert whole_files(out) == {"slider_0.nc", "slider_0.html", "overview.png"}
    assert {path.name for path in tmp_path.iterdir()} == {"task.yaml", "out", "temporary"}
    assert not list(temporary.iterdir())
