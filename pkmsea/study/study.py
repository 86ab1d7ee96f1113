"""The study file: which numbers of a task or its mechanisms vary, how they are sampled, and what is solved there."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, PrivateAttr, model_validator

from pkmsea.actuation.drive import Positive
from pkmsea.errors import InputError, NameNotFound
from pkmsea.files import FromFile, Record, read
from pkmsea.study.expressions import names_in
from pkmsea.task import Task, load_task

MOST_POINTS = 100_000  # of one study, in all its cases
COLUMNS = (
    "outcome",
    "energy",
    "claimed",
    "status",
    "reason",
    "starts",
    "seconds",
    "copper_loss",
    "friction",
    "inertia",
    "optima",
    "motion",
    "meshes",
)  # of the table, beside the key, the varied parameters and the stiffnesses c_i
KEY = ("case", "setup", "point", "round")

Name = Annotated[str, Field(min_length=1, max_length=100, pattern=r"^[A-Za-z][\w .*+-]*$")]
Number = Annotated[float, Field(allow_inf_nan=False)]
Expression = Number | str


class Varied(Record):
    """What a parameter goes through: listed `values`, or an interval, evenly spread or by its logarithm."""

    values: tuple[Number, ...] | None = Field(None, min_length=1)
    range: tuple[Number, Number] | None = None
    log: tuple[Positive, Positive] | None = None
    count: int | None = Field(None, ge=1, description="values of an interval on a grid, ends included")
    label: str | None = Field(None, description="of the axis in figures, with the unit")

    @model_validator(mode="after")
    def _one_kind(self) -> Varied:
        if sum(kind is not None for kind in (self.values, self.range, self.log)) != 1:
            raise ValueError("give one of values, range and log")
        if self.values is not None and (self.count is not None or len(set(self.values)) < len(self.values)):
            raise ValueError("values have no count, and none of them twice")
        if self.values is None and self.ends[0] >= self.ends[1]:
            raise ValueError("the interval is empty; its first end must be below the second")
        return self

    @property
    def ends(self) -> tuple[float, float]:
        """The ends of an interval, or the least and the largest value."""
        return self.range or self.log or (min(self.values or (0.0,)), max(self.values or (0.0,)))

    @property
    def logarithmic(self) -> bool:
        return self.log is not None

    @property
    def size(self) -> int:
        """How many values it has on a grid."""
        return len(self.values) if self.values else self.count or 1


class Grid(Record):
    """Every combination of the values."""

    kind: Literal["grid"] = "grid"


class Sample(Record):
    """Points spread over the intervals: scrambled Sobol (2^k points) or Latin hypercube (scipy.stats.qmc)."""

    kind: Literal["sobol", "latin hypercube"]
    count: int = Field(ge=1)
    seed: int = Field(0, ge=0)

    @model_validator(mode="after")
    def _balanced(self) -> Sample:
        if self.kind == "sobol" and self.count & (self.count - 1):
            raise ValueError("Sobol points are balanced only if their count is a power of two")
        return self


class Search(Record):
    """An outer loop (optuna, TPE) for what the optimal control problem cannot move: the least energy of one setup."""

    kind: Literal["search"]
    count: int = Field(ge=1, description="trials")
    seed: int = Field(0, ge=0)
    together: int = Field(4, ge=1, le=64, description="trials that are asked for before their results are known")


class Calibration(Record):
    """At every point, first find the value of a drive number with which a setup's least energy is `energy`."""

    number: Literal["inertia", "friction", "copper_loss"]
    setup: str
    energy: float = Field(gt=0, description="[J]")
    start: float = Field(gt=0, description="where the search begins")
    tolerance: float = Field(1e-5, gt=0, le=0.1, description="of the value, relative")


class Case(Record):
    """Changes that hold for one case of the study, before the varied ones."""

    set: dict[Name, Expression] = Field(default_factory=dict)
    calibrate: tuple[Calibration, ...] = ()


class Study(FromFile):
    """Many solves of one task; each point is a multi-start, and neighbours start each other."""

    name: str = Field(min_length=1, max_length=200)
    task: str = Field(description="task file, relative to the study file")
    setups: tuple[str, ...] | None = Field(None, min_length=1, description="default: all of the task")
    vary: dict[Name, Varied] = Field(min_length=1, description="keys of the task, or names for `set`")
    set: dict[Name, Expression] = Field(default_factory=dict, description="keys of the task by expressions")
    cases: dict[Name, Case] = Field(default_factory=lambda: {"all": Case()}, min_length=1)
    sample: Annotated[Grid | Sample | Search, Field(discriminator="kind")] = Grid()
    starts: int = Field(1, ge=0, le=1000, description="random starts per point, beside those from its neighbours")
    neighbours: int = Field(2, ge=0, le=20, description="solved points that start a new one")
    rounds: int = Field(1, ge=1, le=5, description="in every further round all points start from their neighbours")
    optimum: bool = Field(False, description="also solve the task with the varied keys as it says itself")
    results: Literal["all", "best", "none"] = Field("all", description="points that leave a result file")
    _task: Task | None = PrivateAttr(None)

    @model_validator(mode="after")
    def _consistent(self) -> Study:
        for name in self.vary:
            if name.lower() in KEY + COLUMNS or re.fullmatch(r"c_\d+", name):
                raise ValueError(f"'{name}' names a column of the table already; choose another name in vary")
        grid = isinstance(self.sample, Grid)
        for name, varied in self.vary.items():
            if grid and varied.values is None and varied.count is None:
                raise ValueError(f"vary.{name} has no count, which a grid needs")
        if self.starts + self.neighbours == 0:
            raise ValueError("without starts and neighbours there is nothing to begin from")
        solves = self.size * len(self.cases) * self.rounds
        if solves > MOST_POINTS:
            raise ValueError(f"these are {solves:.3g} points, more than {MOST_POINTS}; lessen the counts in vary")
        return self

    @property
    def size(self) -> int:
        """Points per case."""
        if isinstance(self.sample, Grid):
            return math.prod(varied.size for varied in self.vary.values())
        return self.sample.count

    @property
    def base(self) -> Task:
        """The task that is varied."""
        if self._task is None:
            self._task = load_task(self.beside(self.task).absolute())
        return self._task

    @property
    def names(self) -> list[str]:
        """The setups that are solved."""
        return list(self.setups or (setup.name for setup in self.base.setups))

    @property
    def keys(self) -> dict[str, Expression]:
        """What the varied parameters change, key by key: those that `set` asks for, and those that are keys."""
        texts = [text for given in (self.set, *(case.set for case in self.cases.values())) for text in given.values()]
        used = set().union(*map(names_in, texts))
        return {name: name for name in self.vary if name not in used} | self.set


def load_study(path: str | Path) -> Study:
    """Read a study file and the task that it names.

    Raises
    ------
    InputError : names file, key, value and remedy.
    """
    study = read(Study, Path(path))
    check_names(study)
    return study


def check_names(study: Study) -> None:
    """Setups, and names in expressions, exist.

    Raises
    ------
    InputError, NameNotFound
    """
    known = [setup.name for setup in study.base.setups]
    calibrated = [(f"cases.{c}.calibrate", r.setup) for c, case in study.cases.items() for r in case.calibrate]
    for key, name in [*(("setups", name) for name in study.names), *calibrated]:
        if name not in known:
            raise NameNotFound("setup", name, known, file=study.file, key=key)
    for place, expressions in [("set", study.set), *((f"cases.{n}.set", c.set) for n, c in study.cases.items())]:
        for key, expression in expressions.items():
            try:
                unknown = sorted(names_in(expression) - study.vary.keys())
            except InputError as error:
                error.file, error.key = study.file, f"{place}.{key}"
                raise
            if unknown:
                raise NameNotFound("parameter", unknown[0], list(study.vary), file=study.file, key=f"{place}.{key}")
