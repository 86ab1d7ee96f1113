"""Refinement: an optimum on finer meshes, until the cost as claimed and as it is, and two successive meshes, agree."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pkmsea.motion import Motion
from pkmsea.solution.audit import Audit, audit
from pkmsea.solver import Outcome, Start
from pkmsea.solver.multistart import SHARPENING, improve
from pkmsea.solver.saddles import leave_saddles
from pkmsea.transcription import Transcription

SOFTER = slice(1, None)  # steps of the second try, where sharpening at once fails


@dataclass(frozen=True)
class Mesh:
    """One mesh of the refinement, and the cost that it claimed, and the true value; None where it could not be solved.

    `size` is the number of coefficients per entry of the flat output, `outcome` how its last solve ended.
    """

    size: int
    samples: int
    outcome: str
    claimed: float | None
    value: float | None
    iterations: int
    seconds: float


@dataclass(frozen=True, eq=False)
class Refined:
    """An optimum on its finest mesh, its audit there, and all its meshes."""

    motion: Motion
    audit: Audit
    meshes: tuple[Mesh, ...]
    tolerance: float

    @property
    def verified(self) -> bool:
        return self.audit.verified and agree(self.meshes, self.audit.scale, self.tolerance)

    @property
    def rank(self) -> tuple[bool, float]:
        """Verified ones first, then by true value."""
        return not self.verified, self.audit.value


def agree(meshes: Sequence[Mesh], scale: float, tolerance: float) -> bool:
    """Whether the true values of the last two meshes differ by no more than tolerance * scale."""
    if len(meshes) < 2:
        return False
    before, last = (mesh.value for mesh in meshes[-2:])
    return before is not None and last is not None and abs(last - before) <= tolerance * scale


def unrefined(transcription: Transcription, start: Start) -> Refined | None:
    """A start as it is; None where its motion cannot be followed between the grid points."""
    assert start.x is not None
    problem, motion = transcription.problem, transcription.motion(start.x)
    try:
        found = audit(problem, motion, start.claimed)[0]
    except FloatingPointError:
        return None
    mesh = Mesh(
        transcription.size,
        transcription.samples,
        start.outcome.value,
        start.claimed,
        found.value,
        start.iterations,
        start.seconds,
    )
    return Refined(motion, found, (mesh,), problem.options.energy_tolerance)


def refine(transcription: Transcription, start: Start) -> Refined | None:
    """Solve on meshes twice as fine each, every one from the last, until the result is verified.

    None where the start's motion cannot be followed between the grid points. A mesh that cannot be solved ends the
    refinement; what the mesh before it gave is kept.
    """
    options = transcription.problem.options
    end = time.perf_counter() + (options.time_limit or np.inf)
    if transcription.refines:
        start = leave_saddles(transcription, start)
    found = unrefined(transcription, start)
    finer = transcription.refined()
    while found is not None and finer is not None and not found.verified and len(found.meshes) < options.meshes:
        late = time.perf_counter() >= end
        solved = None if late else _solve_from(finer, found, start)
        if solved is None:
            outcome = Outcome.TIME if late else Outcome.FAILED
            failed = Mesh(finer.size, finer.samples, outcome.value, None, None, 0, 0.0)
            return Refined(found.motion, found.audit, (*found.meshes, failed), found.tolerance)
        found = Refined(solved.motion, solved.audit, (*found.meshes, *solved.meshes), found.tolerance)
        finer = finer.refined()
    return found


def _solve_from(finer: Transcription, found: Refined, start: Start) -> Refined | None:
    """The optimum on a finer mesh that is no worse than the motion it starts from, which the mesh contains."""
    x = finer.transfer(found.motion)
    enough = found.audit.value + found.tolerance * found.audit.scale
    for steps in (SHARPENING, SOFTER):
        solved = improve(finer, start.index, x, steps, limited=start.limited, warm=True)
        if solved.usable and (solved.outcome is Outcome.OPTIMAL or solved.claimed <= enough):
            return unrefined(finer, leave_saddles(finer, solved))
    return None
