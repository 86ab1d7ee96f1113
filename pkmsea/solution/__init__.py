"""Solutions: solved, audited on a dense grid, and stored in an open format."""

from pkmsea.motion.series import Series
from pkmsea.solution.audit import Audit
from pkmsea.solution.solution import Mesh, Solution
from pkmsea.solution.solve import solve, solve_all

__all__ = ["Audit", "Mesh", "Series", "Solution", "solve", "solve_all"]
