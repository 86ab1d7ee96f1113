"""The application that all commands belong to, and what they share."""

from __future__ import annotations

import json
from importlib.metadata import version
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


def _tell_version(asked: bool) -> None:
    if asked:
        typer.echo(version("pkmsea"))
        raise typer.Exit


@app.callback()
def options(
    tell_version: Annotated[
        bool, typer.Option("--version", callback=_tell_version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    """Energy-optimal motion and spring stiffness of robots with series elastic drives, from a URDF."""


Json = Annotated[bool, typer.Option("--json", help="Print machine-readable JSON.")]
Out = Annotated[Path | None, typer.Option("-o", "--out", help="Folder for result files, figures and playback pages.")]
Workers = Annotated[int | None, typer.Option("--workers", min=1, help="Processes; default: the cores at hand.")]


def emit(record: Any) -> None:
    """Print a record as JSON."""
    typer.echo(json.dumps(record, indent=2, allow_nan=False))


def end(failures: dict[Any, Any], stopped: BaseException | None = None, unverified: bool = False) -> None:
    """Print failures, and end with the exit code that they deserve."""
    for failure in failures.values():
        ending.print_error(failure)
    if stopped:
        raise stopped
    if failures or unverified:
        raise typer.Exit(1)


def tell_written(paths: list[Path], quiet: bool) -> None:
    """Say which files were written."""
    for path in paths:
        if not quiet:
            typer.echo(f"wrote {path}")
