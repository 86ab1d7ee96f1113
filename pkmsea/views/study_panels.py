"""What all figures of a study share: its axes, scales and colours."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import cycle
from typing import Any, Literal

import numpy as np
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from pkmsea.study.answers import Axis, Part
from pkmsea.views.figures import COLORS

WIDE = 10.0  # largest energy over the least from which on their axis is logarithmic


def put(axis: Axis, panel: Any, side: Literal["x", "y"]) -> None:
    """Label and scale of a panel's x or y axis; a logarithmic one with plain numbers."""
    panel.set(**{f"{side}label": axis.label})
    if axis.logarithmic:
        logarithmic(panel, side)


def logarithmic(panel: Any, side: Literal["x", "y"]) -> None:
    """A logarithmic scale with plain numbers."""
    panel.set(**{f"{side}scale": "log"})
    ticks = panel.xaxis if side == "x" else panel.yaxis
    ticks.set_major_locator(LogLocator(subs=(1, 2, 5)))
    ticks.set_major_formatter(StrMethodFormatter("{x:g}"))
    ticks.set_minor_formatter(NullFormatter())


def energy_scale(panel: Any, parts: Sequence[Part]) -> None:
    """A logarithmic y axis where energies differ widely."""
    energies = np.concatenate([part.solved["energy"] for part in parts])
    if energies.size and energies.max() > WIDE * energies.min() > 0:
        logarithmic(panel, "y")


def colored(parts: Sequence[Part]) -> list[tuple[str, Part]]:
    """Setups with their colours; the first of several is grey, the others are compared with it."""
    return list(zip(cycle(COLORS if len(parts) > 1 else COLORS[1:]), parts, strict=False))
