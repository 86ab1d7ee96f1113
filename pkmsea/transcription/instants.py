"""The stage equations at all instants of a grid: unknowns, outputs, their slope and curvature in w = (w_t, p)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from pkmsea.actuation.equations import GROUP_MATRICES, StageFunctions, stage_functions
from pkmsea.actuation.structure import Structure
from pkmsea.bridge import _bridge
from pkmsea.kernels import Factors, Pipeline, program

UNIFORM = ("p", "r")  # inputs that are the same at all instants


class Instants:
    """Arrays (rows, instants) on which three pipelines work (`pkmsea.actuation.equations.StageFunctions`).

    Attributes
    ----------
    xi : unknowns (4n + k, instants); q, its first n rows, is given.
    w, p : the part of w that changes from instant to instant (rows, instants), and the parameters.
    s : outputs s_D. S : their slope (s W, instants), columns one after the other. C : their curvature (W W, instants).
    mu : weights of s_D in the curvature.
    """

    def __init__(self, structure: Structure, limited: tuple[int, ...], r: np.ndarray, load: np.ndarray) -> None:
        """r (5m,) are the drives' numbers, load (instants,) is the payload's mass [kg]."""
        functions, count = stage_functions(structure, limited), load.size
        self._programs = _programs(functions)
        self._count, self._groups, n = count, functions.groups, structure.mechanism.model.nq
        self.xi = np.zeros((functions.groups[-1].stop, count))
        self.w = np.zeros((functions.outputs.size1_in("w"), count))
        self.p = np.zeros(functions.outputs.size1_in("p"))
        self._given = [self.xi, self.w, self.p, r, load[None]]
        W, rows = self.w.shape[0] + self.p.size, functions.outputs.size1_out(0)
        self.s, self.S = np.zeros((rows, count)), np.zeros((rows * W, count))
        self.mu, self.C = np.zeros((rows, count)), np.zeros((W * W, count))
        self._D = [np.zeros((f.numel_out(0), count)) for f in functions.slope_right]
        self._nu = np.zeros_like(self.xi)
        self._unknowns, self.factors = self._make_unknowns(n)
        self._slope, self._curvature = self._make_slope(), self._make_curvature()

    def solve(self) -> None:
        """Unknowns and outputs from q, w and p."""
        self._unknowns.run()

    def differentiate(self) -> None:
        """S, where `solve` has found the unknowns."""
        self._slope.run()

    def bend(self) -> None:
        """C for the weights mu, where S is known."""
        self._curvature.run()

    def _make_unknowns(self, n: int) -> tuple[Pipeline, dict[str, Factors]]:
        pipeline, (A, L) = Pipeline(self._count), (np.zeros((n * n, self._count)) for _ in range(2))
        pipeline.call(self._programs["matrices"][0], [self.xi[:n]], [A, L])
        factors = {"A": pipeline.factor(A), "L": pipeline.factor(L)}
        for right, at, matrix in zip(self._programs["right"], self._groups[1:], GROUP_MATRICES[1:], strict=True):
            pipeline.call(right, self._given, [self.xi[at]])
            if matrix in factors:
                pipeline.solve(factors[matrix], self.xi[at])
        pipeline.call(self._programs["outputs"][0], self._given, [self.s])
        return pipeline, factors

    def _make_slope(self) -> Pipeline:
        pipeline = Pipeline(self._count)
        for g, (right, matrix) in enumerate(zip(self._programs["slope_right"], GROUP_MATRICES, strict=True)):
            pipeline.call(right, [*self._given, *self._D[:g]], [self._D[g]])
            if matrix in self.factors:
                pipeline.solve(self.factors[matrix], self._D[g])
        pipeline.call(self._programs["slope"][0], [*self._given, *self._D], [self.S])
        return pipeline

    def _make_curvature(self) -> Pipeline:
        pipeline, adjoint = Pipeline(self._count), [*self._given, self.mu, self._nu]
        backwards = zip(self._programs["adjoint_right"], self._groups, GROUP_MATRICES, strict=True)
        for right, at, matrix in reversed(list(backwards)):
            pipeline.call(right, adjoint, [self._nu[at]])
            if matrix in self.factors:
                pipeline.solve(self.factors[matrix], self._nu[at], transposed=True)
        pipeline.call(self._programs["curvature"][0], [*adjoint, *self._D], [self.C])
        return pipeline


@lru_cache(maxsize=32)
def _programs(functions: StageFunctions) -> dict[str, tuple[_bridge.Program, ...]]:
    """Programs of all Functions of a stage, under the same names."""
    names = ("matrices", "right", "outputs", "slope_right", "slope", "adjoint_right", "curvature")
    found = {name: getattr(functions, name) for name in names}
    several = {name: value if isinstance(value, tuple) else (value,) for name, value in found.items()}
    return {name: tuple(program(function, UNIFORM) for function in value) for name, value in several.items()}
