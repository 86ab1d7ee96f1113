"""Whether a motion is a local optimum, asked on the very mesh on which it was solved."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pkmsea.motion import Motion
from pkmsea.problem import Problem
from pkmsea.problem.bounds import TOUCHING, near
from pkmsea.solution.refine import Mesh
from pkmsea.solver.ipopt import STAGNANT, Outcome
from pkmsea.solver.optimality import SAVING, Optimality, last_parameter, optimality
from pkmsea.solver.threads import one_thread
from pkmsea.transcription import transcribe_on

UNSHARP = 0.1  # of the energy's tolerance: what a solve that ended early may leave
SAME = 1e-9  # relative change of coefficients and stiffnesses on their way to the mesh: rounding


@one_thread
def optimality_of(problem: Problem, motion: Motion, meshes: Sequence[Mesh], unit: float) -> Optimality | None:
    """The conditions of a local minimum at a motion, values of the cost relative to `unit`; see `Optimality`.

    None where the motion has no NLP: the paper's transcription, no solved mesh, or a stiffness outside its bounds.
    """
    solved = [mesh for mesh in meshes if mesh.value is not None]
    transcription = transcribe_on(problem, motion.basis, solved[-1].samples) if solved else None
    if transcription is None:
        return None
    sharp = solved[-1].outcome == Outcome.OPTIMAL
    allowed = max(
        SAVING, STAGNANT * problem.options.stagnation, 0 if sharp else UNSHARP * problem.options.energy_tolerance
    )
    x = transcription.transfer(motion)
    again = transcription.motion(x)
    for name in ("coefficients", "stiffness", "parallel"):
        old, new = (np.nan_to_num(getattr(m, name)) for m in (motion, again))
        if not np.allclose(new, old, rtol=SAME, atol=SAME * np.abs(old).max(initial=0.0)):
            return None
    found = None
    for within in (None, TOUCHING):  # like the solve, which puts the limits of drives and joints in where it needs them
        try:
            limited = () if within is None else near(transcription.excesses(x), within)
            nlp = transcription.nlp(x, limited)
            p = last_parameter(nlp, x)
            J = float(nlp.oracle(x, p)[0])
            found = optimality(nlp, x, p, problem.cost.in_objective(unit, transcription.claimed(x), J), allowed)
        except (FloatingPointError, RuntimeError):  # CasADi's word for a point that cannot be evaluated
            return None
        if found.stationary:
            break
    return found
