"""Solve every task of the gallery; write one picture of all and a table of their energies.

Run it from anywhere: python examples/gallery/gallery.py -o results
"""

import argparse
import sys
from pathlib import Path

from picture import draw

import pkmsea

HERE = Path(__file__).parent
ENTRIES = ("five_bar", "planar_delta", "four_bar_press", "two_link_arm", "elastic_arm", "ur5", "linear_axis")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=Path, default=Path("results"))
    parser.add_argument("--starts", type=int, help="instead of the tasks' own")
    parser.add_argument("--only", nargs="+", choices=ENTRIES, default=ENTRIES, metavar="ENTRY", help="some entries")
    arguments = parser.parse_args()
    arguments.out.mkdir(parents=True, exist_ok=True)
    solved = []
    for entry in arguments.only:
        task = pkmsea.load_task(HERE / entry / "task.yaml")
        task = task.with_starts(arguments.starts) if arguments.starts else task
        solved.append(pkmsea.solve_all(task))
        print(row(entry, solved[-1]), flush=True)
    head = ["| task | mobility | drives | E rigid [J] | elastic, relative to rigid |", "|---|---|---|---|---|"]
    rows = [row(entry, solutions) for entry, solutions in zip(arguments.only, solved, strict=True)]
    (arguments.out / "gallery.md").write_text("\n".join([*head, *rows, ""]))
    draw(solved, arguments.out / "gallery.png")
    unverified = [f"{s.problem.title}, {s.name}: {s.status}" for each in solved for s in each if not s.verified]
    if unverified:
        sys.exit("\n".join(unverified))


def row(entry: str, solutions: list[pkmsea.Solution]) -> str:
    """One line of the table; the first setup is the rigid one."""
    rigid, *elastic = solutions
    mechanism = rigid.problem.actuation.mechanism
    relative = ", ".join(f"{s.name} {s.energy / rigid.energy:.1%}" for s in elastic).replace("%", " %")
    name = f"[{rigid.problem.title}]({entry}/task.yaml)"
    return f"| {name} | {mechanism.mobility} | {len(mechanism.actuated)} | {rigid.energy:.3g} | {relative} |"


if __name__ == "__main__":
    main()
