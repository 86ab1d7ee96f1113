"""How the stage equations grow with the number of joints: instructions, time to build, and time for 200 instants.

`python examples/benchmarks/expressions.py [TASK...]` prints a table for planar chains of parallelograms with series
elastic drives and 4 to 40 joints, and for every setup of the task files (default: the UR5 of the gallery); d is the
mobility, 'ms' the median time of values, slope and curvature.
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import pkmsea
from pkmsea.actuation import NUMBERS, Actuation, Drive
from pkmsea.actuation.equations import StageFunctions, stage_functions
from pkmsea.problem import build_problem
from pkmsea.transcription.instants import Instants

JOINTS = (4, 6, 8, 12, 20, 40)
INSTANTS, REPEATS = 200, 20
UR5 = Path(__file__).parents[1] / "gallery" / "ur5" / "task.yaml"
DRIVE = Drive(kind="sea", inertia=1e-3, copper_loss=1.0, stiffness=50.0)
LINK = """<link name="{name}"><inertial><origin xyz="{centre}"/><mass value="0.2"/>
  <inertia ixx="1e-3" iyy="1e-3" izz="1e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
"""
JOINT = """<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/><origin xyz="{at}"/>
  <axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="1e3" velocity="1e3"/></joint>
"""


def chain(folder: Path, joints: int) -> Path:
    """A planar chain of parallelograms, three joints and one loop each, and of hinges, each on the one before."""
    parts, frames, closures, drives = [LINK.format(name="base", centre="0 0 0")], {}, [], []
    carrier, at = "base", (0.0, 0.0)

    def add(name: str, parent: str, x: float, y: float, centre: str) -> None:
        parts.append(LINK.format(name=name, centre=centre))
        parts.append(JOINT.format(name=f"q_{name}", parent=parent, child=name, at=f"{x} {y} 0"))

    for i in range(joints // 3):
        crank, coupler, rocker = f"crank_{i}", f"coupler_{i}", f"rocker_{i}"
        add(crank, carrier, *at, "0 0.1 0")
        add(coupler, crank, 0.0, 0.2, "0.2 0 0")
        add(rocker, carrier, at[0] + 0.4, at[1], "0 0.1 0")
        frames |= {f"end_{i}": {"link": coupler, "xyz": [0.4, 0, 0]}, f"pin_{i}": {"link": rocker, "xyz": [0, 0.2, 0]}}
        closures.append({"frames": [f"end_{i}", f"pin_{i}"]})
        drives.append(f"q_{crank}")
        carrier, at = coupler, (0.0, 0.1)
    for i in range(joints % 3):
        add(f"arm_{i}", carrier, *at, "0.1 0 0")
        drives.append(f"q_arm_{i}")
        carrier, at = f"arm_{i}", (0.2, 0.0)
    (folder / "chain.urdf").write_text(f'<robot name="chain">{"".join(parts)}</robot>')
    sidecar = {
        "frames": frames, "closures": closures, "plane": {"normal": [0, 0, 1]}, "gravity": [0, -9.81, 0],
        "actuated": drives, "independent": drives, "end_effector": {"frame": carrier, "joints": drives},
        "seed": dict.fromkeys(drives, 0.1),
    }  # fmt: skip
    (folder / "mechanism.yaml").write_text(json.dumps(sidecar))  # JSON is YAML
    return folder


def instructions(functions: StageFunctions) -> tuple[int, int, int]:
    """Of the unknowns, their slope and their curvature, without the linear systems."""
    unknowns = (functions.matrices, *functions.right, functions.outputs)
    slope = (*functions.slope_right, functions.slope)
    curvature = (*functions.adjoint_right, functions.curvature)
    return tuple(sum(f.n_instructions() for f in group) for group in (unknowns, slope, curvature))  # type: ignore[return-value]


def row(name: str, actuation: Actuation) -> str:
    begin = time.perf_counter()
    counts = instructions(stage_functions(actuation.structure))
    r = np.concatenate([actuation.numbers(key) for key in NUMBERS])
    instants = Instants(actuation.structure, (), r, np.zeros(INSTANTS))
    built = time.perf_counter() - begin
    instants.xi[: len(actuation.mechanism.joints)] = actuation.mechanism.seed[:, None]
    times = []
    for _ in range(REPEATS):
        begin = time.perf_counter()
        for step in (instants.solve, instants.differentiate, instants.bend):
            step()
        times.append(time.perf_counter() - begin)
    n, delta = actuation.mechanism.model.nq, actuation.mechanism.mobility
    cells = f"{name:24}{n:4}{delta:4}" + "".join(f"{count:11,}" for count in counts)
    return cells + f"{built:9.2f}{1e3 * float(np.median(times)):9.2f}"


def main(tasks: list[str]) -> None:
    print(f"{'robot':24}{'n':>4}{'d':>4}{'unknowns':>11}{'slope':>11}{'curvature':>11}{'build s':>9}{'ms':>9}")
    for joints in JOINTS:
        with tempfile.TemporaryDirectory() as folder:
            mechanism = pkmsea.load_mechanism(chain(Path(folder), joints))
        print(row(f"chain of {joints}", Actuation(mechanism, (DRIVE,) * len(mechanism.actuated))), flush=True)
    for file in tasks or [str(UR5)]:
        task = pkmsea.load_task(file)
        for setup in task.setups:
            print(row(setup.name[:23], build_problem(task, setup.name).actuation), flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
