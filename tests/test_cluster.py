"""Studies on a cluster that Dask's own commands have started; its workers share no folder with the study, and parts of
it die."""

from __future__ import annotations

import os
import re
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pandas as pd
import pytest
from test_study import TASK, plain, write

from pkmsea.errors import SolveError
from pkmsea.study import Progress, run_study

cluster = pytest.importorskip("pkmsea.study.cluster")

STUDY: dict[str, Any] = {
    "name": "springs and time",
    "task": "task.yaml",
    "setups": ["elastic"],
    "vary": {"c": {"log": [40, 160], "count": 5}, "cycle.period": {"range": [1.8, 2.2], "count": 5}},
    "set": {"drives.0.stiffness": "c"},
}
EARLY = 6  # points after which something dies
FAULT = re.compile(r"error|exception|traceback|critical|not known", re.IGNORECASE)


class Cluster:
    """A scheduler and two workers, each in a folder of its own."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = free.getsockname()[1]
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.scheduler, self.workers = self.start()

    def start(self) -> tuple[subprocess.Popen[bytes], list[subprocess.Popen[bytes]]]:
        """The processes, also where earlier ones have died."""
        scheduler = self._run("scheduler", "--host", "127.0.0.1", "--port", str(self.port), "--no-dashboard")
        worker = ("worker", self.address, "--nthreads", "1", "--no-dashboard")
        return scheduler, [self._run(*worker, "--name", name) for name in "ab"]

    def _run(self, *arguments: str) -> subprocess.Popen[bytes]:
        root = str(Path(sys.modules["pkmsea"].__path__[0]).parent)
        paths = {"PYTHONPATH": os.pathsep.join([root, os.environ.get("PYTHONPATH", "")])}
        own = self.folder / f"{arguments[0]}_{arguments[-1]}_{time.monotonic_ns()}"
        own.mkdir(parents=True)
        command = [str(Path(sys.executable).with_name("dask")), *arguments]
        with (own / "log").open("wb") as log:
            return subprocess.Popen(
                command, cwd=own, stdout=log, stderr=log, env=os.environ | paths, start_new_session=True
            )

    def kill(self, process: subprocess.Popen[bytes]) -> None:
        """With the processes that it has started."""
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()

    def faults(self) -> list[str]:
        logs = [file.read_text() for file in self.folder.glob("*/log")]
        return [line for log in logs for line in log.splitlines() if FAULT.search(line)]


@pytest.fixture
def started(tmp_path: Path) -> Iterator[Cluster]:
    started = Cluster(tmp_path / "cluster")
    yield started
    for process in (*started.workers, started.scheduler):
        if process.poll() is None:
            started.kill(process)


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(tmp_path_factory.mktemp("files"), STUDY, TASK)


@pytest.fixture(scope="module")
def here(file: Path) -> pd.DataFrame:
    """The table that this machine's processes find."""
    return plain(run_study(file, file.parent / "here", workers=2).table)


def test_a_cluster_finds_the_same_table(started: Cluster, tmp_path: Path) -> None:
    few = {"c": {"log": [40, 160], "count": 2}, "cycle.period": {"range": [1.8, 2.2], "count": 2}}
    file = write(tmp_path / "few", STUDY | {"vary": few}, TASK)
    found, here = run_study(file, tmp_path / "0", scheduler=started.address), run_study(file, tmp_path / "1", workers=1)
    pd.testing.assert_frame_equal(plain(found.table), plain(here.table))
    assert started.faults() == []


@pytest.mark.long
def test_twenty_studies_end_with_the_same_table(
    started: Cluster, file: Path, here: pd.DataFrame, tmp_path: Path
) -> None:
    for number in range(20):
        found = run_study(file, tmp_path / str(number), scheduler=started.address)
        pd.testing.assert_frame_equal(plain(found.table), here)
        assert len(list((tmp_path / str(number) / "results").rglob("*.nc"))) == len(here)
    assert started.faults() == []


@pytest.mark.long
def test_a_worker_is_killed(started: Cluster, file: Path, here: pd.DataFrame, tmp_path: Path) -> None:
    def tell(reached: Progress) -> None:
        if reached.done == EARLY:
            started.kill(started.workers[0])

    found = run_study(file, tmp_path / "out", scheduler=started.address, progress=tell)
    pd.testing.assert_frame_equal(plain(found.table), here)


@pytest.mark.long
def test_a_scheduler_is_killed_and_started_again(
    started: Cluster, file: Path, here: pd.DataFrame, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    def tell(reached: Progress) -> None:
        if reached.done == EARLY:
            started.kill(started.scheduler)
            started.scheduler, started.workers = started.start()

    found = run_study(file, tmp_path / "out", scheduler=started.address, progress=tell)
    pd.testing.assert_frame_equal(plain(found.table), here)
    assert "scheduler has gone away" in caplog.text


@pytest.mark.long
def test_a_scheduler_is_killed_for_good(
    started: Cluster, file: Path, here: pd.DataFrame, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The study ends with a word, and goes on without the cluster."""
    monkeypatch.setattr(cluster, "PATIENCE", 5)

    def tell(reached: Progress) -> None:
        if reached.done == EARLY:
            started.kill(started.scheduler)

    with pytest.raises(SolveError, match="does not answer any more"):
        run_study(file, tmp_path / "out", scheduler=started.address, progress=tell)
    told: list[int] = []
    found = run_study(file, tmp_path / "out", workers=2, progress=lambda reached: told.append(reached.done))
    assert told[0] >= EARLY
    pd.testing.assert_frame_equal(plain(found.table), here)
