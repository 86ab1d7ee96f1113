"""The command that runs many solves: study."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pkmsea import ending
from pkmsea.cli.app import Json, Workers, app, emit, tell_written


@app.command()
def study(
    study: Annotated[Path, typer.Argument(help="Study file (YAML).")],
    out: Annotated[
        Path,
        typer.Option("-o", "--out", help="Folder for table, figure and result files; a stopped study goes on there."),
    ],
    workers: Workers = None,
    scheduler: Annotated[
        str | None, typer.Option("--scheduler", metavar="ADDRESS", help="Use the workers of this Dask scheduler.")
    ] = None,
    json_: Json = False,
) -> None:
    """Sweep numbers of a task and its mechanisms; resumes where it was stopped."""
    ending.defer()
    from pkmsea.files import check_writable
    from pkmsea.study import load_study, run_study
    from pkmsea.views import study_table
    from pkmsea.views.figures import save_figure
    from pkmsea.views.study import study_figure, write_points

    loaded = load_study(study)
    check_writable(out)
    with study_table.study_progress(quiet=json_) as report, ending.interruptible():
        result = run_study(loaded, out, workers=workers, scheduler=scheduler, progress=report)
    emit(study_table.study_record(result)) if json_ else study_table.print_study(result)
    written = [out / "study.sqlite", *write_points(result, out)]
    if not result.table.empty:
        written.append(save_figure(study_figure(result), out / "study.png"))
    tell_written(written, json_)
    ending.stop_if(result.interrupted)
