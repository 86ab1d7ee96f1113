"""Two readings of the paper, and the tasks of its tables in each; what differs between them stands in assumed.yaml."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any, Literal

from pkmsea.actuation.drive import Bounds
from pkmsea.files import read_yaml
from pkmsea.study import calibrate, with_drive_numbers
from pkmsea.task import Setup, Task, load_task

FOLDER = Path(__file__).parent
TABLES = (1, 2, 3, 4)
Reading = Literal["printed", "implied"]
READINGS: tuple[Reading, ...] = ("printed", "implied")
LIGHT = (2, 3)  # tables with light rotors, which the limits of assumed.yaml hold
FREE = 2, "printed"  # the table and reading that show a row without them, too
WITHOUT_LIMITS = "RAPKM SEA, no limits"
RIGID = {1: "FA-RD", 2: "PKM RD", 3: "PKM RD", 4: "PKM RD"}
CALIBRATED = {  # numbers of a table, in order, and the table of the row that each is calibrated on
    1: {"copper_loss": 1},
    2: {"copper_loss": 2},
    3: {"copper_loss": 2, "friction": 3},
    4: {"copper_loss": 2, "inertia": 4},
}
BEGIN = {  # where the calibrations begin, in each reading
    ("copper_loss", 1): {"printed": 1.5e-3, "implied": 3.9e-3},
    ("copper_loss", 2): {"printed": 63.0, "implied": 88.0},
    ("friction", 3): {"printed": 4.8e-3, "implied": 6.2e-3},
    ("inertia", 4): {"printed": 4.7e-4, "implied": 5.0e-4},
}

Numbers = dict[str, float]


@cache
def paper_tables() -> dict[int, dict[str, Any]]:
    """The values that the paper prints, by table number."""
    tables: dict[int, dict[str, Any]] = read_yaml(FOLDER / "tables.yaml")
    return tables


@cache
def assumed() -> dict[str, Any]:
    """What the paper does not state, or does not mean, as assumed.yaml has it."""
    found: dict[str, Any] = read_yaml(FOLDER / "assumed.yaml")
    return found


@cache
def _printed(robot: str) -> Task:
    return load_task(FOLDER / f"{robot}.yaml")


def paper_task(table: int, numbers: Numbers | None = None, reading: Reading = "printed") -> Task:
    """The task of a table in one reading, with calibrated numbers of the drives put in."""
    robot = "linear_axis" if table == 1 else "pkm"
    said, task = assumed()["readings"][reading], _printed(robot)
    points = tuple(point.model_copy(update={"rest": said["rest"]["value"][robot]}) for point in task.cycle.points)
    setups = tuple(s.model_copy(update={"seed": said["seed"]["value"].get(s.mechanism)}) for s in task.setups)
    task = task.model_copy(update={"cycle": task.cycle.model_copy(update={"points": points}), "setups": setups})
    return with_drive_numbers(task, **numbers or {})


def table_task(table: int, numbers: Numbers | None = None, reading: Reading = "printed") -> Task:
    """`paper_task` with the limits of light rotors, and the setups of all rows."""
    task = paper_task(table, numbers, reading)
    if table not in LIGHT:
        return task
    limits = {key: value["value"] for key, value in assumed()["light_rotors"].items()}
    held = tuple(_held(setup, limits["speed"], tuple(limits["stiffness"])) for setup in task.setups)
    free = [s.model_copy(update={"name": WITHOUT_LIMITS}) for s in task.setups if s.name == "RAPKM SEA"]
    return task.model_copy(update={"setups": (*held, *free) if (table, reading) == FREE else held})


def _held(setup: Setup, speed: float, stiffness: tuple[float, float]) -> Setup:
    drives = (
        d.model_copy(update={"speed": speed, "stiffness": d.stiffness and Bounds(bounds=stiffness)})
        for d in setup.drives
    )
    return setup.model_copy(update={"drives": tuple(drives)})


def at_stiffness(setup: Setup, stiffness: tuple[float, ...]) -> Setup:
    """The setup with springs as they are given, one per drive."""
    drives = setup.drives * len(stiffness) if len(setup.drives) == 1 else setup.drives
    pairs = zip(drives, stiffness, strict=True)
    return setup.model_copy(update={"drives": tuple(d.model_copy(update={"stiffness": c}) for d, c in pairs)})


def calibrated_numbers(table: int, note: Callable[[str], None] | None = None, reading: Reading = "printed") -> Numbers:
    """The drive numbers of a table, each calibrated on a rigid row of the paper (see assumed.yaml)."""
    numbers: Numbers = {}
    for number, of in CALIBRATED[table].items():
        if note is not None:
            note(f"calibrating {number.replace('_', ' ')} ({reading})")
        numbers[number] = _calibrated(number, of, tuple(numbers.items()), reading)
    return numbers


@cache
def _calibrated(number: Any, table: int, others: tuple[tuple[str, float], ...], reading: Reading) -> float:
    energy = paper_tables()[table]["rows"][RIGID[table]]["energy"]
    return calibrate(
        paper_task(table, dict(others), reading), RIGID[table], number, energy, BEGIN[number, table][reading]
    )
