"""How a study's time depends on where it is solved: one process, two, and a local Dask cluster of two workers.

    python examples/benchmarks/study.py [--count 13] [--repeat 3] [-o study.md]

The landscape of two arms with friction, on a coarser grid; all three in turn, medians of the times, so that the start
of processes does not count. The table of all must be the same but for the times.
"""

import argparse
import importlib
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

import pandas as pd
from distributed import Client, LocalCluster

from pkmsea.study import Study, load_study, run_study

STUDY = Path(__file__).parents[1] / "studies" / "landscape_2_arms.yaml"
ALONE, TWO, DASK = "one process", "two processes (joblib)", "two workers (Dask)"
HEADER = "| where | time relative to one process | busy | same table |\n|---|---|---|---|"


def landscape(count: int) -> Study:
    """The study's case with friction on a grid of count x count."""
    full = load_study(STUDY)
    vary = {name: varied.model_copy(update={"count": count}) for name, varied in full.vary.items()}
    return full.model_copy(update={"vary": vary, "cases": {"friction": full.cases["friction"]}})


@dataclass(frozen=True)
class Run:
    """Wall time [s], share of it that the processes were solving, and the table without times."""

    seconds: float
    busy: float
    table: pd.DataFrame


def timed(study: Study, workers: int, scheduler: str | None = None) -> Run:
    """Run the study by so many processes here, or by the cluster's."""
    with tempfile.TemporaryDirectory() as folder:
        begin = time.perf_counter()
        result = run_study(study, folder, workers=workers, scheduler=scheduler)
        wall = time.perf_counter() - begin
        return Run(wall, result.rows["seconds"].sum() / (workers * wall), result.table.drop(columns="seconds"))


def on_cluster(study: Study) -> Run:
    """The same through a local Dask cluster of two workers, once they have imported what they need."""
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        with Client(cluster) as client:
            client.run(importlib.import_module, run_study.__module__)
        return timed(study, 2, cluster.scheduler_address)


def main(arguments: Sequence[str] | None = None) -> list[str]:
    """Measure; returns the lines of a Markdown table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--count", type=int, default=13, help="grid points per stiffness")
    parser.add_argument("-o", "--out", type=Path, help="Markdown file for the table")
    parser.add_argument("--repeat", type=int, default=3, help="runs of each")
    asked = parser.parse_args(arguments)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    study = landscape(asked.count)
    runs = [{ALONE: timed(study, 1), TWO: timed(study, 2), DASK: on_cluster(study)} for _ in range(asked.repeat)]
    table = runs[0][ALONE].table
    seconds = {name: median(run[name].seconds for run in runs) for name in runs[0]}
    lines = [HEADER]
    for name in seconds:
        busy = median(run[name].busy for run in runs)
        same = "yes" if all(run[name].table.equals(table) for run in runs) else "no"
        lines.append(f"| {name} | {seconds[name] / seconds[ALONE]:.2f} | {busy:.0%} | {same} |")
    lines.append(f"\n{study.size} points; two processes are {seconds[ALONE] / seconds[TWO]:.2f} times as fast as one.")
    print("\n".join(lines))
    if asked.out is not None:
        asked.out.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return lines


if __name__ == "__main__":
    main()
