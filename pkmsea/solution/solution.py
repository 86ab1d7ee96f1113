"""The solution of one setup: frozen, audits itself, saves itself."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass, fields
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from pkmsea.actuation.cost import ENERGY, positive
from pkmsea.description import meshes
from pkmsea.errors import SolveError, one_line
from pkmsea.motion import Motion, turns
from pkmsea.motion.series import Series
from pkmsea.problem import Cost, Problem, task_of
from pkmsea.solution import netcdf
from pkmsea.solution.audit import Audit, audit, status_of
from pkmsea.solution.local import optimality_of
from pkmsea.solution.netcdf import Array, Dataset
from pkmsea.solution.records import arrays_of, start_record
from pkmsea.solution.refine import Mesh, agree
from pkmsea.solver import Optimality, Optimum, Outcome, Start, optima
from pkmsea.transcription import TRANSCRIPTIONS

FORMAT = "pkmsea result 3"
MESH = "mesh"  # attribute of the copy of a mesh file: the name that the tree gives it
PACKAGES = ("pkmsea", "casadi", "pin", "numpy")  # whose versions are stored
STATED = 1e-6  # difference of a file's value from the recomputed one, relative like the audit's gap


@dataclass(frozen=True, eq=False, repr=False)
class Solution:
    """An optimal cycle, by default of least energy.

    Attributes
    ----------
    problem : what was solved.
    motion : the flat output and the stiffnesses; everything else follows from them.
    claimed : value of the cost as the transcription claims it.
    starts : every start of the multi-start and its outcome.
    meshes : the refinement.
    seconds : wall time of the whole solve.
    interrupted : whether Ctrl-C ended the multi-start early; the solution is the best of what was found by then.
    stated, file : true value that the file states from which this was loaded, and the file; None if it was solved.
    """

    problem: Problem
    motion: Motion
    claimed: float
    starts: tuple[Start, ...]
    meshes: tuple[Mesh, ...]
    seconds: float
    interrupted: bool = False
    stated: float | None = None
    file: Path | None = None

    @cached_property
    def _audited(self) -> tuple[Audit, Series]:
        try:
            return audit(self.problem, self.motion, self.claimed)
        except FloatingPointError as error:
            raise SolveError(f"This is no motion of the robot: {error}.", "Solve the task again.") from error

    def audit(self) -> Audit:
        """Checks on a dense grid by the exact flat map; see `Audit`."""
        return self._audited[0]

    @cached_property
    def _optimality(self) -> Optimality | None:
        try:
            return optimality_of(self.problem, self.motion, self.meshes, self.audit().scale)
        except SolveError:
            return None

    def optimality(self) -> Optimality | None:
        """First- and second-order conditions of a local minimum, on the motion's own mesh; see `Optimality`.

        None where there is no mesh to ask it on: the paper's transcription, or a stiffness outside its bounds.
        """
        return self._optimality

    @cached_property
    def optima(self) -> tuple[Optimum, ...]:
        """The distinct optima that the multi-start found, best first, and how often each; see `Optimum`."""
        return optima(self.starts)

    @property
    def series(self) -> Series:
        """The whole motion on the audit's dense grid."""
        return self._audited[1]

    @property
    def turns(self) -> dict[str, str]:
        """What joints gain per cycle, by their names, such as "'A' gains 1 turn"; empty where all return."""
        return turns.told(self.problem.mechanism, self.series.gain)

    @property
    def value(self) -> float:
        """True value of the problem's cost on a dense grid: by default the energy."""
        return self.audit().value

    @property
    def energy(self) -> float:
        """True electrical energy per cycle [J], whatever the cost: the integral of max(P, 0) on a dense grid."""
        power = self.series.power
        return ENERGY.value(positive(power), self.problem.cycle.period / power.size)

    @property
    def cost(self) -> Cost:
        """What was minimised."""
        return self.problem.cost

    @property
    def stiffness(self) -> np.ndarray:
        """Stiffness of each elastic drive [N m/rad, N/m]."""
        return np.array(list(self.motion.springs.values()))

    @property
    def name(self) -> str:
        return self.problem.name

    @property
    def label(self) -> str:
        """The name, with a word of warning if the result is not verified."""
        return self.name if self.verified else f"{self.name} (not verified)"

    @cached_property
    def faults(self) -> tuple[str, ...]:
        """What keeps the result from being verified.

        The audit's faults, meshes that do not agree, a point that is no local minimum, and a file that states another
        value than its motion has.
        """
        try:
            audit, options = self.audit(), self.problem.options
        except SolveError as error:
            return (error.cause,)
        faults = list(audit.faults)
        if TRANSCRIPTIONS[options.transcription].refines and not agree(
            self.meshes, audit.scale, options.energy_tolerance
        ):
            values = ["unsolved" if mesh.value is None else self.cost.show(mesh.value) for mesh in self.meshes]
            faults.append(f"no two successive meshes agree ({', '.join(values)})")
        if not self.interrupted and (optimality := self.optimality()) is not None:
            faults += optimality.faults
        if self.stated is not None and not abs(self.stated - audit.value) <= STATED * audit.scale:
            stated, found = (self.cost.show(value, ".6g") for value in (self.stated, audit.value))
            faults.append(f"the file states {stated}, its motion takes {found}")
        return tuple(faults)

    @property
    def verified(self) -> bool:
        return not self.faults

    @property
    def status(self) -> str:
        """'verified', with what is undecided about it, or why not."""
        optimality = None if self.faults else self.optimality()
        late = any(start.outcome is Outcome.TIME for start in self.starts)
        late |= any(mesh.outcome == Outcome.TIME.value for mesh in self.meshes)
        undecided = optimality.remark if optimality else ""
        return status_of(self.faults, undecided, "the time limit ended part of the search" if late else "")

    def __repr__(self) -> str:
        springs = ", ".join(f"{c:.4g}" for c in self.stiffness)
        try:
            value = self.cost.show(self.value)
        except SolveError:
            value = f"no {self.cost.label}"
        return one_line(f"<Solution '{self.name}': {value}, stiffness [{springs}], {self.status}>")

    def __getstate__(self) -> dict[str, Any]:
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def dataset(self) -> Dataset:
        """The result file's content, but for its meshes: labelled time series, with the record of the solve as
        attributes."""
        problem, audit, optimality = self.problem, self.audit(), self.optimality()
        record = {
            "format": FORMAT,
            "setup": problem.name,
            "task": task_of(problem).model_dump_json(),
            "mechanism": problem.mechanism.description.model_dump_json(),
            "basis": self.motion.basis.trajectory.model_dump_json(),
            problem.cost.name: audit.value,
            "claimed": self.claimed,
            "status": self.status,
            "audit": json.dumps({key: value for key, value in asdict(audit).items() if key != "cost"}),
            "optimality": json.dumps(optimality and asdict(optimality)),
            "optima": json.dumps([asdict(optimum) for optimum in self.optima]),
            "starts": json.dumps([start_record(start) for start in self.starts]),
            "meshes": json.dumps([asdict(mesh) for mesh in self.meshes]),
            "seconds": self.seconds,
            "versions": json.dumps({name: version(name) for name in PACKAGES}),
        }
        return Dataset(arrays_of(problem, self.motion), record)

    def save(self, path: str | Path) -> Path:
        """Write the result file (NetCDF), whole or not at all; see `pkmsea.solution.store`."""
        write(self.dataset(), self.problem, path := Path(path))
        return path


def write(dataset: Dataset, problem: Problem, path: Path) -> None:
    """Write a result file: the `dataset` of a solution, and the mesh files that its mechanism shows."""
    copies = {
        f"mesh_{i}": Array((f"byte_{i}",), np.frombuffer(content, np.uint8), {MESH: name})
        for i, (name, content) in enumerate(meshes.contents(problem.mechanism.description).items())
    }
    netcdf.write(Dataset({**dataset.arrays, **copies}, dataset.attrs), path)
