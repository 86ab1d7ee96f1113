"""Time, iterations, memory and truth of pkmsea's solves, of the paper's transcription and of rockit, in one run.

python examples/benchmarks/benchmark.py -o results/benchmark    (about twelve minutes; --quick: a small sample of it)

Every case runs in a fresh process. benchmark.json is written after each of them, report.md and benchmark.png at the
end or on Ctrl-C.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from report import machine, write_report

HERE = Path(__file__).parent
SETUPS = ("PKM RD", "PKM SEA", "RAPKM RD", "RAPKM SEA")
TABLES = (2, 3, 4)
STARTS = 5
SAMPLES = (52, 100, 200, 400, 800, 1600, 3200)  # four per knot
MANY = 800  # samples from which a case has fewer starts
DEFAULT = 200  # samples where nothing else is said
STIFFNESS = (0.44, 0.21)  # near the optimum of table 3 [N m/rad]
ITERATIONS = 300  # per step
LIMIT = 300.0  # [s] of IPOPT, per start
GRACE = 600.0  # [s] for building, audits and rockit's transcription
MISSING = "rockit is not installed: pip install -c requirements.lock '.[benchmark]'"

Case = dict[str, Any]


def cases(quick: bool) -> Iterator[Case]:
    """All cases, or a few small ones."""
    common = {"iterations": ITERATIONS, "limit": LIMIT, "setup": "PKM SEA", "table": 3, "starts": STARTS}
    if quick:
        common |= {"iterations": 40, "limit": 20.0, "starts": 1}
    samples = DEFAULT
    setups = [("PKM SEA", 3)] if quick else [(setup, table) for table in TABLES for setup in SETUPS]
    for setup, table in setups:
        yield common | {"kind": "flat", "group": "setups", "setup": setup, "table": table, "samples": samples}
    for count in SAMPLES[:2] if quick else SAMPLES:
        starts = min(common["starts"], STARTS if count < MANY else 3)
        yield common | {"kind": "flat", "group": "grid", "samples": count, "starts": starts}
    yield common | {"kind": "neighbours", "group": "neighbours", "samples": samples, "stiffness": STIFFNESS}
    small = {"samples": 20, "iterations": 5} if quick else {"samples": samples}
    for table in (3,) if quick else (2, 3):
        group = {"group": "baselines", "table": table, "starts": 1, **small}
        yield common | group | {"kind": "flat", "starts": common["starts"]}  # beside them: the machine's load changes
        yield common | {"kind": "paper", **group}
        for formulation in ("paper", "lifted"):
            yield common | {"kind": "rockit", "formulation": formulation, **group}


def run(case: Case) -> dict[str, Any]:
    """The case's record, or why there is none."""
    if case["kind"] == "rockit" and importlib.util.find_spec("rockit") is None:
        return {"error": MISSING}
    command = [sys.executable, str(HERE / "case.py"), json.dumps(case)]
    seconds = case["limit"] * case["starts"] + GRACE
    environment = os.environ | {"OMP_NUM_THREADS": "1"}
    try:
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=seconds, check=False)
    except subprocess.TimeoutExpired:
        return {"error": f"not done within {seconds:.0f} s"}
    lines = done.stdout.splitlines()
    if done.returncode or not lines:
        return {"error": (done.stderr.strip().splitlines() or ["no output"])[-1]}
    record: dict[str, Any] = json.loads(lines[-1])
    return record


def write(results: dict[str, Any], folder: Path) -> None:
    """benchmark.json, replaced as a whole."""
    partial = folder / "benchmark.json.part"
    partial.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")
    partial.replace(folder / "benchmark.json")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="few small cases, to see that everything runs")
    parser.add_argument("-o", "--out", type=Path, default=Path("results/benchmark"), help="folder for the results")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    results: dict[str, Any] = {"machine": machine(), "quick": asked.quick, "cases": []}
    todo, interrupted = list(cases(asked.quick)), False
    try:
        for i, case in enumerate(todo, 1):
            name = " ".join(str(case[key]) for key in ("kind", "formulation", "setup", "table") if key in case)
            begin = time.perf_counter()
            record = run(case)
            results["cases"].append(case | {"result": record})
            write(results, asked.out)
            took = f"{time.perf_counter() - begin:.1f} s"
            print(f"{i:3}/{len(todo)}  {name}, N = {case['samples']}: {record.get('error', took)}", flush=True)
    except KeyboardInterrupt:
        interrupted = True
    print(write_report(results, asked.out))
    return int(interrupted or any(c["result"].get("error", MISSING) != MISSING for c in results["cases"]))


if __name__ == "__main__":
    sys.exit(main())
