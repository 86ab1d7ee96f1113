"""The solution of one setup: frozen, audits itself, saves itself."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np

from pkmsea.errors import SolveError
from pkmsea.problem import Problem
from pkmsea.solution.audit import Audit, Series, audit
from pkmsea.solution.refine import Mesh, agree
from pkmsea.solver import Start
from pkmsea.transcription import Motion


@dataclass(frozen=True, eq=False)
class Solution:
    """An energy-optimal cycle.

    Attributes
    ----------
    problem : what was solved.
    motion : the flat output and the stiffnesses; everything else follows from them.
    claimed : energy as the transcription claims it [J].
    starts : every start of the multi-start and its outcome.
    meshes : the refinement.
    seconds : wall time of the whole solve.
    interrupted : whether Ctrl-C ended the multi-start early; the solution is the best of what was found by then.
    """

    problem: Problem
    motion: Motion
    claimed: float
    starts: tuple[Start, ...]
    meshes: tuple[Mesh, ...]
    seconds: float
    interrupted: bool = False

    @cached_property
    def _audited(self) -> tuple[Audit, Series]:
        try:
            return audit(self.problem, self.motion, self.claimed)
        except FloatingPointError as error:
            raise SolveError(f"This is no motion of the robot: {error}.", "Solve the task again.") from error

    def audit(self) -> Audit:
        """Checks on a dense grid by the exact flat map; see `Audit`."""
        return self._audited[0]

    @property
    def series(self) -> Series:
        """The whole motion on the audit's dense grid."""
        return self._audited[1]

    @property
    def energy(self) -> float:
        """True energy per cycle: the integral of max(P, 0) on a dense grid [J]."""
        return self.audit().energy

    @property
    def stiffness(self) -> np.ndarray:
        """Stiffness of each elastic drive [N m/rad, N/m]."""
        return self.motion.stiffness[self.problem.actuation.elastic]

    @property
    def name(self) -> str:
        return self.problem.setup.name

    @property
    def faults(self) -> tuple[str, ...]:
        """What keeps the result from being verified: the audit's faults, and meshes that do not agree."""
        audit, options = self.audit(), self.problem.options
        if options.transcription == "paper" or agree(self.meshes, audit.scale, options.energy_tolerance):
            return audit.faults
        energies = ", ".join("unsolved" if mesh.energy is None else f"{mesh.energy:.4g} J" for mesh in self.meshes)
        return *audit.faults, f"no two successive meshes agree ({energies})"

    @property
    def verified(self) -> bool:
        return not self.faults

    @property
    def status(self) -> str:
        """'verified', or why not."""
        faults = self.faults
        return "not verified: " + "; ".join(faults) if faults else "verified"

    def save(self, path: str | Path) -> Path:
        """Write the result file (NetCDF), whole or not at all; see `pkmsea.solution.store`."""
        from pkmsea.solution.store import save

        return save(self, Path(path))
