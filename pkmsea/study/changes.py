"""Changing numbers of a task and of its mechanisms by their keys, such as `cycle.period` or `drives.*.inertia`."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pkmsea.description import find
from pkmsea.description.source import read_source
from pkmsea.errors import InputError, NameNotFound
from pkmsea.files import parse
from pkmsea.study.geometry import changed_mechanism
from pkmsea.study.keys import Missing, assign
from pkmsea.task import Task

DRIVES, MECHANISM = "drives.", "mechanism."
OF_SPRINGS = ("stiffness", "cubic", "damping")  # keys that a rigid drive does not have


def changed_task(task: Task, numbers: Mapping[str, float], folder: Path) -> Task:
    """The task with numbers replaced; changed mechanisms are written into `folder`.

    Keys are those of the task file. `drives.I.KEY` (I: index, joint, or * for all) is a drive of all setups that have
    it; `mechanism.KEY` changes their mechanisms, see `pkmsea.study.geometry`.

    Raises
    ------
    NameNotFound : a key leads nowhere. InputError : the changed task is impossible.
    """
    data = json.loads(task.model_dump_json())
    actuated = cache(_actuated)  # for this call: before the next one the files may change
    mechanisms = {key.removeprefix(MECHANISM): x for key, x in numbers.items() if key.startswith(MECHANISM)}
    for key, number in numbers.items():
        if key.startswith(DRIVES):
            _change_drives(data, key, number, task, actuated)
        elif not key.startswith(MECHANISM):
            try:
                assign(data, key.split("."), number)
            except Missing as missing:
                raise NameNotFound("number", key, missing.names, key=key) from None
    changed = parse(Task, data, task.file).read_from(task.file)
    return _with_mechanisms(changed, mechanisms, folder) if mechanisms else changed


def _change_drives(
    data: dict[str, Any], key: str, number: float, task: Task, actuated: Callable[[Path], tuple[str, ...]]
) -> None:
    which, _, what = key.removeprefix(DRIVES).partition(".")
    found, known = 0, set[str]()
    for setup, record in zip(task.setups, data["setups"], strict=True):
        joints = actuated(task.mechanism_source(setup))
        drives = record["drives"]
        if len(drives) == 1 and len(joints) > 1:
            record["drives"] = drives = [json.loads(json.dumps(drives[0])) for _ in joints]
        labels = [*map(str, range(len(drives))), *joints]
        chosen = range(len(drives)) if which == "*" else [labels.index(which) % len(drives)] if which in labels else []
        known |= {"*", *labels}
        for i in chosen:
            if drives[i]["kind"] == "rigid" and what.split(".")[0] in OF_SPRINGS:
                continue
            try:
                assign(drives[i], what.split("."), number)
                found += 1
            except Missing as missing:
                known = {f"{which}.{name}" for name in missing.names}
    if not found:
        raise NameNotFound("drive or number", key, sorted(f"{DRIVES}{name}" for name in known), key=key)


def _actuated(source: Path) -> tuple[str, ...]:
    """Joints of the drives, as far as the files name them."""
    return read_source(find(source)).draft.actuated or ()


def _with_mechanisms(task: Task, numbers: Mapping[str, float], folder: Path) -> Task:
    if any(setup.seed for setup in task.setups) and (of_seed := [key for key in numbers if key.startswith("seed.")]):
        raise InputError(
            "A setup of the task has a seed, which goes before the mechanism's.",
            "Take it out of the task.",
            key=f"{MECHANISM}{of_seed[0]}",
        )
    sources = {setup.mechanism: task.mechanism_source(setup) for setup in task.setups}
    folders, left = {}, dict[str, Missing]()
    reached = set[str]()
    for name, source in sources.items():
        folders[name], missing = changed_mechanism(find(source), numbers, folder)
        reached |= numbers.keys() - missing.keys()
        left |= missing
    for key in numbers.keys() - reached:
        raise NameNotFound("number", f"{MECHANISM}{key}", left[key].names, key=f"{MECHANISM}{key}")
    setups = tuple(s.model_copy(update={"mechanism": str(folders[s.mechanism].resolve())}) for s in task.setups)
    return task.model_copy(update={"setups": setups})
