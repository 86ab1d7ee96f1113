"""Rank the bases of study.yaml: how well do their elastic rows fit the paper's tables 2 to 4?

The misfit is the root mean square difference to the paper's E / E(PKM RD) in percentage points, over the six rows.

    pkmsea study examples/studies/base_geometry/study.yaml -o results/base_geometry
    python examples/studies/base_geometry/ranking.py results/base_geometry [CSV file for the table]
"""

import sqlite3
import sys
from pathlib import Path

import pandas as pd

from pkmsea.paper.readings import paper_tables

TABLE = {"no friction": 2, "friction": 3, "high inertia": 4}  # of the paper, by case
BASE = ["radius", "turn", "s_A", "s_B", "s_C"]
SHOWN = 12


def ranked(points: pd.DataFrame) -> pd.DataFrame:
    """Ratios in percent by setup and table, and their misfit: one row per base that has all, best first."""
    energy = points.pivot_table("energy", BASE, ["setup", "case"], aggfunc="min")
    ratios, paper = {}, {}
    for setup, case in energy.columns:
        rows = paper_tables()[TABLE[case]]["rows"]
        name, rigid = f"{setup} {TABLE[case]}", rows["PKM RD"]["energy"]
        ratios[name] = 100 * energy[setup, case] / rigid
        paper[name] = 100 * rows[setup]["energy"] / rigid
    table = pd.DataFrame(ratios).dropna()
    table = table[sorted(table)]
    table["misfit"] = ((table - pd.Series(paper)) ** 2).mean(axis=1) ** 0.5
    return table.sort_values("misfit")


def main(folder: Path, csv: Path | None = None) -> None:
    """Print the best bases, and how many cannot do the task."""
    with sqlite3.connect(folder / "study.sqlite") as base:
        points = pd.read_sql_query("SELECT * FROM points", base)
    table = ranked(points)
    print(table.head(SHOWN).reset_index().to_string(index=False, float_format="{:.4g}".format))
    bases = len(points[BASE].drop_duplicates())
    print(
        f"{bases - len(table)} of {bases} bases have failed rows: a point that the robot cannot reach, or a singularity"
    )
    if csv is not None:
        table.to_csv(csv, float_format="%.4f")


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
