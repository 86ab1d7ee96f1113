"""Showing solutions: tables, figures and the Meshcat playback. Nothing upstream imports this."""

from pkmsea.files import file_name
from pkmsea.solution import Solution


def setup_file(solution: Solution) -> str:
    """File name, without suffix, of a setup: no other setup of its task has it."""
    return file_name(solution.name, [setup.name for setup in solution.problem.task.setups])
