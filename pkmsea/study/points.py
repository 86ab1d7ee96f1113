"""The points of a study, and an order in which neighbours can start each other."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise, product

import numpy as np
from scipy.stats import qmc

from pkmsea.study.study import Grid, Sample, Study

ALIKE = 9  # decimals of a distance: grid points at the same distance are neighbours of the same rank
DIGITS = 12  # of a value: the ends of a logarithmic interval are themselves
FIRST = 8  # points of the first level; every further one doubles what is there


@dataclass(frozen=True, eq=False)
class Points:
    """Values of the varied parameters.

    Attributes
    ----------
    names : of the parameters.
    unit : (points, parameters), each between 0 and 1 over its range, where distances are taken.
    values : (points, parameters).
    """

    names: tuple[str, ...]
    unit: np.ndarray
    values: np.ndarray

    def at(self, point: int) -> dict[str, float]:
        return {name: float(value) for name, value in zip(self.names, self.values[point], strict=True)}

    def nearest(self, point: int, among: Sequence[int], count: int) -> list[int]:
        """The nearest other points among some, nearest first; of equal ones those with lower numbers."""
        others = np.array([i for i in among if i != point], int)
        distance = np.linalg.norm(self.unit[others] - self.unit[point], axis=1).round(ALIKE)
        return [int(i) for i in others[np.lexsort((others, distance))[:count]]]


def points_of(study: Study) -> Points:
    """All points of a grid or a sample, in its own order."""
    varied = list(study.vary.values())
    if isinstance(study.sample, Grid):
        axes = [np.linspace(0, 1, v.size) if v.size > 1 else np.array([0.5]) for v in varied]
        unit = np.array(list(product(*axes)))
    else:
        assert isinstance(study.sample, Sample)
        kind = qmc.Sobol if study.sample.kind == "sobol" else qmc.LatinHypercube
        unit = kind(len(varied), rng=np.random.default_rng(study.sample.seed)).random(study.sample.count)
    return Points(tuple(study.vary), unit, values_at(study, unit))


def values_at(study: Study, unit: np.ndarray) -> np.ndarray:
    """Values of the parameters at places of the unit cube, (points, parameters)."""
    columns = []
    for varied, x in zip(study.vary.values(), unit.T, strict=True):
        if varied.values is not None:
            index = np.minimum((x * len(varied.values)).astype(int), len(varied.values) - 1)
            columns.append(np.array(varied.values)[index])
            continue
        low, high = np.log(varied.ends) if varied.logarithmic else varied.ends
        value = low + x * (high - low)
        columns.append(np.exp(value) if varied.logarithmic else value)
    return np.vectorize(lambda x: float(f"{x:.{DIGITS}g}"))(np.stack(columns, axis=1))


def levels(points: Points) -> list[list[int]]:
    """The points from coarse to fine: each next one is the farthest from all before, beginning in the middle.

    Points of the levels before its own start a point, so who starts whom depends on the study and its results alone.
    """
    count = points.unit.shape[0]
    order = [int(np.linalg.norm(points.unit - 0.5, axis=1).round(ALIKE).argmin())]
    distance = np.full(count, np.inf)
    while len(order) < count:
        distance = np.minimum(distance, np.linalg.norm(points.unit - points.unit[order[-1]], axis=1).round(ALIKE))
        distance[order[-1]] = -1.0
        order.append(int(distance.argmax()))
    borders, end = [0], FIRST
    while borders[-1] < count:
        borders.append(min(end, count))
        end *= 2
    return [order[a:b] for a, b in pairwise(borders)]
