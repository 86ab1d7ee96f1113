"""The optimal control problem of one robot: what is chosen, what it costs, what must hold."""

from pkmsea.actuation.cost import COSTS, Cost
from pkmsea.problem.bounds import Bound
from pkmsea.problem.build import build_problem, task_of
from pkmsea.problem.problem import Problem

__all__ = ["COSTS", "Bound", "Cost", "Problem", "build_problem", "task_of"]
