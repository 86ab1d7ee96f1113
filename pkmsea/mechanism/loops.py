"""Closed loops: their independent rows, the mobility, and which joints determine the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import qr

from pkmsea.mechanism.conditioning import Conditioning

RANK = 1e-9  # a row adds nothing below this share of the largest; closures hold to 1e-12
PREFERENCE = 0.1  # the drives' joints are preferred as coordinates down to this share of the best conditioning


@dataclass(frozen=True, eq=False)
class Loops:
    """Closed loops: `rows` of Phi that are independent, fixed once; mobility delta = n - len(rows).

    Attributes
    ----------
    seed : a closed pose (n,); `proposed` says that it was searched for.
    poses : the seed and other generic closed poses (k, n).
    G : Jacobian of these rows there, without units (k, n - delta, n).
    measure : of the loops.
    """

    seed: np.ndarray
    proposed: bool
    rows: list[int]
    poses: np.ndarray
    G: np.ndarray
    measure: Conditioning

    @property
    def n(self) -> int:
        return self.seed.size

    @property
    def mobility(self) -> int:
        return self.n - len(self.rows)

    def conditioning(self, joints: Sequence[int]) -> float:
        """How well `joints` determine the motion, 0 to 1: median over the poses, see `Conditioning`."""
        return float(np.median([self.measure.of_joints(q, joints) for q in self.poses]))

    def choose(self, among: Sequence[int]) -> list[int]:
        """delta joints out of `among` that determine the motion best; fewer where they cannot."""
        best: list[int] = []
        for G in self.G[:: max(1, len(self.G) // 4)]:
            basis = null_space(G, self.mobility)[list(among)]
            rows, _ = independent_rows(basis)
            chosen = [among[i] for i in rows]
            if len(chosen) == self.mobility and (not best or self.conditioning(chosen) > self.conditioning(best)):
                best = chosen
        return best

    def independent(self, preferred: Sequence[int]) -> list[int]:
        """Minimal coordinates: out of the `preferred` joints unless others are much better conditioned."""
        best, own = self.choose(range(self.n)), self.choose(list(dict.fromkeys(preferred)))
        good = own and self.conditioning(own) >= PREFERENCE * self.conditioning(best)
        return own if good else best


def independent_rows(G: np.ndarray) -> tuple[list[int], float]:
    """Rows that span the row space (QR with pivoting), in their order, and the share of the smallest one kept."""
    if 0 in G.shape:
        return [], 1.0
    _, R, pivots = qr(G.T, pivoting=True, mode="economic")
    diagonal = np.abs(np.diag(R))
    rank = int(np.sum(diagonal > RANK * max(diagonal[0], 1.0)))
    margin = float(diagonal[rank - 1] / max(diagonal[0], 1e-300)) if rank else 1.0
    return sorted(int(i) for i in pivots[:rank]), margin


def null_space(G: np.ndarray, dimension: int) -> np.ndarray:
    """Orthonormal basis of the motions that keep the loops closed, (n, dimension)."""
    _, _, Vt = np.linalg.svd(G.reshape(-1, G.shape[-1]), full_matrices=True)
    return np.asarray(Vt[Vt.shape[0] - dimension :].T)
