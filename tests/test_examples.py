"""Every example runs, and every task file of the examples loads and fits its mechanism."""

from __future__ import annotations

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from test_cost import CopperLoss

from pkmsea.actuation import Drive
from pkmsea.mechanism import load_mechanism
from pkmsea.problem import Problem, build_problem
from pkmsea.solution import solve
from pkmsea.task import Cycle, Options, load_task

EXAMPLES = Path(__file__).parents[1] / "examples"
TASKS = sorted((EXAMPLES / "tasks").glob("*.yaml"))


@pytest.mark.parametrize("path", TASKS, ids=lambda path: path.stem)
def test_task_files(path: Path) -> None:
    task = load_task(path)
    for setup in task.setups:
        build_problem(task, setup.name)


def test_mixed_drives_example() -> None:
    """One rigid and one elastic arm: cheaper than two rigid ones."""
    task = load_task(EXAMPLES / "tasks" / "pkm_rigid_and_elastic_mixed.yaml").with_starts(2)
    energies = {setup.name: solve(task, setup.name, workers=1).energy for setup in task.setups}
    first, *others = energies.values()
    assert min(others) < first


def run(script: str, folder: Path, *arguments: str) -> str:
    command = [sys.executable, str(EXAMPLES / script), *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_first_cycle(tmp_path: Path) -> None:
    assert "verified" in run("first_cycle.py", tmp_path)


def test_task_in_python(tmp_path: Path) -> None:
    """With heavy rotors, springs leave three quarters of the energy (README: PKM SEA of table 4)."""
    told = run("task_in_python.py", tmp_path)
    assert "verified, verified" in told
    assert float(told.split("%")[0].split()[-1]) == pytest.approx(74.5, abs=1.0)


def test_own_ocp(tmp_path: Path) -> None:
    """Opti on the flat map, poses as unknowns, finds what the flat transcription finds in the same basis."""
    told = run("own_ocp.py", tmp_path)
    motor = {"inertia": 4.6e-4, "friction": 4.8e-3, "copper_loss": 63.4, "stiffness": {"bounds": [0.01, 1.0]}}
    points = [{"at": at, "window": 1e-6} for at in ([-0.07, -0.07], [0.07, 0.07])]
    posed = Problem(
        name="copper loss",
        mechanism=load_mechanism("pkm_2rrr"),
        drives=(Drive(kind="sea", **motor),),
        cycle=Cycle(period=1.0, points=points),
        options=Options(starts=1, trajectory={"kind": "fourier", "order": 5}, meshes=1),
        cost=CopperLoss(),
    )
    found = solve(posed, workers=1)
    assert float(told.split("loss")[1].split("J")[0]) == pytest.approx(found.value, abs=1e-4)
    springs = [float(c) for c in told.split("[")[1].split("]")[0].split()]
    assert springs == pytest.approx(found.stiffness, abs=1e-3)


def test_transcriptions_study(tmp_path: Path) -> None:
    """Reduced: one case at the coarsest size. Finer grids than knots claim the truth, samples at the knots do not."""
    run("studies/transcriptions", tmp_path, "--quick", "-o", str(tmp_path))
    with (tmp_path / "transcriptions.csv").open(newline="", encoding="utf-8") as file:
        rows = {row["scheme"]: row for row in csv.DictReader(file)}
    gaps = {scheme: abs(float(row["gap"])) for scheme, row in rows.items()}
    assert all(row["outcome"] == "optimal" for row in rows.values())
    assert gaps["Default"] < 0.005 and gaps["Oversampled"] < 0.005
    assert min(gaps["KnotSamples"], gaps["EnergyBalance"]) > 20 * gaps["Default"]
    assert (
        float(rows["KnotSamples"]["true"]) > 2 * float(rows["Default"]["true"]) > float(rows["KnotSamples"]["claimed"])
    )
    assert (tmp_path / "transcriptions.png").stat().st_size > 0


@pytest.fixture(scope="module")
def benchmark_cases(tmp_path_factory: pytest.TempPathFactory) -> list[dict[str, Any]]:
    """The cases of a reduced run, with their results."""
    folder = tmp_path_factory.mktemp("benchmark")
    run("benchmarks/benchmark.py", folder, "--quick", "-o", str(folder))
    report = (folder / "report.md").read_text()
    assert "PKM SEA" in report and (folder / "benchmark.png").stat().st_size > 0
    cases: list[dict[str, Any]] = json.loads((folder / "benchmark.json").read_text())["cases"]
    return cases


@pytest.mark.long
def test_benchmark(benchmark_cases: list[dict[str, Any]]) -> None:
    """Ours is optimal and true on the default grid; the times add up; memory is that of a process with CasADi."""
    case, *_ = (case for case in benchmark_cases if case["group"] == "setups")
    result, (record,) = case["result"], case["result"]["runs"]
    assert record["outcome"] == "optimal"
    assert abs(record["claimed"] / record["energy"] - 1) < 5e-3  # the audit's own limit
    assert 0 < record["evaluation_seconds"] < record["solver_seconds"] <= record["seconds"]
    assert 50 < result["memory_MB"] < 2000
    warm, cold = (next(c["result"][k] for c in benchmark_cases if c["kind"] == "neighbours") for k in ("warm", "cold"))
    assert warm["iterations"] < cold["iterations"]


@pytest.mark.long
def test_benchmark_baseline(benchmark_cases: list[dict[str, Any]]) -> None:
    """The rockit models are the audit's, or the benchmark says what to install."""
    results = [case["result"] for case in benchmark_cases if case["kind"] == "rockit"]
    assert len(results) == 2
    if any("rockit is not installed" in result.get("error", "") for result in results):
        pytest.skip(results[0]["error"])
    for result in results:
        assert result["model_disagreement"] < 1e-9  # solve_rockit.AGREEMENT
        assert result["runs"][0]["iterations"] > 0
