"""Solving NLPs: IPOPT with typed outcomes, and seeded multi-starts."""

from pkmsea.solver.ipopt import Outcome
from pkmsea.solver.multistart import Start, multistart

__all__ = ["Outcome", "Start", "multistart"]
