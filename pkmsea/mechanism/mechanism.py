"""A mechanism: a closed tree whose end effector can be placed."""

from __future__ import annotations

import pickle
import zlib
from collections.abc import Sequence
from dataclasses import fields
from functools import cached_property
from typing import Any
from weakref import WeakValueDictionary

import numpy as np

from pkmsea.errors import one_line
from pkmsea.mechanism import pose
from pkmsea.mechanism.closed_tree import ClosedTree
from pkmsea.mechanism.conditioning import Conditioning


class Mechanism(ClosedTree):
    """A tree with its loops closed, and the poses that its end effector asks for; see `ClosedTree`.

    Copies of one mechanism that come into a process are one object there, so that what is built for it is built once.
    """

    def __reduce__(self) -> tuple[Any, ...]:
        return shared, (self._pickled,)

    @cached_property
    def _pickled(self) -> bytes:
        content = zlib.compress(pickle.dumps([getattr(self, field.name) for field in fields(self)]), 1)
        _known.setdefault(content, self)
        return content

    def __repr__(self) -> str:
        counts = f"{len(self.joints)} joints, mobility {self.mobility}, {len(self.actuated)} drives"
        return one_line(f"<Mechanism '{self.name}': {counts}, {self.actuation_class}>")

    def configuration(self, point: Sequence[float] | np.ndarray) -> np.ndarray:
        """All joints q (n,) with the end effector at a task-space point [m], on the declared assembly mode.

        The point is approached from the seed along a straight line, or by detours where that leads out of the
        workspace, in steps that shrink where the pose turns quickly; the sign of det [G; J_E] may not change, so the
        branch never switches silently.

        Raises
        ------
        Unreachable : names the farthest point that was reached.
        """
        return pose.follow(self, np.atleast_1d(np.asarray(point, float)))

    def singularity(self, q: np.ndarray) -> tuple[float, float]:
        """Distance to singularities of both types, in [0, 1]; zero at one.

        Inverse-kinematic (type 1, at the workspace's border): the least that the end effector moves in a motion of all
        joints. Direct-kinematic (type 2, the drives lose the end effector): the least that the drives move. (Gosselin
        and Angeles, 1990; for the measure see `pkmsea.mechanism.conditioning.Conditioning`)
        """
        inverse, direct = pose.singularity(self, q[None])
        return float(inverse[0]), float(direct[0])

    @cached_property
    def conditioning(self) -> float:
        """The least that the independent coordinates move at the seed, 0 (useless) to 1."""
        return Conditioning(self.model, self.description, self.length).of_joints(self.seed, self.independent)


_known: WeakValueDictionary[bytes, Mechanism] = WeakValueDictionary()  # by pickled content


def shared(content: bytes) -> Mechanism:
    """The mechanism of this pickled content: the one that this process has already, or a new one."""
    mechanism = _known.get(content)
    if mechanism is None:
        mechanism = Mechanism(*pickle.loads(zlib.decompress(content)))
        mechanism.__dict__["_pickled"] = content
        _known[content] = mechanism
    return mechanism
