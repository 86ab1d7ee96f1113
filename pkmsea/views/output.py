"""What `solve` and `reproduce` leave in the output folder, beside the result files."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pkmsea.solution import Solution
from pkmsea.views import setup_file
from pkmsea.views.figures import overview, save_figure
from pkmsea.views.playback import write_page


def save_all(solutions: Sequence[Solution], folder: Path, failed: Sequence[str] = ()) -> list[Path]:
    """Write one figure of all setups, those that failed by name, and a playback page per setup; returns the paths."""
    paths = [save_figure(overview(solutions, failed), folder / "overview.png")]
    return paths + [write_page(solution, folder / f"{setup_file(solution)}.html") for solution in solutions]
