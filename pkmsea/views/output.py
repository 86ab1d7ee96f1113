"""What `solve` and `reproduce` leave in the output folder: of a setup as soon as it is solved, the overview at last."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pkmsea.files import file_name
from pkmsea.solution import Solution
from pkmsea.views.figures import overview, save_figure
from pkmsea.views.playback import write_page


def save_result(solution: Solution, folder: Path, setups: Sequence[str]) -> list[Path]:
    """Write the result file of a setup and, unless it was interrupted, its playback page.

    `setups` are the names of all setups of the task: no two of them share a file.
    """
    name = file_name(solution.name, setups)
    saved = solution.save(folder / f"{name}.nc")
    return [saved] if solution.interrupted else [saved, write_page(solution, folder / f"{name}.html")]


def save_overview(solutions: Sequence[Solution], folder: Path, failed: Sequence[str] = ()) -> Path:
    """Write one figure of all setups, those that failed by name."""
    return save_figure(overview(solutions, failed), folder / "overview.png")
