"""The table of a study: SQLite, one row per finished point, written at once; any tool for tables reads it."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from pkmsea.errors import InputError

NAME = "study.sqlite"
FORMAT = "pkmsea study 1"
KEY = ("case", "setup", "point", "round")
RESULT = (
    "outcome", "energy", "claimed", "status", "reason", "starts", "seconds", "copper_loss", "friction", "inertia",
    "motion", "meshes", "task",
)  # fmt: skip
TEXT = {"case", "setup", "outcome", "status", "reason", "motion", "meshes", "task"}
HIDDEN = ["motion", "meshes", "task"]  # columns for programs


class Table:
    """Rows by case, setup, point and round; a parameter and a stiffness c_i per column, NULL where there is none."""

    def __init__(self, file: Path, parameters: Sequence[str], drives: int, fingerprint: Mapping[str, str]) -> None:
        self.file, self.parameters = file, list(parameters)
        self.springs = [f"c_{i + 1}" for i in range(drives)]
        self.columns = [*KEY, *self.parameters, *self.springs, *RESULT]
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            self._base = sqlite3.connect(file, isolation_level=None)
            self._base.execute("PRAGMA synchronous = NORMAL")
            self._create()
            self._agree(fingerprint)
        except (OSError, sqlite3.Error) as error:
            raise InputError(
                f"The table of the study cannot be used ({error}).", "Choose another output folder with -o.", file=file
            ) from error

    def _create(self) -> None:
        kinds = [f'"{name}" {"TEXT" if name in TEXT else "REAL"}' for name in self.columns]
        self._base.execute("CREATE TABLE IF NOT EXISTS study (key TEXT PRIMARY KEY, value TEXT)")
        self._base.execute(f'CREATE TABLE IF NOT EXISTS points ({", ".join(kinds)}, PRIMARY KEY ({", ".join(KEY)}))')

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
                "Choose another output folder with -o, or delete this one.", file=self.file,
            )  # fmt: skip

    def keys(self) -> set[tuple[str, str, int, int]]:
        """What is there already."""
        found = self._base.execute(f"SELECT {', '.join(KEY)} FROM points")
        return {(case, setup, int(point), int(turn)) for case, setup, point, turn in found}

    def add(self, row: Mapping[str, Any], parameters: Mapping[str, float]) -> None:
        """Store one row for good."""
        stiffness = dict(zip(self.springs, row.get("stiffness", []), strict=False))
        values = dict(zip(KEY, row["key"], strict=True)) | dict(parameters) | stiffness | dict(row)
        plain = [None if isinstance(x := values.get(name), float) and not np.isfinite(x) else x for name in self.columns]
        marks = ", ".join("?" * len(plain))
        self._base.execute(f"INSERT OR REPLACE INTO points VALUES ({marks})", plain)

    def rows(self) -> pd.DataFrame:
        """Every row, in the order of its key."""
        frame = pd.read_sql_query(f"SELECT * FROM points ORDER BY {', '.join(KEY)}", self._base)
        return frame.astype({"point": int, "round": int})

    def close(self) -> None:
        self._base.close()


def best(rows: pd.DataFrame) -> pd.DataFrame:
    """The best row of every case, setup and point: verified ones first, then by energy; failed ones last."""
    rank = {"verified": 0, "not verified": 1}
    ranked = rows[rows["outcome"] != "no better"].assign(rank=lambda r: r["status"].map(rank).fillna(2))
    ordered = ranked.sort_values(["case", "setup", "point", "rank", "energy", "round"], kind="stable")
    return ordered.drop_duplicates(["case", "setup", "point"]).drop(columns="rank").reset_index(drop=True)


def first_claim(meshes: str) -> float:
    """What the first mesh of a row claims [J]."""
    return float(json.loads(meshes)[0]["claimed"])
