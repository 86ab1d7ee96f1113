"""The command line. Each command imports what it needs, so that --help answers at once."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from pkmsea import ending

app = typer.Typer(
    name="pkmsea",
    help="Energy-optimal motion and spring stiffness of robots with series elastic drives, from a URDF.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
)

Json = Annotated[bool, typer.Option("--json", help="Print machine-readable JSON.")]
Out = Annotated[Path | None, typer.Option("-o", "--out", help="Folder for result files, figures and playback pages.")]
Workers = Annotated[int | None, typer.Option("--workers", min=1, help="Processes; default: the cores at hand.")]


class Kind(StrEnum):
    mechanism = "mechanism"
    task = "task"


@app.command()
def check(
    mechanism: Annotated[
        Path, typer.Argument(help="Folder, sidecar (.yaml), URDF, xacro or MJCF file, or the name of a shipped one.")
    ],
    write: Annotated[bool, typer.Option("--write", help="Save what was read and proposed as mechanism.yaml.")] = False,
    json_: Json = False,
) -> None:
    """Load a mechanism and print mobility, joints, closures, H_A, singularity distance and workspace.

    Drives, end effector and seed that its files leave open are proposed.
    """
    from pkmsea.errors import InputError
    from pkmsea.mechanism import load_mechanism, skeleton
    from pkmsea.mechanism.conventions import read_source
    from pkmsea.mechanism.urdf import find
    from pkmsea.views import tables

    try:
        loaded = load_mechanism(mechanism, guess=True)
    except InputError as error:
        if write and (file := skeleton.write_incomplete(read_source(find(mechanism)), error)):
            _tell([file], json_)
        raise
    record = tables.mechanism_record(loaded)
    if write and (file := skeleton.write(loaded)):
        _tell([file], json_)
    _emit(record) if json_ else tables.print_mechanism(loaded, record)


@app.command()
def new(
    folder: Annotated[Path, typer.Argument(help="Folder to write to.")],
    urdf: Annotated[
        Path | None, typer.Option("--urdf", help="URDF, URDF+, xacro or MJCF file; else what the folder holds.")
    ] = None,
) -> None:
    """Start with a mechanism of your own: write its sidecar and a first task, to be corrected by you."""
    from pkmsea.new import new as write_new

    _tell(write_new(folder, urdf), quiet=False)


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
    ending.hold()
    from pkmsea import solution, views
    from pkmsea.errors import PkmseaError, SolveError
    from pkmsea.files import check_writable
    from pkmsea.problem import build_problem
    from pkmsea.task import load_task
    from pkmsea.views import records, tables
    from pkmsea.views.output import save_all

    loaded = load_task(task) if starts is None else load_task(task).with_starts(starts)
    names = setup or [s.name for s in loaded.setups]
    for name in names:
        build_problem(loaded, name)  # bad input of any setup is told before the first is solved
    if out is not None:
        check_writable(out)
    solved: list[solution.Solution] = []
    failures: dict[str, SolveError] = {}
    stopped: PkmseaError | KeyboardInterrupt | None = None
    among = [s.name for s in loaded.setups]
    written: list[Path] = []
    with tables.progress(quiet=json_) as report:
        for name in names:
            count = (loaded.setup(name).options or loaded.options).starts
            try:
                with ending.interruptible():
                    solved.append(solution.solve(loaded, name, workers=workers, progress=report(name, count)))
                if out is not None:
                    written.append(solved[-1].save(out / f"{views.file_name(name, among)}.nc"))
                ending.stop_if(solved[-1].interrupted)
            except SolveError as error:
                failures[name] = error
                if out is not None and (old := out / f"{views.file_name(name, among)}.nc").exists():
                    typer.echo(f"{old} is of an earlier run; '{name}' has failed now", err=True)
            except (PkmseaError, KeyboardInterrupt) as error:
                stopped = error
                break
    reference = next((s for s in solved if s.name == names[0]), None)
    if json_:
        _emit(records.solutions(solved, reference, failures))
    elif solved:
        tables.print_solutions(solved, reference, failures)
    if solved and out is not None:
        _tell(written + save_all(solved, out, list(failures)), json_)
    _end(failures, stopped)


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
    ending.hold()
    from pkmsea import views
    from pkmsea.errors import PkmseaError, SolveError
    from pkmsea.files import check_writable
    from pkmsea.paper.reproduce import TABLES, Row, paper_task
    from pkmsea.paper.reproduce import reproduce as rows_of
    from pkmsea.views import records, tables
    from pkmsea.views.output import save_all

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

        def fail(*what: Any) -> None:
            failures[what[:2]] = what[2]

        try:
            found = rows_of(chosen, workers=workers, report=tell, note=report.note, starts=starts, failed=fail)
            for row in ending.each(found):
                rows.append(row)
                if out is not None:
                    path = out / f"table_{row.table}" / f"{views.setup_file(row.solution)}.nc"
                    written.append(row.solution.save(path))
                ending.stop_if(row.solution.interrupted)
        except (PkmseaError, KeyboardInterrupt) as error:
            stopped = error
    if json_:
        _emit(records.rows(rows, failures))
    else:
        tables.print_rows(rows, failures)
    if out is not None:
        _tell(written, json_)
        for number in sorted({row.table for row in rows}):
            of_table = [row.solution for row in rows if row.table == number]
            _tell(save_all(of_table, out / f"table_{number}", [name for n, name in failures if n == number]), json_)
    _end(failures, stopped)


@app.command()
def verify(
    result: Annotated[list[Path], typer.Argument(help="Result files (.nc).")],
    json_: Json = False,
) -> None:
    """Check results by an independent forward simulation, driven by their own motor torques."""
    from pkmsea.errors import SolveError
    from pkmsea.verification import Verification
    from pkmsea.verification import verify as verification_of
    from pkmsea.views import records, tables

    found: dict[str, Verification] = {}
    failures: dict[str, SolveError] = {}
    for file in result:
        try:
            found[str(file)] = verification_of(file)
        except SolveError as error:
            failures[str(file)] = error
    if json_:
        _emit(records.verifications(found, failures))
    elif found:
        tables.print_verifications(found, failures)
    _end(failures, unverified=not all(v.verified for v in found.values()))


@app.command()
def export(
    result: Annotated[Path, typer.Argument(help="Result file (.nc).")],
    rate: Annotated[
        float, typer.Option("--rate", metavar="HZ", help="Samples per second; raised until a cycle has a whole number.")
    ] = 1000.0,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="File: .csv or .nc; default: RESULT.csv.")] = None,
    unverified: Annotated[bool, typer.Option("--unverified", help="Export a result that is not verified.")] = False,
) -> None:
    """Write motor positions, speeds, torques and joint references of one cycle, ready for a drive."""
    from pkmsea.solution.export import export as write

    path = out or result.with_suffix(".csv")
    sampling = write(result, path, rate, unverified=unverified)
    typer.echo(f"wrote {path}: {sampling}")


@app.command()
def plot(
    result: Annotated[list[Path], typer.Argument(help="Result files (.nc); several are drawn into one figure.")],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="Figure file: .png, .pdf or .svg.")] = None,
) -> None:
    """Draw paths, positions, torques, power and energy of results in one figure."""
    from pkmsea.solution.store import load
    from pkmsea.views.figures import overview, save_figure

    path = out or result[0].with_suffix(".png")
    save_figure(overview([load(file) for file in result]), path)
    typer.echo(f"wrote {path}")


@app.command()
def play(
    result: Annotated[Path, typer.Argument(help="Result file (.nc).")],
    html: Annotated[Path | None, typer.Option("--html", help="Write one self-contained page instead.")] = None,
) -> None:
    """Play a cycle in Meshcat, live on this machine, or as a page that opens from disk."""
    from pkmsea.solution.store import load
    from pkmsea.views import playback

    solution = load(result)
    typer.echo(f"{solution.name}: {solution.energy:.4g} J, {solution.status}")
    if html is not None:
        typer.echo(f"wrote {playback.write_page(solution, html)}")
        return
    visualizer = playback.play(solution)
    visualizer.open()
    typer.prompt("Playing; press Enter to stop", default="", show_default=False)


@app.command()
def schema(kind: Annotated[Kind, typer.Argument(help="Kind of file.")]) -> None:
    """Print the JSON Schema of a kind of file."""
    from pkmsea.files import Record
    from pkmsea.mechanism.sidecar import Sidecar
    from pkmsea.task import Task

    kinds: dict[Kind, type[Record]] = {Kind.mechanism: Sidecar, Kind.task: Task}
    _emit(kinds[kind].model_json_schema())


def _emit(record: Any) -> None:
    typer.echo(json.dumps(record, indent=2, allow_nan=False))


def _end(failures: dict[Any, Any], stopped: BaseException | None = None, unverified: bool = False) -> None:
    for failure in failures.values():
        ending.print_error(failure)
    if stopped:
        raise stopped
    if failures or unverified:
        raise typer.Exit(1)


def _tell(paths: list[Path], quiet: bool) -> None:
    for path in paths:
        if not quiet:
            typer.echo(f"wrote {path}")


def main() -> None:
    """Run the command line; errors of pkmsea become one paragraph and an exit code, without a traceback."""
    ending.run(app)
