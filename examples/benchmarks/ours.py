"""All that the benchmark asks of pkmsea: problems, timed solves, and what the rockit baseline shares with them."""

from __future__ import annotations

import time
from typing import Any

import casadi as ca
import numpy as np

from pkmsea.actuation import NUMBERS as NUMBERS_OF_DRIVES
from pkmsea.actuation import flat_map
from pkmsea.motion import Motion
from pkmsea.motion.bases import SplineBasis
from pkmsea.motion.series import Series, series
from pkmsea.paper.readings import paper_task
from pkmsea.problem import Problem, build_problem
from pkmsea.problem.bounds import near
from pkmsea.solution.audit import audit
from pkmsea.solver.ipopt import solve_nlp
from pkmsea.task import Chain, Options, Spline, TaskLimits
from pkmsea.transcription import Transcription, transcribe

__all__ = ["Motion", "Problem", "Series", "series", "transcribe"]

# As `pkmsea reproduce` calibrates them on the rigid rows: copper loss [W/(N m)^2], friction [N m s], inertia [kg m^2]
NUMBERS: dict[int, dict[str, float]] = {
    2: {"copper_loss": 63.22},
    3: {"copper_loss": 63.22, "friction": 4.791e-3},
    4: {"copper_loss": 63.22, "inertia": 4.674e-4},
}
PER_KNOT = 4  # samples per knot, as in the default transcription
TRIES = 8  # random paths per start until one stays in the workspace
DEGREE = 7  # of the spline that is laid through a baseline's samples for the audit


def problem(table: int, setup: str, options: Options, stiffness: tuple[float, ...] = ()) -> Problem:
    """The paper's problem with other options, of its limits those of the drives; `stiffness` fixes the springs."""
    task = paper_task(table, NUMBERS[table]).model_copy(update={"limits": TaskLimits(urdf=False)})
    chosen = task.setup(setup).model_copy(update={"options": options})
    if stiffness:
        drive = chosen.drives[0]
        chosen = chosen.model_copy(
            update={"drives": tuple(drive.model_copy(update={"stiffness": c}) for c in stiffness)}
        )
    return build_problem(task.model_copy(update={"setups": (chosen,)}), setup)


def flat_options(samples: int, iterations: int, limit: float) -> Options:
    """The default transcription on a grid of `samples`; `limit` is the time of one start [s]."""
    knots = max(round(samples / PER_KNOT), 2 * PER_KNOT)
    trajectory = Spline(kind="spline", knots=knots)
    return Options(trajectory=trajectory, samples=samples, iterations=iterations, time_limit=limit)


def paper_options(samples: int, iterations: int, limit: float) -> Options:
    """The paper's transcription with its chain of integrators."""
    chain = Chain(kind="chain")
    return Options(transcription="paper", trajectory=chain, samples=samples, iterations=iterations, time_limit=limit)


def start(transcription: Transcription, index: int) -> np.ndarray:
    """The x of a start: 0 is the plain one, the others are random, seeded as in the multi-start."""
    for attempt in range(TRIES):
        try:
            return transcription.start(np.random.default_rng([0, index, attempt]) if index else None)
        except FloatingPointError:
            continue
    raise RuntimeError(f"no path of start {index} stays in the workspace")


def solve(transcription: Transcription, x: np.ndarray, last_step: bool = False) -> tuple[dict[str, Any], np.ndarray]:
    """Solve from x to full sharpness, again with the drives' limits where they are overstepped; a record, and x.

    `last_step` leaves out the steps before it, for starts near a solution.
    """
    begin, points = time.perf_counter(), []
    limited: tuple[str, ...] = ()
    for _ in range(2):
        nlp = transcription.nlp(x, limited)
        steps = range(nlp.steps - 1 if last_step else 0, nlp.steps)
        points.append(solve_nlp(nlp, transcription.problem.options, steps, warm=last_step))
        x = points[-1].x
        limited = near(transcription.excesses(x), 0.0)
        if not points[-1].usable or not limited:
            break
    record = {
        "outcome": points[-1].outcome.value,
        "usable": points[-1].usable,
        "iterations": sum(sum(point.iterations) for point in points),
        "seconds": time.perf_counter() - begin,
        "solver_seconds": sum(point.seconds for point in points),
        "evaluation_seconds": sum(point.evaluation for point in points),
        "claimed": transcription.claimed(x),
    }
    return record, x


def truth(posed: Problem, motion: Motion, claimed: float) -> dict[str, Any]:
    """Stiffness, true energy [J] and excess over the rest windows [m] of a motion; None where it has no pose."""
    stiffness = [float(c) for c in motion.stiffness[~np.isnan(motion.stiffness)]]
    try:
        found, _ = audit(posed, motion, claimed)
    except (FloatingPointError, np.linalg.LinAlgError):
        return {"stiffness": stiffness, "energy": None, "window": None}
    return {"stiffness": stiffness, "energy": found.value, "window": found.window}


def through(posed: Problem, r_E: np.ndarray, stiffness: np.ndarray) -> Motion:
    """The motion through equally spaced samples (N, delta) of one period: a spline with one knot per sample."""
    basis = SplineBasis(posed.cycle.period, r_E.shape[0], DEGREE)
    t = np.arange(r_E.shape[0]) * basis.period / r_E.shape[0]
    return Motion(basis, basis.fit(t, r_E), stiffness.copy())


def exact_map(posed: Problem) -> tuple[ca.Function, ca.DM, ca.DM]:
    """The flat map of the robot, its inputs for parallel springs that are not there, and the drives' numbers."""
    numbers = [posed.actuation.numbers(name) for name in NUMBERS_OF_DRIVES]
    return flat_map(posed.actuation.structure), ca.DM.zeros(posed.actuation.m), ca.DM(np.concatenate(numbers))
