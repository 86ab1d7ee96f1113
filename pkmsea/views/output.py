"""What `solve` and `reproduce` leave in the output folder, beside the result files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pkmsea.files import file_name
from pkmsea.solution import Solution
from pkmsea.views.figures import overview, save_figure
from pkmsea.views.playback import write_page


def save_all(
    solutions: Sequence[Solution], folder: Path, setups: Sequence[str], failed: Sequence[str] = ()
) -> list[Path]:
    """Write one figure of all setups, those that failed by name, and a playback page per setup; returns the paths.

    `setups` are the names of all setups of the task: no two of them share a file.
    """
    paths = [save_figure(overview(solutions, failed), folder / "overview.png")]
    return paths + [write_page(s, folder / f"{file_name(s.name, setups)}.html") for s in solutions]
