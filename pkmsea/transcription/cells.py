"""Sparsity by cells: groups of grid points that depend on few coefficients, all cells of the same shape.

A spline's grid is cut into one cell per knot interval, with a halo of grid points on both sides for the difference
stencils; uniform knots make the local basis matrices of all cells equal. A basis without local support is one cell.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pkmsea.motion import Basis


@dataclass(frozen=True)
class Cells:
    """E cells of r own samples, r + 2 h samples with halo, and L coefficients each.

    Attributes
    ----------
    samples : (E, r + 2 h) indices into the periodic grid; the own ones are the middle r.
    coefficients : (E, L) indices into the basis.
    local : (3, r + 2 h, L) basis values and two derivatives, the same for every cell.
    halo : h.
    """

    samples: np.ndarray
    coefficients: np.ndarray
    local: np.ndarray
    halo: int

    @property
    def own(self) -> np.ndarray:
        """(E, r) indices of the samples that belong to each cell."""
        return self.samples[:, self.halo : self.samples.shape[1] - self.halo]


def make_cells(basis: Basis, samples: int, halo: int, whole: bool = False) -> Cells:
    """Cut a uniform periodic grid of `samples` points into cells; into one if it is to stay `whole`."""
    count = 1 if whole else basis.cells(samples, halo)
    r = samples // count
    grid = (np.arange(count)[:, None] * r + np.arange(-halo, r + halo)) % samples
    t = grid[0] * basis.period / samples
    first = np.stack([basis.matrix(t, derivative) for derivative in range(3)])
    if count == 1:
        return Cells(grid, np.arange(basis.size)[None], first, halo)
    used = np.flatnonzero(np.abs(first).max(axis=(0, 1)) > 0)
    coefficients = (used + np.arange(count)[:, None]) % count
    return Cells(grid, coefficients, first[:, :, used], halo)
