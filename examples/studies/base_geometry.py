"""Which assumption about the base of the paper's robot explains the elastic rows of its tables 2 to 4 best?

The paper leaves open the size and the turn of the base triangle, the elbow signs, and which two of the three arms are
the two-arm robot. The arms are alike, so another pair is a turned triangle: here arms A and B are always the pair, and
the bases A, B, C lie on a circle at the angles turn, turn + 120 and turn + 240 deg. The cycle is symmetric about both
diagonals, so turns from -15 to 75 deg stand for all; at both ends the base is its own mirror image.

Every candidate is calibrated on the rigid rows alone. Its misfit is the root mean square difference to the paper's
E / E(PKM RD) in percentage points. The two rows that differ most between the candidates, one of each robot, screen
them; the best are solved for all six rows with more starts.

    python examples/studies/base_geometry.py [--quick] [-o base_geometry.csv]      (tens of minutes on 2 cores)
"""

import argparse
import csv
import math
import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from pathlib import Path

import numpy as np
import yaml
from joblib import Parallel, delayed

from pkmsea import Mechanism, PkmseaError, calibrate, load_mechanism, solve
from pkmsea.paper.reproduce import START, paper_tables, paper_task
from pkmsea.study import with_drive_numbers
from pkmsea.study.calibrate import Number
from pkmsea.task import Cycle, Options, Spline

RADII, TURNS = (0.2, 0.4 / math.sqrt(3)), range(-15, 76, 15)  # circumradius [m], angle of base A [deg]
REACH = 0.4  # of an arm [m]
SECONDS = 5.0  # per start; a robot near a singularity would take minutes to fail
NUMBER: dict[int, Number] = {2: "copper_loss", 3: "friction", 4: "inertia"}  # calibrated on the table's rigid row
TOLERANCE = 3e-3  # of the calibrated logarithms: fine enough to tell differences of several percentage points
ENERGY = {table: {name: row["energy"] for name, row in paper_tables()[table]["rows"].items()} for table in NUMBER}
ROWS = list(product(("PKM SEA", "RAPKM SEA"), NUMBER))
PAPER = {(name, table): ENERGY[table][name] / ENERGY[table]["PKM RD"] for name, table in ROWS}
HEADER = ["radius", "turn", "signs", *(f"{name} {table}" for name, table in ROWS), "misfit", *NUMBER.values()]


@dataclass(frozen=True)
class Base:
    """Circumradius [m], angle of base A [deg] and elbow signs; then the drive numbers and ratios found for them."""

    radius: float
    turn: int
    signs: tuple[int, int, int]
    numbers: dict[str, float] = field(default_factory=dict, compare=False)
    ratios: dict[tuple[str, int], float] = field(default_factory=dict, compare=False)

    @property
    def misfit(self) -> float:
        """Root mean square difference to the paper's rows, as far as they are solved [percentage points]."""
        return 100 * math.sqrt(np.mean([(ratio - PAPER[row]) ** 2 for row, ratio in self.ratios.items()]))

    @property
    def doubled(self) -> bool:
        """Whether its mirror image, with A and B swapped and all signs flipped, stands for it."""
        return self.turn in (-15, 75) and self.signs < (-self.signs[1], -self.signs[0], -self.signs[2])

    def write(self, shipped: Path, folder: Path) -> None:
        """Copy a mechanism with this base, and a seed with these elbow signs."""
        shutil.copytree(shipped, folder)
        sidecar = yaml.safe_load((folder / "mechanism.yaml").read_text(encoding="utf-8"))
        robot = ET.parse(folder / sidecar["urdf"])
        for i, arm in enumerate(sidecar["actuated"]):
            angle, bend = math.radians(self.turn + 120 * i), self.signs[i] * math.acos(self.radius / REACH)
            for origin in robot.iterfind(f"joint[@name='{arm}']/origin"):
                origin.set("xyz", f"{self.radius * math.cos(angle):.9f} {self.radius * math.sin(angle):.9f} 0")
            sidecar["seed"] |= {arm: angle + math.pi + bend, f"elbow_{arm}": -2 * bend}
        robot.write(folder / sidecar["urdf"])
        (folder / "mechanism.yaml").write_text(yaml.safe_dump(sidecar), encoding="utf-8")

    def cells(self) -> list[str]:
        """The base as a row below HEADER, ratios in percent."""
        where = [f"{self.radius:.4f}", str(self.turn), "".join("+" if sign > 0 else "-" for sign in self.signs)]
        ratios = [f"{100 * self.ratios[row]:.1f}" if row in self.ratios else "?" for row in ROWS]
        numbers = [f"{self.numbers[number]:.3g}" if number in self.numbers else "?" for number in NUMBER.values()]
        return [*where, *ratios, f"{self.misfit:.2f}", *numbers]


PRESENT = Base(0.4 / math.sqrt(3), 60, (1, -1, -1))  # mirror image of the shipped base (A at 90 deg, signs +1 -1 +1)


def fit(base: Base, rows: Sequence[tuple[str, int]], options: Options) -> Base | None:
    """Solve elastic rows, with the drive numbers calibrated as needed; None where the robot cannot do the task."""
    task, numbers, ratios = paper_task(2), dict(base.numbers), dict(base.ratios)
    with tempfile.TemporaryDirectory() as name:
        for kind in ("pkm_2rrr", "pkm_3rrr"):
            base.write(load_mechanism(kind).folder, Path(name) / kind)
        setups = tuple(s.model_copy(update={"mechanism": f"{name}/{s.mechanism}"}) for s in task.setups)
        task = task.model_copy(update={"setups": setups, "options": options})
        try:
            if parted(load_mechanism(f"{name}/pkm_2rrr"), task.cycle):
                return None
            for setup, table in rows:
                fitted = task
                for t in sorted({2, table}):  # the copper loss of table 2 holds in all tables
                    number = NUMBER[t]
                    if number not in numbers:
                        energy = ENERGY[t]["PKM RD"]
                        numbers[number] = calibrate(fitted, "PKM RD", number, energy, START[number], TOLERANCE)
                    fitted = with_drive_numbers(fitted, **{number: numbers[number]})
                ratios[setup, table] = solve(fitted, setup, workers=1).energy / ENERGY[table]["PKM RD"]
        except (PkmseaError, FloatingPointError):
            return None
    return replace(base, numbers=numbers, ratios=ratios)


def parted(mechanism: Mechanism, cycle: Cycle) -> bool:
    """Whether a direct-kinematic singularity lies between the points: det(dr_E / dq_A,ind) has two signs."""
    poses = [mechanism.configuration(point.at) for point in cycle.points]
    jacobians = [np.array(mechanism.functions["end_effector_jacobian"](q)) @ mechanism.velocity_map(q) for q in poses]
    return len({np.sign(np.linalg.det(J)) for J in jacobians}) > 1


def fit_all(bases: Sequence[Base], rows: Sequence[tuple[str, int]], knots: int, starts: int) -> list[Base]:
    """Fit all but doubles on two processes; prints each as soon as it is there, returns the best first."""
    options, found = Options(trajectory=Spline(kind="spline", knots=knots), starts=starts, time_limit=SECONDS), []
    bases = [base for base in bases if not base.doubled]
    calls = (delayed(fit)(base, rows, options) for base in bases)
    for base in Parallel(n_jobs=2, return_as="generator_unordered")(calls):
        if base is not None:
            found.append(base)
            print(*base.cells(), flush=True)
    print(f"{len(bases) - len(found)} of {len(bases)} candidates cannot do the task\n", flush=True)
    return sorted(found, key=lambda base: base.misfit)


def main(arguments: Sequence[str] | None = None) -> list[Base]:
    """Run the study; returns all candidates, best first."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="only the present base, on few knots, with one start")
    parser.add_argument("-o", "--out", type=Path, help="CSV file for the table")
    asked = parser.parse_args(arguments)

    signs = product((1, -1), (1, -1), (1,))
    places = [PRESENT] if asked.quick else [Base(*place) for place in product(RADII, TURNS, signs)]
    knots, starts, kept = (16, 1, 0) if asked.quick else (30, 6, 4)
    pairs = fit_all(places, [("PKM SEA", 4)], knots, 1)
    modes = [replace(pair, signs=(*pair.signs[:2], sign)) for pair in pairs for sign in (1, -1)]
    screened = fit_all(modes, [("RAPKM SEA", 2)], knots, 1)
    best = [base for i, base in enumerate(screened) if i < kept or base == PRESENT]
    solved = fit_all(best, ROWS, knots, starts)
    lines = [HEADER, *(base.cells() for base in solved + [base for base in screened if base not in best])]
    for line in lines:
        print("".join(f"{cell:<13}" for cell in line))
    if asked.out is not None:
        with asked.out.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(lines)
    return solved


if __name__ == "__main__":
    main()
