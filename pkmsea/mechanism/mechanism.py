"""A mechanism: a closed tree whose end effector can be placed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pkmsea.mechanism import pose
from pkmsea.mechanism.closed_tree import ClosedTree


class Mechanism(ClosedTree):
    """A tree with its loops closed, and the poses that its end effector asks for; see `ClosedTree`."""

    def __repr__(self) -> str:
        drives = " ".join(self.description.actuated)
        return f"Mechanism({self.name!r}, {self.actuation_class}, mobility {self.mobility}, drives {drives})"

    def configuration(self, point: Sequence[float] | np.ndarray) -> np.ndarray:
        """All joints q (n,) with the end effector at a task-space point [m], on the declared assembly mode.

        The point is approached from the seed along a straight line, in steps that shrink where the pose turns
        quickly; the sign of det [G; J_E] may not change, so the branch never switches silently.

        Raises
        ------
        Unreachable : names the farthest point that was reached.
        """
        return pose.follow(self, np.atleast_1d(np.asarray(point, float)))

    def singularity(self, q: np.ndarray) -> tuple[float, float]:
        """Distance to singularities of both types, in [0, 1]; zero at one.

        Inverse-kinematic (type 1, at the workspace's border): reciprocal condition number of [G; J_E].
        Direct-kinematic (type 2, the drives lose the end effector): that of [G; S_A], where S_A picks the drives'
        joints. (Gosselin and Angeles, 1990)
        """
        inverse, direct = pose.singularity(self, q[None])
        return float(inverse[0]), float(direct[0])
