"""Two versions of pkmsea in turns on one machine: time per iteration, and whole commands from an empty home.

python examples/benchmarks/versions.py OLD NEW [--runs 3] [--only iteration] [--task TASK]

OLD and NEW are checkouts, each with its pkmsea installed in its own .venv. Prints medians and the ratio new / old; a
task file adds its `solve`.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import median

BENCHMARKS = Path("examples") / "benchmarks"
ITERATIONS = {"setup": ("PKM SEA", "RAPKM SEA"), "table": (2, 3)}
CASE = {"kind": "flat", "samples": 200, "iterations": 300, "limit": 300.0, "starts": 5}
GRIDS = (200, 3200)
GEOMETRIES = Path("examples") / "studies" / "base_geometry" / "study.yaml"
PATIENCE = 3600.0  # [s]


def iteration(checkout: Path, setup: str, table: int, samples: int = CASE["samples"]) -> float:
    """Median time per iteration over the starts [ms]."""
    case = CASE | {"setup": setup, "table": table, "samples": samples}
    lines = run([python_of(checkout), str(checkout / BENCHMARKS / "case.py"), json.dumps(case)]).splitlines()
    runs = json.loads(lines[-1])["runs"]
    return 1e3 * median(run["seconds"] / run["iterations"] for run in runs)


def command(checkout: Path, *words: str) -> float:
    """Wall time of a pkmsea command in an empty home [s]."""
    with tempfile.TemporaryDirectory() as home:
        begin = time.perf_counter()
        run([python_of(checkout), "-m", "pkmsea", *words, "-o", f"{home}/out"], home)
        return time.perf_counter() - begin


def python_of(checkout: Path) -> str:
    return str(checkout / ".venv" / "bin" / "python")


def run(words: list[str], home: str | None = None) -> str:
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    if home:
        environment |= {"HOME": home, "XDG_CACHE_HOME": f"{home}/.cache", "MPLCONFIGDIR": f"{home}/.matplotlib"}
    done = subprocess.run(
        words, capture_output=True, text=True, env=environment, cwd=home, timeout=PATIENCE, check=False
    )
    if done.returncode:
        raise SystemExit(f"{' '.join(words[:4])} ended with {done.returncode}: {done.stderr[-500:]}")
    return done.stdout


def measures(task: Path | None) -> Iterator[tuple[str, str, Callable[[Path], float]]]:
    """Kind, name and measurement."""
    for table in ITERATIONS["table"]:
        for setup in ITERATIONS["setup"]:
            name = f"{setup}, table {table} [ms an iteration]"
            yield "iteration", name, lambda version, s=setup, t=table: iteration(version, s, t)
    yield (
        "grid",
        f"PKM SEA, table 3, {GRIDS[1]} points [ms]",
        lambda version: iteration(version, "PKM SEA", 3, GRIDS[1]),
    )
    yield "reproduce", "reproduce [s]", lambda version: command(version, "reproduce")
    yield "study", "study of base geometries [s]", lambda version: command(version, "study", str(version / GEOMETRIES))
    if task is not None:
        yield "solve", f"solve {task.name} [s]", lambda version: command(version, "solve", str(task.resolve()))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--only", action="append", help="iteration, grid, reproduce, study or solve; repeatable")
    parser.add_argument("--task", type=Path)
    asked = parser.parse_args()
    old, new = asked.old.resolve(), asked.new.resolve()
    print(f"{'measured':48}{'old':>9}{'new':>9}{'ratio':>8}   pairs")
    for kind, name, measure in measures(asked.task):
        if asked.only and kind not in asked.only:
            continue
        pairs = [(measure(old), measure(new)) for _ in range(asked.runs)]
        before, after = (median(column) for column in zip(*pairs, strict=True))
        ratios = sorted(b / a for a, b in pairs)
        print(
            f"{name:48}{before:9.2f}{after:9.2f}{median(ratios):8.2f}   {' '.join(f'{r:.2f}' for r in ratios)}",
            flush=True,
        )


if __name__ == "__main__":
    main()
