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

from pkmsea.actuation.actuation import NUMBERS, Shape, dependent_columns, on_joints, stack
from pkmsea.actuation.elements import coulomb, payload_load, spring_deflection, spring_force
from pkmsea.bridge import _bridge
from pkmsea.kernels import Pipeline, named_function, program
from pkmsea.mechanism import pose

UNIFORM = ("c", "k", "rest", "r")


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
def jet_functions(shape: Shape) -> JetFunctions:
    """Build them for a robot."""
    mechanism = shape.mechanism
    n, delta, m = mechanism.model.nq, mechanism.mobility, shape.m
    sizes = {"q": n, "Y": 5 * delta, "Z": 3 * (m - delta), "c": m, "k": m, "rest": m, "L": 3, "r": len(NUMBERS) * m}
    sizes |= dict.fromkeys(("v", "a", "j", "s", "x", "dx", "ddx"), n)
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
    for order, name in enumerate(("v", "a", "j", "s"), start=1):
        derivative = rate(derivative)
        closed = derivative - ca.vertcat(ca.SX.zeros(n - delta), Y[:, order])
        motion.append(named_function("motion", e, {"b": without(closed, e[name])}))

    drives = _Drives(shape, e, Z[:, 0])
    u = ca.SX(m, 1)
    u_dependent, lam = ca.vertsplit(e["x"], [0, delta, n])
    u[list(shape.free)], u[shape.dependent] = stack(drives.free_forces), u_dependent
    load = mechanism.tree.inverse_dynamics(q, v, a) + payload_load(shape, q, v, a, e["L"][0])
    closure_forces = ca.jtimes(Psi, q, ca.vertcat(lam, ca.SX.zeros(delta)), True)
    balance = on_joints(u + drives.parallel, mechanism.actuated, n) + closure_forces - load
    forces = []
    for name in ("x", "dx", "ddx"):
        forces.append(named_function("forces", e, {"b": without(balance, e[name])}))
        balance = rate(balance)

    q_M = drives.motor_positions(u)
    v_M = rate(q_M)
    inertia, friction, torque, width, _ = ca.vertsplit(e["r"], m)
    tau = u + inertia * rate(v_M) + friction * v_M + coulomb(torque, width, v_M)
    if not ca.depends_on(ca.vertcat(v_M, tau), ca.vertcat(e["j"], e["s"], e["dx"], e["ddx"])):  # no elastic drive
        motion, forces = motion[:2], forces[:1]
    A = ca.cse(ca.densify(ca.jacobian(Psi, q)))
    L = ca.horzcat(ca.SX(dependent_columns(shape)), A[: n - delta, :].T)
    return JetFunctions(
        named_function("matrices", {"q": q}, {"A": A, "L": L}),
        tuple(motion),
        tuple(forces),
        named_function("outputs", e, {"q_M": q_M, "v_M": v_M, "tau": tau, "u": u}),
    )


class _Drives:
    """The drives at an instant, as expressions."""

    def __init__(self, shape: Shape, e: dict[str, ca.SX], z: ca.SX) -> None:
        self._shape, self._e, self._z = shape, e, z
        self._cubic = ca.vertsplit(e["r"], shape.m)[-1]

    @property
    def parallel(self) -> ca.SX:
        """Forces of the parallel springs, (m,)."""
        q_A = stack([self._e["q"][joint] for joint in self._shape.mechanism.actuated])
        present = ca.DM([float(i in self._shape.parallel) for i in range(self._shape.m)])
        return present * self._e["k"] * (self._e["rest"] - q_A)

    @property
    def free_forces(self) -> list[ca.SX]:
        """u of the free drives from their coordinates."""
        shape, e, r = self._shape, self._e, ca.vertsplit(self._e["r"], self._shape.m)
        forces = []
        for j, i in enumerate(shape.free):
            joint, z = shape.mechanism.actuated[i], self._z[j]
            if i in shape.damped:
                forces.append(z)
            elif i in shape.elastic:
                forces.append(spring_force(shape, i, e["c"][i], self._cubic[i], z - e["q"][joint]))
            else:
                lost = r[0][i] * e["a"][joint] + r[1][i] * e["v"][joint] + coulomb(r[2][i], r[3][i], e["v"][joint])
                forces.append(z - lost)
        return forces

    def motor_positions(self, u: ca.SX) -> ca.SX:
        """q_M (m,), the joint's position of a rigid drive."""
        shape, q_M = self._shape, stack([self._e["q"][joint] for joint in self._shape.mechanism.actuated])
        for i in shape.elastic:
            known = i in shape.free and i not in shape.damped
            deflection = spring_deflection(shape, i, self._e["c"][i], self._cubic[i], u[i])
            q_M[i] = self._z[shape.free.index(i)] if known else q_M[i] + deflection
        return q_M


class FlatBatch:
    """`flat_map` at k instants: arrays in and out as `flat_map_of_columns` has them, one row per instant."""

    def __init__(self, shape: Shape, k: int, threads: int = 1) -> None:
        functions = jet_functions(shape)
        names = functions.outputs.name_in()
        self._threads, self._names = threads, names[:8]
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
        solved = [("v", "a", "j", "s"), ("x", "dx", "ddx")]
        for group, unknowns, factors in zip(
            (functions.motion, functions.forces), solved, (factors_A, factors_L), strict=True
        ):
            for right, name in zip(group, unknowns, strict=False):
                self._pipeline.call(_program(right), given, [self._arrays[name]])
                self._pipeline.solve(factors, self._arrays[name])
        self._pipeline.call(_program(functions.outputs), given, self._results)

    def __call__(self, *arguments: np.ndarray) -> list[np.ndarray]:
        """q_M, v_M, tau, u, v, a, overwritten by the next call."""
        for name, given in zip(self._names, arguments, strict=True):
            self._arrays[name].T[...] = given
        self._pipeline.run(self._threads)
        return [x.T for x in (*self._results, self._arrays["v"], self._arrays["a"])]


@lru_cache(maxsize=128)
def _program(function: ca.Function) -> _bridge.Program:
    return program(function, UNIFORM)
