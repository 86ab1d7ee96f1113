"""Commands on result files: show, verify, export, plot, play."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pkmsea.cli.app import Json, app, emit, end


@app.command()
def show(
    result: Annotated[list[Path], typer.Argument(help="Result files (.nc); others are relative to the first.")],
    json_: Json = False,
) -> None:
    """Print the table of results again, as 'pkmsea solve' printed it."""
    from pkmsea.solution.store import load
    from pkmsea.views import records, tables

    _tell_changes(result)
    solved = [load(file) for file in result]
    if json_:
        emit(records.solutions(solved, solved[0], {}))
    else:
        tables.print_solutions(solved, solved[0], {})
    end({}, unverified=not all(solution.verified for solution in solved))


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

    _tell_changes(result)
    found: dict[str, Verification] = {}
    failures: dict[str, SolveError] = {}
    for file in result:
        try:
            found[str(file)] = verification_of(file)
        except SolveError as error:
            failures[str(file)] = error
    if json_:
        emit(records.verifications(found, failures))
    elif found:
        tables.print_verifications(found, failures)
    end(failures, unverified=not all(v.verified for v in found.values()))


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

    _tell_changes([result])
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

    _tell_changes(result)
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

    _tell_changes([result])
    solution = load(result)
    typer.echo(f"{solution.name}: {solution.cost.show(solution.value)}, {solution.status}")
    if html is not None:
        typer.echo(f"wrote {playback.write_page(solution, html)}")
        return
    visualizer = playback.play(solution)
    visualizer.open()
    typer.prompt("Playing; press Enter to stop", default="", show_default=False)


def _tell_changes(results: list[Path]) -> None:
    """Say which results are of mechanisms whose own files have changed since."""
    from pkmsea.solution.store import changed

    for note in filter(None, map(changed, results)):
        typer.echo(note, err=True)
