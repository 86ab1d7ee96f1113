"""The table of a study: SQLite, one row per finished point, written at once; any tool for tables reads it."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping, Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pkmsea.errors import InputError, Unwritable
from pkmsea.study.study import COLUMNS, KEY

NAME = "study.sqlite"
FORMAT = "pkmsea study 2"
VERIFIED, UNVERIFIED, FAILED = "verified", "not verified", "failed"  # status
DONE, NO_BETTER, CRASHED = "done", "no better", "crashed"  # outcome, or FAILED; what crashed is solved again
OPTIMUM = -1  # the point that stands for the task as it says itself
QUOTED_KEY = ", ".join(f'"{name}"' for name in KEY)
TEXT = {"case", "setup", "outcome", "status", "reason", "optima", "motion", "meshes"}
HIDDEN = ["optima", "motion", "meshes"]  # columns for programs


class Table:
    """Rows by case, setup, point and round; a parameter and a stiffness c_i per column, NULL where there is none."""

    def __init__(self, file: Path, parameters: Sequence[str], drives: int, fingerprint: Mapping[str, str]) -> None:
        self.file, self.parameters = file, list(parameters)
        self.springs = [f"c_{i + 1}" for i in range(drives)]
        self.columns = [*KEY, *self.parameters, *self.springs, *COLUMNS]
        self._stored = _stored([*KEY, *self.springs, *COLUMNS, *self.parameters])
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            self._base = sqlite3.connect(file, isolation_level=None)
            self._base.execute("PRAGMA synchronous = NORMAL")
            self._create()
            self._agree(fingerprint)
            self._base.execute("DELETE FROM points WHERE outcome = ?", (CRASHED,))
        except (OSError, sqlite3.Error) as error:
            raise InputError(
                f"The table of the study cannot be used ({error}).", "Choose another output folder with -o.", file=file
            ) from error

    def _create(self) -> None:
        kinds = [f'"{self._stored[name]}" {"TEXT" if name in TEXT else "REAL"}' for name in self.columns]
        for table in (
            "study (key TEXT PRIMARY KEY, value TEXT)",
            "calibrated (key TEXT PRIMARY KEY, number REAL)",
            f"points ({', '.join(kinds)}, PRIMARY KEY ({QUOTED_KEY}))",
        ):
            self._base.execute(f"CREATE TABLE IF NOT EXISTS {table}")

    def _agree(self, fingerprint: Mapping[str, str]) -> None:
        """Only rows of the same study stand in one table."""
        present = dict(self._base.execute("SELECT key, value FROM study"))
        if not present:
            self._base.execute("BEGIN")
            self._base.executemany("INSERT INTO study VALUES (?, ?)", {"format": FORMAT, **fingerprint}.items())
            self._base.execute("COMMIT")
            return
        different = [key for key, value in {"format": FORMAT, **fingerprint}.items() if present.get(key) != value]
        if different:
            raise InputError(
                f"The folder holds points of another study: its {' and '.join(different)} differed.",
                "Choose another output folder with -o, or delete this one.",
                file=self.file,
            )

    def add(self, row: Mapping[str, Any]) -> None:
        """Store one row for good.

        Raises
        ------
        Unwritable : the disk is full, say.
        """
        values = dict(row) | dict(zip(self.springs, row.get("stiffness", []), strict=False))
        plain = [
            None if isinstance(x := values.get(name), float) and not np.isfinite(x) else x for name in self.columns
        ]
        self._insert("points", plain)

    def add_calibrated(self, key: str, number: float) -> None:
        """Store a calibrated number by what it depends on. Raises like `add`."""
        self._insert("calibrated", [key, number])

    def _insert(self, table: str, values: Sequence[Any]) -> None:
        try:
            self._base.execute(f"INSERT OR REPLACE INTO {table} VALUES ({', '.join('?' * len(values))})", values)
        except sqlite3.Error as error:
            raise Unwritable(
                f"The table of the study cannot be written ({error}).",
                "Make room on the disk, and run the same command again: it goes on.",
                file=self.file,
            ) from error

    def rows(self) -> pd.DataFrame:
        """Every row, in the order of its key."""
        frame = pd.read_sql_query(f"SELECT * FROM points ORDER BY {QUOTED_KEY}", self._base)
        named = {column: name for name, column in self._stored.items()}
        return frame.rename(columns=named).astype({"point": int, "round": int})

    def calibrated(self) -> dict[str, float]:
        """The calibrated numbers by what they depend on."""
        return dict(self._base.execute("SELECT key, number FROM calibrated"))

    def close(self) -> None:
        self._base.close()


def _stored(names: Sequence[str]) -> dict[str, str]:
    """The column of each name: SQLite does not tell upper from lower case, so that 'K' beside 'k' stands in 'K-2'."""
    columns: dict[str, str] = {}
    for name in names:
        taken = {column.casefold() for column in columns.values()}
        free = (x for x in chain([name], (f"{name}-{i}" for i in count(2))) if x.casefold() not in taken)
        columns[name] = next(free)
    return columns


def rank(row: Mapping[str, Any]) -> tuple[int, float]:
    """Verified rows first, then others with an energy, failed ones last; each by energy [J]."""
    order = (VERIFIED, UNVERIFIED, FAILED).index(row["status"])
    return order, np.inf if row["status"] == FAILED else row["energy"]


def records(frame: pd.DataFrame) -> list[dict[str, Any]]:
    """The rows as plain data."""
    return [{str(name): value for name, value in row.items()} for row in frame.to_dict("records")]


def best(rows: pd.DataFrame) -> pd.DataFrame:
    """The best row of every case, setup and point."""
    solved = rows[rows["outcome"] != NO_BETTER]
    ranks = pd.DataFrame([rank(row) for row in records(solved)], solved.index, ["order", "least"])
    ordered = solved.join(ranks).sort_values(["case", "setup", "point", "order", "least", "round"], kind="stable")
    return ordered.drop_duplicates(["case", "setup", "point"]).drop(columns=["order", "least"]).reset_index(drop=True)


def first_claim(row: Mapping[str, Any]) -> float:
    """What the first mesh of a row claims [J]."""
    return float(json.loads(row["meshes"])[0]["claimed"])
