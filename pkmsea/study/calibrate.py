"""Calibration: the value of one drive number for which a setup's least energy is a given one."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
from scipy.optimize import brentq

from pkmsea.errors import SolveError, Unverified, blaming
from pkmsea.problem import Problem, build_problem
from pkmsea.solution import Solution, solve
from pkmsea.task import Task

Number = Literal["inertia", "friction", "copper_loss"]
WIDENING = 1.6  # factor by which the bracket grows
WIDENINGS = 24


def with_drive_numbers(task: Task, **numbers: float) -> Task:
    """The same task with numbers of all drives of all setups replaced."""
    setups = [
        setup.model_copy(update={"drives": tuple(drive.model_copy(update=numbers) for drive in setup.drives)})
        for setup in task.setups
    ]
    return task.model_copy(update={"setups": tuple(setups)})


def with_numbers(problem: Problem, **numbers: float) -> Problem:
    """The same problem with numbers of all drives replaced."""
    return replace(problem, drives=tuple(drive.model_copy(update=numbers) for drive in problem.drives))


def calibrate(task: Task, setup: str, number: Number, energy: float, start: float, tolerance: float = 1e-5) -> float:
    """Find the value of a drive number with which the setup's minimal true energy is `energy` [J]; see `calibrated`."""
    with blaming(task.file):
        return calibrated(build_problem(task, setup), number, energy, start, tolerance)


def calibrated(problem: Problem, number: Number, energy: float, start: float, tolerance: float = 1e-5) -> float:
    """Find the value of a drive number with which the problem's minimal true energy is `energy` [J].

    The energy must grow with the number, which holds for losses and inertia of a rigid robot. The bracket is searched
    from `start` in factors of WIDENING, then closed by Brent's method in the logarithm.

    Raises
    ------
    SolveError : no value reaches the energy. Unverified : the least energy at a value is not verified.
    KeyboardInterrupt
    """
    single = replace(problem, options=problem.options.model_copy(update={"starts": 1}))
    last: list[Solution] = []  # a neighbour, from which the next one is found sooner

    @cache
    def excess(logarithm: float) -> float:
        value = float(np.exp(logarithm))
        at_value = with_numbers(single, **{number: value})
        solution = solve(at_value, workers=1, near=last[-1] if last else None)
        if last and not solution.verified:
            solution = solve(at_value, workers=1)
        if solution.interrupted:
            raise KeyboardInterrupt
        last[:] = [solution]
        if not solution.verified:
            raise Unverified(
                f"The energy of the setup '{problem.name}' is {solution.status} at this value.",
                "Raise the task's options.meshes, or begin elsewhere.",
                key=number,
                value=value,
            )
        return solution.energy / energy - 1.0

    low = high = np.log(start)
    below = above = excess(low)
    for _ in range(WIDENINGS):
        if below <= 0 <= above:
            break
        if below > 0:
            low -= np.log(WIDENING)
            below = excess(low)
        else:
            high += np.log(WIDENING)
            above = excess(high)
    if not below <= 0 <= above:
        raise SolveError(
            f"No value of {number} gives the setup '{problem.name}' an energy of {energy:g} J.",
            "Check the energy and the other numbers of the drives.",
            key=number,
        )
    if low == high:
        return float(np.exp(low))
    return float(np.exp(brentq(excess, low, high, xtol=tolerance, rtol=tolerance)))
