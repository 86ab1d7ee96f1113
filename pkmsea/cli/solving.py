"""Commands that solve: solve, reproduce."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from pkmsea import ending
from pkmsea.cli.app import Json, Out, Workers, app, emit, end, tell_written

if TYPE_CHECKING:
    from pkmsea.paper import Row


@app.command()
def solve(
    task: Annotated[Path, typer.Argument(help="Task file (YAML).")],
    out: Out = None,
    setup: Annotated[list[str] | None, typer.Option("--setup", help="Only this setup; may be repeated.")] = None,
    starts: Annotated[int | None, typer.Option("--starts", min=1, help="Overrides options.starts.")] = None,
    workers: Workers = None,
    json_: Json = False,
) -> None:
    """Solve a task: every setup that it lists, side by side."""
    ending.defer()
    from pkmsea import solution
    from pkmsea.errors import PkmseaError, SolveError
    from pkmsea.files import check_writable, file_name
    from pkmsea.problem import build_problem
    from pkmsea.task import load_task
    from pkmsea.views import records, tables
    from pkmsea.views.output import save_overview, save_result

    loaded = load_task(task) if starts is None else load_task(task).with_starts(starts)
    names = setup or [s.name for s in loaded.setups]
    problems = {name: build_problem(loaded, name) for name in names}  # bad input is told before the first is solved
    if out is not None:
        check_writable(out)
    solved: list[solution.Solution] = []
    failures: dict[str, SolveError] = {}
    stopped: PkmseaError | KeyboardInterrupt | None = None
    among = [s.name for s in loaded.setups]
    written: list[Path] = []
    with tables.progress(quiet=json_) as report:
        for name in names:
            count, cost = problems[name].options.starts, problems[name].cost
            try:
                with ending.interruptible():
                    solved.append(solution.solve(loaded, name, workers=workers, progress=report(name, count, cost)))
                if out is not None:
                    written += save_result(solved[-1], out, among)
                ending.stop_if(solved[-1].interrupted)
            except SolveError as error:
                failures[name] = error
                if out is not None and (old := out / f"{file_name(name, among)}.nc").exists():
                    typer.echo(f"{old} is of an earlier run; '{name}' has failed now", err=True)
            except (PkmseaError, KeyboardInterrupt) as error:
                stopped = error
                break
    reference = next((s for s in solved if s.name == names[0]), None)
    if json_:
        emit(records.solutions(solved, reference, failures))
    elif solved:
        tables.print_solutions(solved, reference, failures)
    if out is not None:
        if solved and not _interrupted(stopped):
            written.append(save_overview(solved, out, list(failures)))
        tell_written(written, json_)
    end(failures, stopped)


@app.command()
def reproduce(
    table: Annotated[
        list[int] | None, typer.Option("--table", min=1, max=4, help="Only this table; repeatable.")
    ] = None,
    reading: Annotated[
        Literal["printed", "implied"] | None,
        typer.Option("--reading", help="Rests as the paper prints them, or as its results imply; default: both."),
    ] = None,
    out: Out = None,
    starts: Annotated[int | None, typer.Option("--starts", min=1, help="Overrides the starts per setup.")] = None,
    workers: Workers = None,
    json_: Json = False,
) -> None:
    """Solve the paper's four tables anew, in two readings, and print its values beside ours."""
    ending.defer()
    from pkmsea.errors import PkmseaError, SolveError
    from pkmsea.files import check_writable
    from pkmsea.paper import READINGS, table_task
    from pkmsea.paper import reproduce as rows_of
    from pkmsea.paper.readings import TABLES
    from pkmsea.views import records, tables
    from pkmsea.views.output import save_result

    if out is not None:
        check_writable(out)
    rows: list[Row] = []
    stopped: PkmseaError | KeyboardInterrupt | None = None
    written: list[Path] = []
    failures: dict[tuple[int, str, str], SolveError] = {}
    chosen = sorted(set(table)) if table else TABLES
    read = [reading] if reading else READINGS
    with tables.progress(quiet=json_) as report:
        try:
            found = rows_of(
                chosen, readings=read, workers=workers, report=report, note=report.note, starts=starts,
                failed=lambda *what: failures.update({what[:3]: what[3]}),
            )  # fmt: skip
            for row in ending.each(found):
                rows.append(row)
                if out is not None:
                    setups = [setup.name for setup in table_task(row.table, reading=row.reading).setups]
                    written += save_result(row.solution, _folder(out, row.reading, row.table), setups)
                ending.stop_if(row.interrupted)
        except (PkmseaError, KeyboardInterrupt) as error:
            stopped = error
    if json_:
        emit(records.rows(rows, failures))
    else:
        tables.print_rows(rows, failures)
    if out is not None:
        if not _interrupted(stopped):
            written += _overviews(rows, failures, out)
        tell_written(written, json_)
    end(failures, stopped)


def _overviews(rows: Sequence[Row], failures: Collection[tuple[int, str, str]], out: Path) -> list[Path]:
    """One figure per table and reading; `failures` are (table, reading, setup)."""
    from pkmsea.views.output import save_overview

    written = []
    for table, reading in dict.fromkeys((row.table, row.reading) for row in rows):
        solved = [row.solution for row in rows if (row.table, row.reading) == (table, reading)]
        failed = [setup for *where, setup in failures if where == [table, reading]]
        written.append(save_overview(solved, _folder(out, reading, table), failed))
    return written


def _folder(out: Path, reading: str, table: int) -> Path:
    return out / reading / f"table_{table}"


def _interrupted(stopped: BaseException | None) -> bool:
    return isinstance(stopped, KeyboardInterrupt)
