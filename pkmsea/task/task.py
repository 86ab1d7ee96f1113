"""The task file: one cycle, and the setups that are to perform it."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from pkmsea.actuation.cost import COSTS
from pkmsea.actuation.drive import Drive, Number
from pkmsea.errors import InputError, NameNotFound
from pkmsea.files import FromFile, Name, Record, read
from pkmsea.task.cycle import Cycle, Limits
from pkmsea.task.payload import Payload


class Fourier(Record):
    """Flat outputs as Fourier series: x_0 + sum_l A_l sin(l w t) + B_l cos(l w t) (paper, eq. Fourier)."""

    kind: Literal["fourier"]
    order: int = Field(10, ge=1, le=200)


class Spline(Record):
    """Flat outputs as periodic B-splines: piecewise polynomials of a degree, with all derivatives below it."""

    kind: Literal["spline"]
    knots: int = Field(50, ge=8, le=4000)
    degree: int = Field(7, ge=5, le=11)


class Chain(Record):
    """Flat outputs as chains of integrators with piecewise constant input, by RK4 multiple shooting (the paper's)."""

    kind: Literal["chain"]


Trajectory = Annotated[Fourier | Spline | Chain, Field(discriminator="kind")]


class Options(Record):
    """How a setup is solved. The defaults suit most tasks."""

    transcription: Literal["flat", "paper"] = "flat"
    trajectory: Trajectory = Spline(kind="spline")
    samples: int | None = Field(
        None, ge=8, le=20000, description="grid points of cost and limits; default: 4 per knot, at least 200"
    )
    starts: int = Field(12, ge=1, le=10000, description="starts of the multi-start")
    seed: int = Field(0, ge=0, description="of the random starts")
    time_limit: float | None = Field(
        None, gt=0, description="per start, all its steps together [s]; the result then depends on the computer's speed"
    )
    iterations: int = Field(300, ge=1, le=100000, description="IPOPT iterations per step; screening stops at 120")
    tolerance: float = Field(1e-6, gt=0, le=1e-2, description="IPOPT's tolerance")
    stagnation: float = Field(
        0.0, ge=0, le=1e-2, description="a solve ends once five iterations each change the energy by less, relatively"
    )
    meshes: int = Field(5, ge=1, le=8, description="at most, each twice as fine as the one before")
    energy_tolerance: float = Field(
        5e-3, gt=0, le=0.1, description="of claimed against true energy, and of the last two meshes; refined until met"
    )

    @model_validator(mode="after")
    def _chain_is_the_papers(self) -> Options:
        if self.trajectory.kind == "chain" and self.transcription != "paper":
            raise ValueError("a trajectory of kind 'chain' goes with transcription: paper")
        return self


class Setup(Record):
    """A mechanism with its drives, to perform the task's cycle."""

    name: Name
    mechanism: str = Field(description="folder, relative to the task file, or a mechanism that pkmsea ships")
    seed: dict[Name, Number] | None = Field(
        None, min_length=1, description="another assembly mode than the mechanism's, as joint positions [rad, m]"
    )
    drives: tuple[Drive, ...] = Field(min_length=1, description="one for all, or one per actuated joint")
    options: Options | None = None

    @field_validator("drives", mode="before")
    @classmethod
    def _one_for_all(cls, value: Any) -> Any:
        return [value] if isinstance(value, dict | Drive) else value


class TaskLimits(Record):
    """Limits of the motion, beside those of the drives."""

    end_effector: Limits = Limits()
    joints: Limits = Limits()
    urdf: bool = Field(True, description="whether position, velocity and effort of the URDF's joints hold, too")


class Task(FromFile):
    """A pick-and-place cycle, its limits, and one or more setups to compare; the first one is the reference."""

    name: Name
    cycle: Cycle
    limits: TaskLimits = TaskLimits()
    payload: Payload | None = Field(None, description="what the end effector carries")
    setups: tuple[Setup, ...] = Field(min_length=1)
    options: Options = Options()
    cost: str = Field("energy", description="what is minimised", json_schema_extra={"enum": list(COSTS)})

    @field_validator("cost")
    @classmethod
    def _known_cost(cls, value: str) -> str:
        if value not in COSTS:
            raise ValueError(f"there is no such cost; use one of: {', '.join(COSTS)}")
        return value

    @model_validator(mode="after")
    def _names_differ(self) -> Task:
        names = [setup.name for setup in self.setups]
        if len(set(names)) < len(names):
            raise ValueError("two setups have the same name")
        return self

    @model_validator(mode="after")
    def _payload_fits_cycle(self) -> Task:
        if self.payload is not None:
            self.payload.check(self.cycle)
        return self

    def setup(self, name: str | None = None) -> Setup:
        """The named setup, or the only one."""
        if name is None and len(self.setups) == 1:
            return self.setups[0]
        for setup in self.setups:
            if setup.name == name:
                return setup
        names = [setup.name for setup in self.setups]
        if name is None:
            raise InputError(
                f"The task '{self.name}' has {len(names)} setups.",
                f"Name one ({', '.join(names)}), or use solve_all.",
                file=self.file,
                key="setups",
            )
        raise NameNotFound("setup", name, names, file=self.file, key="setups")

    def with_starts(self, starts: int) -> Task:
        """The same task with another number of starts for every setup."""
        setups = tuple(
            setup.model_copy(update={"options": setup.options.model_copy(update={"starts": starts})})
            if setup.options
            else setup
            for setup in self.setups
        )
        options = self.options.model_copy(update={"starts": starts})
        return self.model_copy(update={"options": options, "setups": setups})

    def mechanism_source(self, setup: Setup) -> Path:
        """The setup's mechanism folder, looked up beside the task file first."""
        return self.beside(setup.mechanism)


def load_task(path: str | Path) -> Task:
    """Read a task file.

    Raises
    ------
    InputError : names file, key, value and remedy.
    """
    return read(Task, Path(path))
