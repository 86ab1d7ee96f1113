"""What follows from the outputs of one instant and their time derivatives: torques, speeds, power, and the cost's rate.

z holds per drive what its kind says, such as (u, dq_M/dt, d2q_M/dt2) of an elastic one, then limited motions of joints.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from itertools import accumulate, pairwise

import casadi as ca

from pkmsea.actuation.cost import Cost
from pkmsea.actuation.laws import NUMBERS, damper, friction, payload, rotor
from pkmsea.actuation.structure import Structure
from pkmsea.kernels import named_function


@dataclass(frozen=True)
class SignalFunctions:
    """Functions of one instant. Inputs: z; r, NUMBERS of all drives; eps, by which the cost's rate is smoothed; factor
    of that rate, and mu (h,), weights of the signals.

    Signals h: tau (m), v (m), then the limited motions of joints as they are.

    Attributes
    ----------
    value : (z, r, eps) -> rate, h.
    slope : (z, r, eps, factor, mu) -> gradient of factor rate + mu^T h in z.
    jacobian : (z, r) -> dh/dz.
    curvature : (z, r, eps, factor, mu) -> Hessian of factor rate + mu^T h in z.
    """

    value: ca.Function
    slope: ca.Function
    jacobian: ca.Function
    curvature: ca.Function


def rows(structure: Structure, joints: int) -> list[tuple[int, int]]:
    """Per entry of z, its row in the outputs s_D and how often it is differentiated in time."""
    drives = [
        (output * structure.m + i, order) for i, kind in enumerate(structure.kinds) for output, order in kind.rows
    ]
    return drives + [(2 * structure.m + j, 0) for j in range(joints)]


@lru_cache(maxsize=32)
def signal_functions(structure: Structure, cost: Cost, joints: int) -> SignalFunctions:
    """For a robot, what its motion costs, and so many limited motions of joints."""
    m, first = structure.m, [0, *accumulate(len(kind.rows) for kind in structure.kinds)]
    z, r = ca.SX.sym("z", len(rows(structure, joints))), ca.SX.sym("r", len(NUMBERS) * m)
    eps, factor, mu = ca.SX.sym("eps"), ca.SX.sym("factor"), ca.SX.sym("mu", 2 * m + joints)
    numbers = structure.numbers(r)
    own = [ca.vertsplit(z[slice(*at)]) for at in pairwise(first)]
    signals = [kind.signals(numbers[i], own[i]) for i, kind in enumerate(structure.kinds)]
    tau, v = zip(*signals, strict=True)
    h = ca.vertcat(*tau, *v, z[first[-1] :])
    rate = cost.rate(tau, v, numbers, eps)
    weighted = factor * rate + ca.dot(mu, h)
    Hessian, gradient = ca.hessian(weighted, z)
    given, weights = {"z": z, "r": r}, {"eps": eps, "factor": factor, "mu": mu}
    return SignalFunctions(
        named_function("value", given | {"eps": eps}, {"rate": rate, "h": h}),
        named_function("slope", given | weights, {"on_z": gradient}),
        named_function("jacobian", given, {"J": ca.jacobian(h, z)}),
        named_function("curvature", given | weights, {"Q": Hessian}),
    )


@lru_cache(maxsize=16)
def motor_torque(structure: Structure) -> ca.Function:
    """(v_M, a_M, u, r) -> tau (m,): of rotors that move like this behind the forces u."""
    v_M, a_M, u, r = _symbols(v_M=structure.m, a_M=structure.m, u=structure.m, r=len(NUMBERS) * structure.m)
    tau = [rotor(numbers, v_M[i], a_M[i]) + u[i] for i, numbers in enumerate(structure.numbers(r))]
    return named_function("motor_torque", {"v_M": v_M, "a_M": a_M, "u": u, "r": r}, {"tau": ca.vertcat(*tau)})


@lru_cache(maxsize=16)
def losses(structure: Structure) -> ca.Function:
    """(q, v, a, v_M, mass, r) -> P: power that friction, dampers and the payload [kg] take from the motors [W]."""
    n, m = structure.mechanism.model.nq, structure.m
    q, v, a, v_M, mass, r = _symbols(q=n, v=n, a=n, v_M=m, mass=1, r=len(NUMBERS) * m)
    P = ca.dot(v, payload(structure.mechanism, q, v, a, mass)) if structure.payload else ca.SX(0)
    for i, numbers in enumerate(structure.numbers(r)):
        slip = v_M[i] - v[structure.mechanism.actuated[i]]
        P += friction(numbers, v_M[i]) * v_M[i] + damper(numbers, slip) * slip
    return named_function("losses", {"q": q, "v": v, "a": a, "v_M": v_M, "mass": mass, "r": r}, {"P": P})


def _symbols(**sizes: int) -> list[ca.SX]:
    return [ca.SX.sym(name, size) for name, size in sizes.items()]
