"""The task of one point of a study."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pkmsea.errors import InputError, NameNotFound
from pkmsea.problem import Problem, build_problem
from pkmsea.study.changes import changed_task
from pkmsea.study.expressions import evaluate, names_in
from pkmsea.study.points import values_at
from pkmsea.study.study import Calibration, Study
from pkmsea.task import Task

MECHANISMS = "mechanisms"  # folder of the changed ones


def task_at(study: Study, case: str, values: Mapping[str, float] | None, out: Path) -> Task:
    """The study's task in one case with the varied parameters at some values; None leaves out what depends on them.

    Raises
    ------
    InputError : a key leads nowhere, an expression has no value, or the task becomes impossible; names the key.
    """
    expressions = {key: (f"cases.{case}.set.{key}", text) for key, text in study.cases[case].set.items()}
    expressions |= {key: (f"set.{key}" if key in study.set else f"vary.{key}", x) for key, x in study.keys.items()}
    if values is None:
        expressions = {k: given for k, given in expressions.items() if k not in study.vary and not names_in(given[1])}
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
        if error.key not in expressions:
            error.cause = f"With {changed}, {error.key or 'the task'} is impossible: {error.cause}"
        error.file, error.key = study.file, expressions.get(error.key or "", ("vary",))[0]
        raise


def posed(
    study: Study, case: str, setup: str, values: Mapping[str, float] | None, out: Path
) -> tuple[Problem, tuple[tuple[Calibration, Problem], ...]]:
    """The problem of a setup there, and those by which numbers of the case's drives are calibrated. Raises like
    `task_at`."""
    task = task_at(study, case, values, out)
    calibrate = ((c, build_problem(task, c.setup)) for c in study.cases[case].calibrate)
    return build_problem(task, setup), tuple(calibrate)


def check(study: Study, out: Path) -> int:
    """Whether every case makes sense at one of three points at least; returns the largest number of drives.

    Raises
    ------
    InputError : names the key of the study file.
    """
    ends = np.array([[0.0], [0.5], [1.0]]).repeat(len(study.vary), axis=1)
    trials = [dict(zip(study.vary, values, strict=True)) for values in values_at(study, ends).tolist()]
    return max(_drives(study, case, trials, out) for case in study.cases)


def _drives(study: Study, case: str, trials: list[dict[str, float]], out: Path) -> int:
    if study.optimum:
        task_at(study, case, None, out)
    faults = []
    for values in trials:
        try:
            task = task_at(study, case, values, out)
            return max(build_problem(task, name).actuation.m for name in study.names)
        except NameNotFound:
            raise
        except InputError as error:
            faults.append(error)
    raise faults[0]
