"""From a task file to a problem, and back; here errors learn which file they are about."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path

from pkmsea.actuation.cost import COSTS
from pkmsea.description import find, read, shipped
from pkmsea.description.description import Positions
from pkmsea.description.sidecar import SIDECAR
from pkmsea.errors import InputError, blaming
from pkmsea.files import parse
from pkmsea.mechanism import Mechanism, build_mechanism
from pkmsea.problem.problem import Problem
from pkmsea.task import Setup, Task, load_task


def build_problem(
    source: Task | str | Path, setup: str | None = None, *, mechanism: Mechanism | None = None
) -> Problem:
    """The problem of one setup of a task, or of a task file; the setup may be left out if there is only one.

    A mechanism that is given takes the place of the one that the setup names.

    Raises
    ------
    InputError : the setup does not fit its mechanism, or an operating point or rest window cannot be reached.
    """
    task = load_task(source) if isinstance(source, str | Path) else source
    chosen = task.setup(setup)
    with blaming(task.file):
        return Problem(
            name=chosen.name,
            mechanism=mechanism or _mechanism(task, chosen),
            drives=chosen.drives,
            cycle=task.cycle,
            limits=task.limits,
            payload=task.payload,
            options=chosen.options or task.options,
            title=task.name,
            cost=COSTS[task.cost],
        )


def task_of(problem: Problem) -> Task:
    """The task of one setup from which `build_problem` makes this problem.

    Raises
    ------
    InputError : a task cannot have this name, or this cost.
    """
    mechanism = problem.mechanism
    seed = mechanism.description.origin.seed
    setup = {
        "name": problem.name,
        "mechanism": _source_of(mechanism),
        "seed": None if seed is None else dict(seed),
        "drives": problem.drives,
    }
    keys = ("cycle", "limits", "payload", "options")
    data = {"name": problem.title, "setups": (setup,), "cost": problem.cost.name}
    data |= {key: getattr(problem, key) for key in keys}
    return parse(Task, data, None)


def _mechanism(task: Task, setup: Setup) -> Mechanism:
    """The mechanism, loaded again only if a file beside it has changed: its Functions are shared by many problems."""
    source = task.mechanism_source(setup)
    if not os.path.exists(source) and Path(setup.mechanism).name not in shipped():
        raise InputError(
            "There is no mechanism folder of this name.",
            f"Give a folder, relative to the task file, or one that pkmsea ships: {', '.join(shipped())}.",
            key=f"setups.{task.setups.index(setup)}.mechanism",
            value=setup.mechanism,
        )
    found = find(source)
    folder = found if found.is_dir() else found.parent
    files = sorted(path for path in folder.iterdir() if path.is_file())
    stamps = tuple((path, path.stat().st_mtime_ns, path.stat().st_size) for path in files)
    try:
        return _loaded(source, None if setup.seed is None else tuple(setup.seed.items()), stamps)
    except InputError as error:
        if setup.seed is not None and error.file is None:
            error.key = f"setups.{task.setups.index(setup)}.{error.key}"
        raise


@lru_cache(maxsize=16)
def _loaded(source: Path, seed: Positions | None, files: tuple[tuple[Path, int, int], ...]) -> Mechanism:
    return build_mechanism(read(source).seeded(seed))


def _source_of(mechanism: Mechanism) -> str:
    """What a task calls a mechanism: its name if pkmsea ships it, else its folder, or the file that stands alone."""
    origin = mechanism.description.origin
    folder, file = origin.folder.resolve(), origin.sidecar or origin.tree
    if folder.name in shipped() and folder == find(folder.name).resolve():
        return folder.name
    return str(folder if file.name == SIDECAR else file.resolve())
