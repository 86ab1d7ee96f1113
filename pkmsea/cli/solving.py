"""Commands that solve: solve, reproduce."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from pkmsea import ending
from pkmsea.cli.app import Json, Out, Workers, app, emit, end, tell_written


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
        if solved and not isinstance(stopped, KeyboardInterrupt):
            written.append(save_overview(solved, out, list(failures)))
        tell_written(written, json_)
    end(failures, stopped)


@app.command()
def reproduce(
    table: Annotated[
        list[int] | None, typer.Option("--table", min=1, max=4, help="Only this table; repeatable.")
    ] = None,
    out: Out = None,
    starts: Annotated[int | None, typer.Option("--starts", min=1, help="Overrides the starts per setup.")] = None,
    workers: Workers = None,
    json_: Json = False,
) -> None:
    """Solve the setups of the paper's four tables anew and print the paper's values beside ours."""
    ending.defer()
    from pkmsea.errors import PkmseaError, SolveError
    from pkmsea.files import check_writable
    from pkmsea.paper.reproduce import TABLES, Row, paper_task
    from pkmsea.paper.reproduce import reproduce as rows_of
    from pkmsea.views import records, tables
    from pkmsea.views.output import save_overview, save_result

    if out is not None:
        check_writable(out)
    rows: list[Row] = []
    stopped: PkmseaError | KeyboardInterrupt | None = None
    written: list[Path] = []
    failures: dict[tuple[int, str], SolveError] = {}
    chosen = sorted(set(table)) if table else TABLES
    with tables.progress(quiet=json_) as report:

        def tell(number: int, name: str, start: Any) -> None:
            count = starts or paper_task(number).options.starts
            report(f"table {number}, {name}", count)(start)

        def setups_of(number: int) -> list[str]:
            return [setup.name for setup in paper_task(number).setups]

        def fail(*what: Any) -> None:
            failures[what[:2]] = what[2]

        try:
            found = rows_of(chosen, workers=workers, report=tell, note=report.note, starts=starts, failed=fail)
            for row in ending.each(found):
                rows.append(row)
                if out is not None:
                    written += save_result(row.solution, out / f"table_{row.table}", setups_of(row.table))
                ending.stop_if(row.solution.interrupted)
        except (PkmseaError, KeyboardInterrupt) as error:
            stopped = error
    if json_:
        emit(records.rows(rows, failures))
    else:
        tables.print_rows(rows, failures)
    if out is not None:
        for number in sorted({row.table for row in rows} if not isinstance(stopped, KeyboardInterrupt) else ()):
            of_table = [row.solution for row in rows if row.table == number]
            failed = [name for n, name in failures if n == number]
            written.append(save_overview(of_table, out / f"table_{number}", failed))
        tell_written(written, json_)
    end(failures, stopped)
