"""What a study has found, and its rows as solutions again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import pandas as pd

from pkmsea.errors import InputError, one_line
from pkmsea.files import file_name
from pkmsea.solution import Mesh, Solution
from pkmsea.solution.records import motion_of
from pkmsea.study.calibrate import Number, with_numbers
from pkmsea.study.study import Study
from pkmsea.study.table import DONE, HIDDEN, NAME, OPTIMUM, best, rank, records
from pkmsea.study.tasks import posed


@dataclass(frozen=True, eq=False, repr=False)
class StudyResult:
    """What a study has found; `rows` are all solved rows, `folder` is where table and result files are."""

    study: Study
    rows: pd.DataFrame
    folder: Path
    interrupted: bool

    def __repr__(self) -> str:
        stopped = ", interrupted" if self.interrupted else ""
        return one_line(f"<StudyResult '{self.study.name}': {len(self.rows)} rows in {self.folder}{stopped}>")

    @property
    def table(self) -> pd.DataFrame:
        """The best row of every case, setup and point: parameters, energy [J], stiffness c_i, status and so on."""
        return best(self.rows[self.rows["point"] != OPTIMUM]).drop(columns=HIDDEN)

    @property
    def optima(self) -> pd.DataFrame:
        """The task as it says itself, by case and setup; empty without `optimum`."""
        return best(self.rows[self.rows["point"] == OPTIMUM])

    def solution(self, case: str, setup: str, point: int) -> Solution:
        """The best solution of a point, ready to be drawn, played, verified or exported; -1 is the optimum.

        Raises
        ------
        InputError : there is no solution of this point.
        """
        found = best(self.rows[self.rows["outcome"] == DONE])
        chosen = found[(found["case"] == case) & (found["setup"] == setup) & (found["point"] == point)]
        if chosen.empty:
            raise InputError(
                f"Point {point} of case '{case}' and setup '{setup}' has no solution.",
                "Look at the table for those that have.",
                file=self.folder / NAME,
            )
        return self._solution(records(chosen)[0])

    def save_best(self) -> list[Path]:
        """Write the result file of the best point of each case and setup into the folder `best`."""
        solved = records(self.rows[self.rows["outcome"] == DONE])
        pairs = dict.fromkeys((row["case"], row["setup"]) for row in solved)
        rows = [min((r for r in solved if (r["case"], r["setup"]) == pair), key=rank) for pair in pairs]
        titles = [f"{case} {setup}" for case, setup in pairs]
        files = [self.folder / "best" / f"{file_name(title, titles)}.nc" for title in titles]
        return [self._solution(row).save(file) for row, file in zip(rows, files, strict=True)]

    def _solution(self, row: Mapping[str, Any]) -> Solution:
        """The solution that a row stands for, without its starts."""
        values = None if row["point"] == OPTIMUM else {name: row[name] for name in self.study.vary}
        problem, _ = posed(self.study, row["case"], row["setup"], values, self.folder)
        numbers = {name: row[name] for name in get_args(Number) if pd.notna(row[name])}
        meshes = tuple(Mesh(**mesh) for mesh in json.loads(row["meshes"]))
        motion = motion_of(json.loads(row["motion"]))
        return Solution(with_numbers(problem, **numbers), motion, row["claimed"], (), meshes, row["seconds"])
