"""How a study's time depends on where it is solved: one process, two, and a local Dask cluster of two workers.

    python examples/benchmarks/study.py [--count 13] [-o study.md]

The landscape of two arms with friction, on a coarser grid. The table of all three must be the same but for the times.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import pandas as pd
from distributed import LocalCluster

from pkmsea.study import Study, load_study, run_study

STUDY = Path(__file__).parents[1] / "studies" / "landscape_2_arms.yaml"
HEADER = "| where | time relative to one process | same table |\n|---|---|---|"


def landscape(count: int) -> Study:
    """The study's case with friction on a grid of count x count."""
    full = load_study(STUDY)
    vary = {name: varied.model_copy(update={"count": count}) for name, varied in full.vary.items()}
    return full.model_copy(update={"vary": vary, "cases": {"friction": full.cases["friction"]}})


def timed(study: Study, workers: int | None, scheduler: str | None = None) -> tuple[float, pd.DataFrame]:
    """Wall time [s] and the table without times."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        result = run_study(study, folder, workers=workers, scheduler=scheduler)
        return time.perf_counter() - begin, result.table.drop(columns="seconds")


def main(arguments: Sequence[str] | None = None) -> list[str]:
    """Measure; returns the lines of a Markdown table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=13, help="grid points per stiffness")
    parser.add_argument("-o", "--out", type=Path, help="Markdown file for the table")
    asked = parser.parse_args(arguments)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    study = landscape(asked.count)
    alone, table = timed(study, 1)
    two = timed(study, 2)
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        dask = timed(study, None, cluster.scheduler_address)
    rows = {"one process": (alone, table), "two processes (joblib)": two, "two workers (Dask)": dask}
    lines = [HEADER]
    for name, (seconds, found) in rows.items():
        lines.append(f"| {name} | {seconds / alone:.2f} | {'yes' if found.equals(table) else 'no'} |")
    lines.append(f"\n{study.size} points; two processes are {alone / two[0]:.2f} times as fast as one.")
    print("\n".join(lines))
    if asked.out is not None:
        asked.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return lines


if __name__ == "__main__":
    main()
