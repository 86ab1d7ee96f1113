"""Commands on the files that people write: check, new, schema."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pkmsea.cli.app import Json, app, emit, tell_written


class Kind(StrEnum):
    mechanism = "mechanism"
    task = "task"
    study = "study"


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
    from pkmsea.description import find, skeleton
    from pkmsea.description.source import read_source
    from pkmsea.errors import InputError
    from pkmsea.mechanism import load_mechanism
    from pkmsea.views import tables

    try:
        loaded = load_mechanism(mechanism, guess=True)
    except InputError as error:
        if write and (file := skeleton.write_incomplete(read_source(find(mechanism)), error)):
            tell_written([file], json_)
        raise
    record = tables.mechanism_record(loaded)
    if write and (file := skeleton.write(loaded.description)):
        tell_written([file], json_)
    emit(record) if json_ else tables.print_mechanism(loaded, record)


@app.command()
def new(
    folder: Annotated[Path, typer.Argument(help="Folder to write to.")],
    urdf: Annotated[
        Path | None, typer.Option("--urdf", help="URDF, URDF+, xacro or MJCF file; else what the folder holds.")
    ] = None,
) -> None:
    """Start with a mechanism of your own: write its sidecar and a first task, to be corrected by you."""
    from pkmsea.new import new as write_new

    tell_written(write_new(folder, urdf), quiet=False)


@app.command()
def schema(kind: Annotated[Kind, typer.Argument(help="Kind of file.")]) -> None:
    """Print the JSON Schema of a kind of file."""
    from pkmsea.description.sidecar import Sidecar
    from pkmsea.files import Record
    from pkmsea.study import Study
    from pkmsea.task import Task

    kinds: dict[Kind, type[Record]] = {Kind.mechanism: Sidecar, Kind.task: Task, Kind.study: Study}
    emit(kinds[kind].model_json_schema())
