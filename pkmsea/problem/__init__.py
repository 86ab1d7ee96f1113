"""The optimal control problem of one robot: what is chosen, what it costs, what must hold."""

from pkmsea.problem.build import build_problem, task_of
from pkmsea.problem.problem import Bound, Problem

__all__ = ["Bound", "Problem", "build_problem", "task_of"]
