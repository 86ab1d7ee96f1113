"""Solutions: solved, audited on a dense grid, and stored in an open format."""

from pkmsea.solution.audit import Audit, Series
from pkmsea.solution.solution import Mesh, Solution
from pkmsea.solution.solve import solve, solve_all

__all__ = ["Audit", "Mesh", "Series", "Solution", "solve", "solve_all"]
