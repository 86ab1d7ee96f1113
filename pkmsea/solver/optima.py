"""What a multi-start found: its distinct optima, and how often each."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass

from pkmsea.errors import one_line
from pkmsea.solver.multistart import Start, clusters


@dataclass(frozen=True, repr=False)
class Optimum:
    """One of the distinct optima of a multi-start.

    Attributes
    ----------
    claimed : value of the cost on the first mesh, as the transcription sees it.
    stiffness : of the elastic drives.
    count : starts that found it.
    finished : whether it was solved to the full sharpness; the others were only screened.
    """

    claimed: float
    stiffness: tuple[float, ...]
    count: int
    finished: bool

    def __repr__(self) -> str:
        springs = ", ".join(f"{c:.4g}" for c in self.stiffness)
        return one_line(f"<Optimum: claimed {self.claimed:.4g}, stiffness [{springs}], {self.count} starts>")


def optima(starts: Iterable[Start]) -> tuple[Optimum, ...]:
    """The distinct optima of a multi-start, best first; starts that are in none have no usable end.

    Those that were only screened are compared as they were then, not with the energies of the sharpened ones.
    """
    starts = list(starts)
    repeated = Counter(start.repeats for start in starts)
    found = []
    for finished in (True, False):
        leaders = [start for start in starts if start.repeats is None and start.finished is finished]
        for group in clusters(leaders):
            count = len(group) + sum(repeated.pop(start.index, 0) for start in group)
            found.append(Optimum(group[0].claimed, group[0].stiffness, count, finished))
    return tuple(sorted(found, key=lambda optimum: optimum.claimed))
