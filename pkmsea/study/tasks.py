"""The task of one point of a study."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from pkmsea.errors import InputError
from pkmsea.problem import build_problem
from pkmsea.study.changes import changed_task
from pkmsea.study.expressions import evaluate
from pkmsea.study.study import Study
from pkmsea.task import Task

MECHANISMS = "mechanisms"  # folder of the changed ones


def task_at(study: Study, case: str, values: Mapping[str, float] | None, out: Path) -> Task:
    """The study's task in one case, with the varied parameters at some values; None leaves out all that they change.

    Raises
    ------
    InputError : a key leads nowhere, an expression has no value, or the task becomes impossible; names the key.
    """
    expressions = {key: (f"cases.{case}.set.{key}", text) for key, text in study.cases[case].set.items()}
    if values is not None:
        expressions |= {key: (f"set.{key}" if key in study.set else f"vary.{key}", x) for key, x in study.keys.items()}
    numbers: dict[str, float] = {}
    for key, (place, text) in expressions.items():
        try:
            numbers[key] = values[key] if values and text == key else evaluate(text, values or {})
        except InputError as error:
            error.file, error.key = study.file, place
            raise
    try:
        return changed_task(study.base, numbers, out / MECHANISMS)
    except InputError as error:
        changed = ", ".join(f"{key} = {number:.6g}" for key, number in numbers.items())
        error.cause += "" if error.key in expressions else f" ({error.key or 'the task'}, with {changed})"
        error.file, error.key = study.file, expressions.get(error.key or "", ("vary",))[0]
        raise


def check(study: Study, out: Path) -> int:
    """Whether the study's first point makes sense in every case; returns the largest number of drives.

    Raises
    ------
    InputError : names the key of the study file.
    """
    first = {name: varied.first for name, varied in study.vary.items()}
    drives = 0
    for case in study.cases:
        task = task_at(study, case, first, out)
        if study.optimum:
            task_at(study, case, None, out)
        drives = max(drives, *(build_problem(task, name).actuation.m for name in study.names))
    return drives
