"""Track a solved cycle on a robot that is not the one it was solved for: three control laws, table and figure.

Run it from anywhere: python examples/tracking/tracking.py -o results
"""

import argparse
from collections.abc import Callable
from functools import partial
from pathlib import Path

from laws import POLES, Law, Reference, feedforward, flatness_based, motor_feedback
from picture import draw
from plant import Run, changed, simulate

import pkmsea

TASK = Path(__file__).with_name("task.yaml")
RATE = 1000.0  # of the controllers [Hz]
WRONG = {"stiffness": 0.9, "payload": 0.1}  # springs 10 % softer, payload of 10 % of the moving mass
PLANTS = {"as modelled": {"stiffness": 1.0, "payload": 0.0}, "wrong": WRONG}

Maker = Callable[[pkmsea.Solution, Reference], Law]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=Path, default=Path("results"))
    parser.add_argument("--poles", type=float, default=POLES, help="of the flatness-based law [1/s]")
    parser.add_argument("--quick", action="store_true", help="one start and one cycle")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    task = pkmsea.load_task(TASK).with_starts(1 if arguments.quick else 12)
    solution = pkmsea.solve(task)
    reference = Reference.of(solution, RATE, arguments.out / "feedforward.nc")
    laws: dict[str, Maker] = {
        "feed-forward": feedforward,
        "with motor feedback": motor_feedback,
        "flatness-based": partial(flatness_based, poles=arguments.poles),
    }
    runs: dict[tuple[str, str], Run] = {}
    rows: list[str] = []
    for plant, change in PLANTS.items():
        robot = changed(solution, **change)
        for name, make in laws.items():
            run = simulate(robot, make(solution, reference), solution, reference.step, 1 if arguments.quick else 4)
            runs[plant, name] = run
            measured = run.measures(solution) | {"same motion [J]": robot.energy, "planned [J]": solution.energy}
            if not rows:
                rows += [line(["plant", "law", *measured]), line(["---"] * (2 + len(measured)))]
            rows.append(line([plant, name, *(f"{value:.3g}" for value in measured.values())]))
    table = "\n".join(rows)
    print(table)
    (arguments.out / "tracking.md").write_text(table + "\n", encoding="utf-8")
    draw(
        solution, changed(solution, **WRONG), {law: runs["wrong", law] for law in laws}, arguments.out / "tracking.png"
    )


def line(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    main()
