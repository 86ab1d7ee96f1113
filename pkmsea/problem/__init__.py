"""The optimal control problem of one setup: what is chosen, what it costs, what must hold."""

from pkmsea.problem.problem import Bound, Problem, build_problem

__all__ = ["Bound", "Problem", "build_problem"]
