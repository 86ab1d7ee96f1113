"""The answers of a study: its points by case and setup, the best of each, and where co-optimised optima lie."""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import pandas as pd

from pkmsea.study.run import StudyResult
from pkmsea.study.study import Study
from pkmsea.study.table import FAILED, UNVERIFIED, VERIFIED, rank, records

SAME = 0.02  # relative distance of stiffnesses below which an optimum of the starts is the chosen one


@dataclass(frozen=True)
class Axis:
    """A varied parameter as an axis; its label may end with the unit, as in 'T_P [s]'."""

    name: str
    label: str
    logarithmic: bool
    ends: tuple[float, float]

    @property
    def unit(self) -> str:
        return self._parts[1]

    def value(self, x: float, digits: int = 3) -> str:
        """A value with symbol and unit: 'T_P = 0.82 s'."""
        symbol, unit = self._parts
        return f"{symbol} = {x:.{digits}g} {unit}".rstrip()

    def even(self, x: Any) -> np.ndarray:
        """The coordinate in which the axis is even."""
        return np.log(x) if self.logarithmic else np.asarray(x, float)

    @property
    def _parts(self) -> tuple[str, str]:
        found = re.fullmatch(r"(.*?)\s*\[([^\]]*)\]", self.label)
        return (found[1], found[2]) if found else (self.label, "")


def axes_of(study: Study) -> list[Axis]:
    """The varied parameters, in the study's order."""
    return [Axis(name, varied.label or name, varied.logarithmic, varied.ends) for name, varied in study.vary.items()]


@dataclass(frozen=True)
class Mark:
    """A local optimum of the co-optimised task: the varied parameters there, cut to their ranges, and energy [J]."""

    at: tuple[float, ...]
    energy: float
    best: bool
    outside: bool


@dataclass(frozen=True, eq=False)
class Part:
    """The points of one case and setup.

    Attributes
    ----------
    rows : the best row of each point, with numbers as numbers; a failed point has no energy.
    optimum : the row of the task as it says itself, if it was solved.
    failure : why it failed, if it did.
    """

    case: str
    setup: str
    rows: pd.DataFrame
    optimum: dict[str, Any] | None
    failure: str = ""

    def having(self, status: str) -> pd.DataFrame:
        return self.rows[self.rows["status"] == status]

    @cached_property
    def solved(self) -> pd.DataFrame:
        return self.rows[self.rows["status"].isin((VERIFIED, UNVERIFIED)) & np.isfinite(self.rows["energy"])]

    @property
    def unverified(self) -> pd.DataFrame:
        return self.having(UNVERIFIED)

    @property
    def failed(self) -> pd.DataFrame:
        return self.having(FAILED)

    @property
    def springs(self) -> list[str]:
        """Columns c_i that hold stiffnesses."""
        columns = [name for name in self.rows.columns if re.fullmatch(r"c_\d+", name)]
        own = self.optimum or {}
        return [name for name in columns if self.rows[name].notna().any() or np.isfinite(own.get(name, np.nan))]

    def best(self) -> dict[str, Any] | None:
        """The point of least energy, verified ones before others."""
        return min(records(self.solved), key=rank, default=None)

    def gain(self) -> float | None:
        """How much less energy the co-optimised task needs than the best point, relative."""
        best = self.best()
        return 1 - self.optimum["energy"] / best["energy"] if self.optimum and best and best["energy"] > 0 else None

    def reason(self, status: str) -> tuple[str, int]:
        """Why most points of a status are not verified: the first such reason, and how many points have it, whatever
        numbers stand in it."""
        told = [reason for text in self.having(status)["reason"] for reason in str(text).split("; ")]
        kinds = [re.sub(r"[-+.\d]+(e[-+]?\d+)?", "#", reason) for reason in told]
        if not told:
            return "", 0
        kind, count = Counter(kinds).most_common(1)[0]
        return told[kinds.index(kind)], count

    def spring_of(self, parameter: str) -> int | None:
        """Index of the only spring whose stiffness a parameter is at every point, else None."""
        same = [i for i, c in enumerate(self.springs) if np.allclose(self.solved[c], self.solved[parameter], rtol=1e-6)]
        return same[0] if len(same) == 1 else None

    def others(self) -> list[dict[str, Any]]:
        """Optima of the starts beside the chosen one, best first: `claimed` [J], `stiffness`."""
        if self.optimum is None:
            return []
        c = np.array([self.optimum[name] for name in self.springs])
        found = json.loads(self.optimum["optima"])
        distance = [np.abs(np.log(np.array(other["stiffness"]) / c)).max(initial=0.0) for other in found]
        chosen = int(np.argmin(distance)) if found and min(distance) < SAME else None
        return [other for i, other in enumerate(found) if i != chosen]

    def marks(self, axes: Sequence[Axis]) -> list[Mark]:
        """The co-optimised task's optima, best first, if all axes are stiffnesses; the best with its true energy, the
        others with what their starts claim."""
        where = [self.spring_of(axis.name) for axis in axes] if len(self.solved) else [None]
        chosen = [i for i in where if i is not None]
        if self.optimum is None or len(chosen) < len(axes):
            return []
        low, high = np.array([axis.ends for axis in axes]).T
        found = [(self.optimum["energy"], [self.optimum[name] for name in self.springs])]
        found += [(other["claimed"], other["stiffness"]) for other in self.others()]
        marks = []
        for i, (energy, c) in enumerate(found):
            at = np.array(c)[chosen]
            inside = np.clip(at, low, high)
            marks.append(Mark(tuple(inside.tolist()), energy, i == 0, not np.allclose(at, inside)))
        return marks


def parts_of(result: StudyResult) -> list[Part]:
    """Every case and setup, in the study's order."""
    table, optima = _numeric(result.table, result.study), _numeric(result.optima, result.study)
    parts = []
    for case in result.study.cases:
        for setup in result.study.names:
            rows, own = (frame[(frame["case"] == case) & (frame["setup"] == setup)] for frame in (table, optima))
            optimum = next(iter(records(own)), None)
            failure = str(optimum["reason"]) if optimum and optimum["status"] == FAILED else ""
            parts.append(Part(case, setup, rows.reset_index(drop=True), None if failure else optimum, failure))
    return parts


def _numeric(frame: pd.DataFrame, study: Study) -> pd.DataFrame:
    """Columns of numbers in which nothing stands at all come from SQLite without a type."""
    names = [name for name in frame.columns if name in ("energy", "claimed", *study.vary) or name.startswith("c_")]
    return frame.assign(**{name: pd.to_numeric(frame[name]) for name in names})


def title_of(part: Part, study: Study) -> str:
    """Case and setup, as far as there are several."""
    told = [part.case] if len(study.cases) > 1 else []
    return ", ".join(told + ([part.setup] if len(study.names) > 1 or not told else []))
