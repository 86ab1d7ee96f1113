"""Constraints that are linear in the flat output's coefficients: rest windows and limits of the end effector."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import sparse

from pkmsea.motion import Basis
from pkmsea.problem import Bound, Problem
from pkmsea.task import Window

CURVATURE = 6.0  # of a path within a window, by trial: it leaves a sampled window by this times (spacing / length)^2
PER_GRID_STEP = 2  # window samples per step of the grid
FEWEST = 9


@dataclass(frozen=True)
class LinearRows:
    """lower <= matrix x <= upper; `limits` are the rows of each limit, which stand for its samples on the grid."""

    matrix: sparse.csr_matrix
    lower: np.ndarray
    upper: np.ndarray
    limits: tuple[tuple[Bound, slice], ...]


def window_times(window: Window, step: float) -> np.ndarray:
    """Sample times of a rest window, both edges included; finer than the grid of step `step`."""
    length = window.end - window.start
    if length == 0.0:
        return np.array([window.start])
    return np.linspace(window.start, window.end, max(FEWEST, int(np.ceil(PER_GRID_STEP * length / step)) + 1))


def sampled_deviation(window: Window, samples: int) -> float:
    """The deviation to ask for at equally spaced samples, so that the window's own is kept between them [m]."""
    return window.deviation * (1 - CURVATURE / max(samples - 1, FEWEST - 1) ** 2)


def linear_rows(problem: Problem, basis: Basis, samples: int, size: int) -> LinearRows:
    """Rows for the windows, each a little narrower than asked, and for the end effector's limits at the samples."""
    step = basis.period / samples
    blocks, lower, upper, limits = [], [], [], []

    def add(axis: int, matrix: np.ndarray, low: float, high: float) -> None:
        left = sparse.csr_matrix((matrix.shape[0], axis * basis.size))
        right = sparse.csr_matrix((matrix.shape[0], size - (axis + 1) * basis.size))
        blocks.append(sparse.hstack([left, sparse.csr_matrix(matrix), right]))
        lower.append(np.full(matrix.shape[0], low))
        upper.append(np.full(matrix.shape[0], high))

    for window in problem.cycle.windows:
        times = window_times(window, step)
        deviation = sampled_deviation(window, times.size)
        at = basis.matrix(times)
        add(window.axis, at, window.at - deviation, window.at + deviation)
    grid = np.arange(samples) * step
    for bound in problem.bounds:
        if bound.of_end_effector:
            first = sum(block.shape[0] for block in blocks)
            limits.append((bound, slice(first, first + samples)))
            add(bound.index, basis.matrix(grid, bound.order), bound.lower, bound.upper)
    matrix = sparse.vstack(blocks).tocsr()
    matrix.sort_indices()
    return LinearRows(matrix, np.concatenate(lower), np.concatenate(upper), tuple(limits))
