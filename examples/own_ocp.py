"""An optimal control problem of one's own in CasADi's Opti: least copper loss of a five-bar, path and springs together.

Run it from anywhere: python examples/own_ocp.py
"""

import casadi as ca
import numpy as np

import pkmsea

PICK, PLACE, K, ORDER = (-0.07, -0.07), (0.07, 0.07), 48, 5  # [m]; instants per period of 1 s, order of the series
MOTOR = {"inertia": 4.6e-4, "friction": 4.8e-3, "copper_loss": 63.4, "stiffness": {"bounds": (0.01, 1.0)}}


def main() -> None:
    robot = pkmsea.Actuation(pkmsea.load_mechanism("pkm_2rrr"), (pkmsea.Drive(kind="sea", **MOTOR),) * 2)
    flat_map, pose = robot.flat_map(), robot.pose_equation()
    orders = np.arange(ORDER + 1)
    phase, w = 2 * np.pi * np.outer(np.arange(K) / K, orders), 2 * np.pi * orders
    bases = [np.cos(phase + d * np.pi / 2) * w**d for d in range(5)]  # cosines and four derivatives: a rest at t = 0
    low, high = np.array([parameter.bounds for parameter in robot.parameters]).T  # of ln c
    opti, loss = ca.Opti(), 0
    x, q, theta = opti.variable(ORDER + 1, 2), opti.variable(robot.mechanism.model.nq, K), opti.variable(2)
    for k in range(K):
        Y = ca.horzcat(*[(B[k : k + 1] @ x).T for B in bases])
        loss += MOTOR["copper_loss"] * ca.sumsqr(flat_map(q=q[:, k], Y=Y, c=ca.exp(theta))["tau"]) / K
        opti.subject_to(pose(q[:, k], Y[:, 0]) == 0)
        if k in (0, K // 2):
            opti.subject_to(Y[:, 0] == (PLACE if k else PICK))
    opti.subject_to(opti.bounded(low, theta, high))
    opti.minimize(loss)
    straight = np.array([np.add(PICK, PLACE) / 2, np.subtract(PICK, PLACE) / 2, *np.zeros((ORDER - 1, 2))])
    opti.set_initial(x, straight)
    opti.set_initial(q, np.array([robot.mechanism.configuration(y) for y in bases[0] @ straight]).T)
    opti.solver("ipopt", {"print_time": False}, {"print_level": 0, "sb": "yes"})
    found = opti.solve()
    print(f"copper loss {found.value(loss):.4f} J per cycle, springs {np.exp(found.value(theta)).round(4)} N m/rad")


main()
