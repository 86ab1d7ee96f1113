"""Draw the answer of rest_time.yaml: at which rest do the elastic rows of the paper's tables 3 and 4 come out?

pkmsea study examples/studies/rest_time.yaml -o results/rest_time
python examples/studies/rest_time.py results/rest_time [figure.png]
"""

import sqlite3
import sys
from pathlib import Path

import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from pkmsea.paper.readings import READINGS, assumed, paper_tables

SPRINGS = {"best springs": ("", "#1f77b4", "o-"), "the paper's springs": (" at its springs", "#e08e2b", "s--")}
HIGHEST = 130  # of the ratios that are drawn [%]
MS = 1000


def ratios(points: pd.DataFrame, case: str) -> pd.Series:
    """Energy of PKM SEA relative to that of PKM RD [%], over the rest [ms]."""
    energy = points[points["case"] == case].pivot_table("energy", "rest", "setup", aggfunc="min")
    energy.index *= MS
    return 100 * energy["PKM SEA"] / energy["PKM RD"]


def draw(panel: Axes, points: pd.DataFrame, table: int) -> None:
    """One table: ours over the rest, the paper's ratio, and the rests of both readings."""
    for label, (ending, color, style) in SPRINGS.items():
        ratio = ratios(points, f"table {table}{ending}")
        panel.plot(ratio.index, ratio, style, color=color, label=f"PKM SEA, {label}", ms=4.5, lw=1.6)
    rows = paper_tables()[table]["rows"]
    paper = 100 * rows["PKM SEA"]["energy"] / rows["PKM RD"]["energy"]
    panel.axhline(paper, color="#444444", ls=":", lw=1.6, label=f"the paper: {paper:.1f} %")
    for reading in READINGS:
        rest = MS * assumed()["readings"][reading]["rest"]["value"]["pkm"]
        panel.axvline(rest, color="#bbbbbb", lw=1, zorder=0)
        panel.text(rest, 2, f" {reading}", color="#666666", rotation=90, ha="right", va="bottom")
    panel.set(title=f"table {table}: {paper_tables()[table]['title']}", xlabel="rest [ms]", ylim=(0, HIGHEST))
    panel.grid(alpha=0.25)
    panel.legend(loc="upper left", fontsize=8)


def main(folder: Path, target: Path | None = None) -> None:
    """Print the ratios, and draw them."""
    with sqlite3.connect(folder / "study.sqlite") as base:
        points = pd.read_sql_query("SELECT * FROM points", base)
    table = pd.DataFrame({case: ratios(points, case) for case in points["case"].unique()})
    print(table.round(1).to_string())
    figure = Figure(figsize=(9.5, 4.2), layout="constrained")
    for panel, number in zip(figure.subplots(1, 2, sharey=True), (3, 4), strict=True):
        draw(panel, points, number)
    figure.axes[0].set_ylabel("E / E of PKM RD [%]")
    figure.savefig(target or folder / "rest_time.png", dpi=160)


if __name__ == "__main__":
    main(*map(Path, sys.argv[1:]))
