"""The process around a solve: threads, other pools, closed and full streams, no home. The host is left as it was."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path
from typing import Any

import joblib
import pytest
import yaml
from conftest import SLIDER_ELASTIC, SLIDER_RIGID, STROKE, task

from pkmsea.solution import Solution, solve
from pkmsea.solution.store import load
from pkmsea.solver.processes import once, unordered

OPTIONS = {"trajectory": {"kind": "fourier", "order": 8}, "starts": 2, "meshes": 2}
SLIDER = {
    "name": "slider",
    "cycle": {"period": 2.0, "points": STROKE},
    "setups": [{"name": "rigid", "mechanism": "linear_axis_1", "drives": SLIDER_RIGID}],
    "options": OPTIONS,
}
WITHOUT_HOME = """
import pwd
def unknown(uid): raise KeyError(uid)
pwd.getpwuid = unknown
from pkmsea.cli import main
main()
"""


def standard_streams() -> list[str]:
    return [os.readlink(f"/proc/self/fd/{descriptor}") for descriptor in (1, 2)]


def in_threads(calls: list[Any]) -> list[Any]:
    """The results of calls that run side by side."""
    results: list[Any] = [None] * len(calls)

    def run(index: int) -> None:
        results[index] = calls[index]()

    threads = [threading.Thread(target=run, args=(index,)) for index in range(len(calls))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


def test_solves_in_threads_are_those_of_one_thread() -> None:
    """Also with processes of their own, and standard output stays where it was."""
    streams = standard_streams()
    tasks = [task("linear_axis_1", drives, options=OPTIONS) for drives in (SLIDER_RIGID, SLIDER_ELASTIC)]
    alone = [solve(one, workers=1) for one in tasks]
    found: list[Solution] = in_threads([lambda one=one, n=n: solve(one, workers=n) for one in tasks for n in (1, 2)])
    assert [x.value for x in found] == [alone[i].value for i in (0, 0, 1, 1)]
    assert standard_streams() == streams


def test_pools_of_the_host_go_on() -> None:
    """joblib's pool is another one: after, before and beside ours."""
    for _ in range(2):
        assert joblib.Parallel(n_jobs=2)(joblib.delayed(abs)(-i) for i in range(3)) == [0, 1, 2]
        assert solve(task("linear_axis_1", SLIDER_RIGID, options=OPTIONS), workers=2).verified


def blocked() -> bool:
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_processes_leave_ctrl_c_to_their_parent() -> None:
    """It goes to all of a terminal; theirs would print a traceback each."""
    assert dict(unordered(blocked, once(dict.fromkeys(range(2), ())), 2, lambda key: False)) == {0: True, 1: True}
    assert not blocked()


def pkmsea(folder: Path, streams: str, *program: str) -> subprocess.CompletedProcess[str]:
    """Run in a shell, with redirections of the standard streams."""
    (folder / "slider.yaml").write_text(yaml.safe_dump(SLIDER))
    command = ["bash", "-c", f'"$@" {streams}', "bash", sys.executable, *program]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600, env=environment())


def environment() -> dict[str, str]:
    root = str(Path(sys.modules["pkmsea"].__path__[0]).parent)
    homeless = {key: x for key, x in os.environ.items() if key not in ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")}
    return homeless | {"PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}


def test_closed_streams_and_no_home_lose_nothing(tmp_path: Path) -> None:
    """All three closed: without care the second file that is opened gets what is printed."""
    arguments = ["solve", "slider.yaml", "-o", "out", "--workers", "2"]
    process = pkmsea(tmp_path, "<&- >&- 2>&-", "-c", WITHOUT_HOME, *arguments)
    assert process.returncode == 0
    assert load(tmp_path / "out" / "rigid.nc").verified
    assert (tmp_path / "out" / "overview.png").exists()


@pytest.mark.parametrize("streams", ["> /dev/full", "> /dev/full 2> /dev/full"])
def test_a_full_standard_output_is_told(tmp_path: Path, streams: str) -> None:
    process = pkmsea(tmp_path, streams, "-m", "pkmsea", "check", "linear_axis_1")
    assert process.returncode == 2
    assert process.stderr == "" if "2>" in streams else process.stderr.startswith("pkmsea: standard output: ")
    assert process.stderr.count("\n") <= 1


def test_a_full_standard_error_changes_nothing(tmp_path: Path) -> None:
    assert pkmsea(tmp_path, "2> /dev/full", "-m", "pkmsea", "check", "nowhere").returncode == 2
