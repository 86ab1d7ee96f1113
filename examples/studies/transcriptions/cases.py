"""The six cases, the start that all schemes share, and one run of one scheme."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scheme import KNOTS

from pkmsea.motion import Motion
from pkmsea.paper.readings import paper_task
from pkmsea.problem import Problem, build_problem
from pkmsea.solution.audit import audit
from pkmsea.solver import Outcome, multistart
from pkmsea.solver.ipopt import solve_nlp
from pkmsea.task import Spline
from pkmsea.transcription.default import FlatTranscription

FRICTION, HIGH_INERTIA = 4.791e-3, 4.674e-4  # [N m s/rad], [kg m^2]; calibrated on the rigid rows of the paper
DRIVES: dict[str, dict[str, float]] = {
    "light rotor": {}, "friction": {"friction": FRICTION}, "heavy rotor": {"inertia": HIGH_INERTIA}
}  # fmt: skip
LOSSES = (10.0, 63.22)  # kappa [W/(N m)^2]
SIZES = (50, 100, 200, 400)
STARTS = 4  # of the default, whose best optimum is where all schemes begin
ITERATIONS, SECONDS = 150, 30.0  # per step of the sharpening, and for all steps of a solve


@dataclass(frozen=True)
class Run:
    """One scheme on one case at one size: what it claims [J], what is true [J], and how the solve went."""

    kappa: float
    drives: str
    scheme: str
    size: int
    points: int
    unknowns: int
    claimed: float
    true: float
    window: float  # overstepped by [m]; negative if kept
    outcome: str
    steps: int  # of the sharpening
    iterations: int
    seconds: float

    @property
    def gap(self) -> float:
        """Claim relative to truth, minus one."""
        return self.claimed / self.true - 1.0


def make_problem(kappa: float, drives: str) -> Problem:
    """PKM SEA of the paper's section 5; its torque limit of 0.3 N m is left out, so that all schemes solve the same."""
    return build_problem(paper_task(2, {"copper_loss": kappa, "torque": None, **DRIVES[drives]}), "PKM SEA")


def shared_start(problem: Problem) -> Motion:
    """The default's optimum of least true energy on a coarse mesh."""
    options = problem.options.model_copy(update={"starts": STARTS})
    transcription = FlatTranscription(replace(problem, options=options), Spline(kind="spline", knots=KNOTS), None)
    found, _ = multistart(transcription, workers=1)
    motions = [transcription.motion(start.x) for start in found if start.x is not None and start.usable]
    return min(motions, key=lambda motion: audit(problem, motion, 0.0)[0].value)


def run(
    problem: Problem, kappa: float, drives: str, kind: Callable[[Problem, int], Any], size: int, start: Motion
) -> Run:
    """Solve; where the last steps of the sharpening do not converge, as far as they do."""
    scheme = kind(problem, size)
    x = scheme.transfer(start)
    nlp = scheme.nlp(x)
    options = problem.options.model_copy(update={"iterations": ITERATIONS, "time_limit": SECONDS})
    begin = time.perf_counter()
    for steps in range(nlp.steps, 0, -1):
        point = solve_nlp(nlp, options, range(steps))
        if point.outcome is Outcome.OPTIMAL or time.perf_counter() - begin > SECONDS:
            break
    seconds = time.perf_counter() - begin
    claimed = scheme.claimed(point.x)
    try:
        result, _ = audit(problem, scheme.motion(point.x), claimed)
        true, window = result.value, result.window
    except (FloatingPointError, ArithmeticError):
        true, window = np.nan, np.nan
    return Run(
        kappa, drives, type(scheme).__name__, size, scheme.points, scheme.unknowns, claimed, true, window,
        str(point.outcome), steps, sum(point.iterations), seconds,
    )  # fmt: skip
