"""Solving NLPs: IPOPT with typed outcomes, seeded multi-starts, and the conditions of a minimum."""

from pkmsea.solver.ipopt import Outcome
from pkmsea.solver.multistart import Start, multistart
from pkmsea.solver.optima import Optimum, optima
from pkmsea.solver.optimality import Optimality, optimality

__all__ = ["Optimality", "Optimum", "Outcome", "Start", "multistart", "optima", "optimality"]
