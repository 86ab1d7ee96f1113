"""What follows from the outputs of one instant and their time derivatives: torques, speeds, power, and the cost's rate.

z holds per drive (u, dq_M/dt, d2q_M/dt2) where it is elastic and (tau, v_A) where it is rigid, then limited motions of
joints. The rotor of an elastic drive: tau = M_M d2q_M/dt2 + d_v dq_M/dt + F(dq_M/dt) + u, v_M = dq_M/dt.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca

from pkmsea.actuation.actuation import Shape
from pkmsea.actuation.elements import coulomb
from pkmsea.kernels import named_function

NUMBERS = ("inertia", "friction", "coulomb", "coulomb_width", "copper_loss")  # of all drives, one after the other


@dataclass(frozen=True)
class SignalFunctions:
    """Functions of one instant. Inputs: z; numbers (5m,), NUMBERS of all drives; eps [W], the width over which the
    positive part is smoothed; factor of the cost's rate, and mu (h,), weights of the signals.

    Signals h: tau_i and v_i of each drive, then the limited motions of joints as they are.

    Attributes
    ----------
    rows : per entry of z, its row in the outputs s_D and how often it is differentiated in time.
    value : (z, numbers, eps) -> rate, h, P; rate = (P + sqrt(P^2 + eps^2)) / 2 of the bus power P [W].
    slope : (z, numbers, eps, factor, mu) -> gradient of factor rate + mu^T h in z.
    jacobian : (z, numbers) -> dh/dz.
    curvature : (z, numbers, eps, factor, mu) -> Hessian of factor rate + mu^T h in z.
    """

    rows: tuple[tuple[int, int], ...]
    value: ca.Function
    slope: ca.Function
    jacobian: ca.Function
    curvature: ca.Function


@lru_cache(maxsize=32)
def signal_functions(shape: Shape, joints: int) -> SignalFunctions:
    """For a robot with so many limited motions of joints."""
    rows: list[tuple[int, int]] = []
    for i in range(shape.m):
        rows += [(2 * i + 1, 0), (2 * i, 1), (2 * i, 2)] if i in shape.elastic else [(2 * i, 0), (2 * i + 1, 0)]
    rows += [(2 * shape.m + j, 0) for j in range(joints)]
    z, numbers = ca.SX.sym("z", len(rows)), ca.SX.sym("numbers", len(NUMBERS) * shape.m)
    eps, factor, mu = ca.SX.sym("eps"), ca.SX.sym("factor"), ca.SX.sym("mu", 2 * shape.m + joints)
    inertia, friction, torque, width, kappa = ca.vertsplit(numbers, shape.m)
    signals, at = [], 0
    for i in range(shape.m):
        if i in shape.elastic:
            u, rate, second = ca.vertsplit(z[at : at + 3])
            signals += [inertia[i] * second + friction[i] * rate + coulomb(torque[i], width[i], rate) + u, rate]
            at += 3
        else:
            signals += [z[at], z[at + 1]]
            at += 2
    h = ca.vertcat(*signals, z[at:])
    tau, v = h[0 : 2 * shape.m : 2], h[1 : 2 * shape.m : 2]
    P = ca.dot(tau, v) + ca.dot(kappa, tau**2)
    rate = (P + ca.sqrt(P**2 + eps**2)) / 2
    weighted = factor * rate + ca.dot(mu, h)
    Hessian, gradient = ca.hessian(weighted, z)
    given, weights = {"z": z, "numbers": numbers}, {"eps": eps, "factor": factor, "mu": mu}
    return SignalFunctions(
        tuple(rows),
        named_function("value", given | {"eps": eps}, {"rate": rate, "h": h, "P": P}),
        named_function("slope", given | weights, {"on_z": gradient}),
        named_function("jacobian", given, {"J": ca.jacobian(h, z)}),
        named_function("curvature", given | weights, {"Q": Hessian}),
    )
