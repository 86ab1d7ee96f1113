"""Studies on the terminal: table, progress, and the same as plain records for --json."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.markup import escape
from rich.progress import BarColumn, MofNCompleteColumn, TaskID, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.progress import Progress as Bars
from rich.table import Table

from pkmsea.study import Progress, StudyResult
from pkmsea.study.answers import Axis, Part, axes_of, parts_of
from pkmsea.study.table import FAILED, UNVERIFIED, VERIFIED
from pkmsea.views.tables import console

SPEED_OVER = 1800.0  # [s] past points from which the time left is told
DIGITS = 4  # of parameters


@contextmanager
def study_progress(quiet: bool = False) -> Iterator[Callable[[Progress], None]]:
    """What `run_study` takes as `progress`: one bar on a terminal's standard error, with failed points, the best energy
    and the time left; silent when piped or asked to be quiet."""
    where = Console(stderr=True, quiet=quiet or not sys.stderr.isatty())
    columns = (
        TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("left"),
        TimeRemainingColumn(), TextColumn("{task.fields[note]}"),
    )  # fmt: skip
    with Bars(*columns, console=where, disable=where.quiet, speed_estimate_period=SPEED_OVER) as bars:
        tasks: list[TaskID] = []

        def tell(reached: Progress) -> None:
            if not tasks:  # begins with what an earlier run has done, which is no measure of speed
                tasks.append(bars.add_task("points", total=reached.total, completed=reached.done, note=""))
            bars.update(tasks[0], completed=reached.done, note=_note(reached))

        yield tell


def _note(reached: Progress) -> str:
    best = [f"best {reached.best:.4g} J"] if np.isfinite(reached.best) else []
    return ", ".join(best + ([f"{reached.failed} failed"] if reached.failed else []))


def study_record(result: StudyResult) -> dict[str, Any]:
    """A study as plain data: per case and setup how many points, the best one, and the co-optimised task."""
    study = result.study
    return {
        "study": study.name,
        "folder": str(result.folder),
        "interrupted": result.interrupted,
        "points": study.size,
        "results": [_part_record(part, axes_of(study)) for part in parts_of(result)],
    }


def _part_record(part: Part, axes: list[Axis]) -> dict[str, Any]:
    best, optimum = part.best(), part.optimum
    return {
        "case": part.case,
        "setup": part.setup,
        "done": len(part.rows),
        "verified": len(part.having(VERIFIED)),
        "not_verified": len(part.unverified),
        "failed": len(part.failed),
        "reasons": {status: part.reason(status)[0] for status in (FAILED, UNVERIFIED)},
        "best": best and _row_record(part, best) | {"parameters": {axis.name: best[axis.name] for axis in axes}},
        "optimum_failed": part.failure,
        "optimum": optimum and _row_record(part, optimum) | {"gain": part.gain(), "other_optima": part.others()},
    }


def _row_record(part: Part, row: dict[str, Any]) -> dict[str, Any]:
    return {
        "energy": row["energy"],
        "claimed": row["claimed"],
        "stiffness": [row[name] for name in part.springs],
        "status": row["status"],
        "verified": row["status"] == VERIFIED,
    }


def print_study(result: StudyResult) -> None:
    """Cases and setups side by side, and under the table what went wrong most often."""
    study, parts = result.study, parts_of(result)
    axes = axes_of(study)
    optima = ["co-optimised E [J]", "better by", "c"] if any(part.optimum or part.failure for part in parts) else []
    wrong = [status for status in (UNVERIFIED, FAILED) if any(len(part.having(status)) for part in parts)]
    starred = any(row and row["status"] != VERIFIED for part in parts for row in (part.best(), part.optimum))
    table = Table(title=escape(study.name), caption="*: not verified" if starred else None, box=box.SIMPLE_HEAD)
    for heading in ["case", "setup", "points", VERIFIED, *wrong, "best E [J]", "at", *optima]:
        table.add_column(heading, justify="left" if heading in ("case", "setup", "at", "c") else "right")
    for part in parts:
        counts = [
            f"{len(part.rows)} of {study.size}",
            *(str(len(part.having(status))) for status in (VERIFIED, *wrong)),
        ]
        table.add_row(part.case, escape(part.setup), *counts, *_best(part, axes), *(_optimum(part) if optima else []))
    out = console()
    out.print(table)
    for part in parts:
        for status in (FAILED, UNVERIFIED):
            reason, count = part.reason(status)
            if count:
                rows = len(part.having(status))
                out.print(f"{part.case}, {part.setup}: {count} of {rows} {status}: {reason}", markup=False)
        if part.failure:
            out.print(f"{part.case}, {part.setup}: co-optimised: {part.failure}", markup=False)
    if result.interrupted:
        out.print("Interrupted; the same command goes on with the points that are left.")


def _best(part: Part, axes: list[Axis]) -> list[str]:
    best = part.best()
    if best is None:
        return ["-", "-"]
    return [_energy(best), ", ".join(axis.value(best[axis.name], DIGITS) for axis in axes)]


def _optimum(part: Part) -> list[str]:
    if part.optimum is None:
        return [FAILED if part.failure else "-", "-", "-"]
    gain, c = part.gain(), ", ".join(f"{part.optimum[name]:.3g}" for name in part.springs)
    return [_energy(part.optimum), "-" if gain is None else f"{gain:.2%}", c or "-"]


def _energy(row: dict[str, Any]) -> str:
    return f"{row['energy']:#.4g}" + ("" if row["status"] == VERIFIED else " *")
