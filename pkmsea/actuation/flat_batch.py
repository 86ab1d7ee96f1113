"""The flat map at many instants at once: the same map as `flat_map`, without symbolic inverses.

With the jet (q, v, a, j, s) of the joints and x = (u_d, lambda) of the forces, every derivative in time of Psi(q) =
[0; y] and of the load equation is linear in its highest one, with the same matrices A and L in front:

    A q^(k) = [0; y^(k)] - (d^k Psi / dt^k without q^(k)),  k = 1 ... 4
    L x^(k) = - (d^k / dt^k of the load equation without x^(k)),  k = 0, 1, 2

So both matrices are factored once, and all right-hand sides are expressions that grow with the joints, not with the
fourth power of their number.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from pkmsea.actuation import laws
from pkmsea.actuation.kinds import DriveAt
from pkmsea.actuation.structure import Structure, dependent_columns, joint_load, on_joints, stack
from pkmsea.kernels import Pipeline, named_function, program
from pkmsea.mechanism import pose

UNIFORM = ("c", "k", "rest", "r")
GIVEN = ("q", "Y", "Z", "c", "k", "rest", "L", "r")
JOINT_JET, FORCE_JET = ("v", "a", "j", "s"), ("x", "dx", "ddx")


@dataclass(frozen=True, eq=False)
class JetFunctions:
    """Functions of one instant; inputs are those of `flat_map`, then v, a, j, s, and x, dx, ddx.

    `matrices` (q) -> A, L; `motion` and `forces` give right-hand sides, derivative after derivative, as many as are
    needed; `outputs` gives q_M, v_M, tau, u.
    """

    matrices: ca.Function
    motion: tuple[ca.Function, ...]
    forces: tuple[ca.Function, ...]
    outputs: ca.Function


@lru_cache(maxsize=16)
def jet_functions(structure: Structure) -> JetFunctions:
    """Build them for a robot."""
    mechanism = structure.mechanism
    n, delta, m = mechanism.model.nq, mechanism.mobility, structure.m
    sizes = {"q": n, "Y": 5 * delta, "Z": 3 * (m - delta), "L": 3, "r": len(laws.NUMBERS) * m}
    sizes |= dict.fromkeys(("c", "k", "rest"), m) | dict.fromkeys((*JOINT_JET, *FORCE_JET), n)
    e = {name: ca.SX.sym(name, size) for name, size in sizes.items()}
    q, v, a = e["q"], e["v"], e["a"]
    Y, Z = ca.reshape(e["Y"], delta, 5), ca.reshape(e["Z"], m - delta, 3)
    moving = ca.vertcat(q, v, a, e["j"], e["Z"][: 2 * (m - delta)], e["L"][:2], e["x"], e["dx"])
    rates = ca.vertcat(v, a, e["j"], e["s"], e["Z"][m - delta :], e["L"][1:], e["dx"], e["ddx"])

    def rate(expression: ca.SX) -> ca.SX:
        return ca.cse(ca.densify(ca.jtimes(ca.cse(expression), moving, rates)))

    def without(expression: ca.SX, unknown: ca.SX) -> ca.SX:
        return -ca.substitute(expression, unknown, ca.SX.zeros(unknown.numel()))

    Psi = ca.cse(pose.task_system(mechanism)(q)[0])
    motion, derivative = [], Psi
    for order, name in enumerate(JOINT_JET, start=1):
        derivative = rate(derivative)
        closed = derivative - ca.vertcat(ca.SX.zeros(n - delta), Y[:, order])
        motion.append(named_function("motion", e, {"b": without(closed, e[name])}))

    at, numbers = mechanism.actuated, structure.numbers(e["r"])
    drives = [DriveAt(q[at[i]], v[at[i]], a[at[i]], e["c"][i], numbers[i]) for i in range(m)]
    free = {i: Z[j, 0] for j, i in enumerate(structure.free)}
    u, parallel = ca.SX(m, 1), ca.SX(m, 1)
    u_dependent, lam = ca.vertsplit(e["x"], [0, delta, n])
    u[list(structure.free)] = stack([structure.kinds[i].force(drives[i], z) for i, z in free.items()])
    u[structure.dependent] = u_dependent
    for i in structure.parallel:
        parallel[i] = laws.parallel_spring(e["k"][i], e["rest"][i], q[at[i]])
    closure_forces = ca.jtimes(Psi, q, ca.vertcat(lam, ca.SX.zeros(delta)), True)
    balance = on_joints(u + parallel, at, n) + closure_forces - joint_load(structure, q, v, a, e["L"][0])
    forces = []
    for name in FORCE_JET:
        forces.append(named_function("forces", e, {"b": without(balance, e[name])}))
        balance = rate(balance)

    q_M = stack([kind.position(drives[i], u[i], free.get(i)) for i, kind in enumerate(structure.kinds)])
    v_M = rate(q_M)
    a_M = rate(v_M)
    tau = stack([laws.rotor(numbers[i], v_M[i], a_M[i]) + u[i] for i in range(m)])
    if not ca.depends_on(ca.vertcat(v_M, tau), ca.vertcat(e["j"], e["s"], e["dx"], e["ddx"])):  # no elastic drive
        motion, forces = motion[:2], forces[:1]
    A = ca.cse(ca.densify(ca.jacobian(Psi, q)))
    L = ca.horzcat(ca.SX(dependent_columns(structure)), A[: n - delta, :].T)
    return JetFunctions(
        named_function("matrices", {"q": q}, {"A": A, "L": L}),
        tuple(motion),
        tuple(forces),
        named_function("outputs", e, {"q_M": q_M, "v_M": v_M, "tau": tau, "u": u}),
    )


class FlatBatch:
    """`flat_map` at k instants: arrays in and out as `flat_map_of_columns` has them, one row per instant."""

    def __init__(self, structure: Structure, k: int, threads: int = 1) -> None:
        functions = jet_functions(structure)
        names = functions.outputs.name_in()
        self._threads = threads
        self._arrays = {
            name: np.zeros(size) if name in UNIFORM else np.zeros((size, k))
            for name in names
            for size in [functions.outputs.size1_in(name)]
        }
        n = functions.matrices.size1_in(0)
        A, L = np.zeros((n * n, k)), np.zeros((n * n, k))
        self._results = [np.zeros((functions.outputs.size1_out(i), k)) for i in range(functions.outputs.n_out())]
        self._pipeline, given = Pipeline(k), list(self._arrays.values())
        self._pipeline.call(program(functions.matrices), [self._arrays["q"]], [A, L])
        factors_A, factors_L = self._pipeline.factor(A), self._pipeline.factor(L)
        solved = (JOINT_JET, FORCE_JET)
        for group, unknowns, factors in zip(
            (functions.motion, functions.forces), solved, (factors_A, factors_L), strict=True
        ):
            for right, name in zip(group, unknowns, strict=False):
                self._pipeline.call(program(right, UNIFORM), given, [self._arrays[name]])
                self._pipeline.solve(factors, self._arrays[name])
        self._pipeline.call(program(functions.outputs, UNIFORM), given, self._results)

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """q_M, v_M, tau, u, v, a, overwritten by the next call."""
        for name, given in zip(GIVEN, arguments, strict=True):
            self._arrays[name].T[...] = given
        self._pipeline.run(self._threads)
        return [x.T for x in (*self._results, self._arrays["v"], self._arrays["a"])]
