"""The plant: a solved robot with other springs and an unforeseen payload, in pkmsea's independent forward dynamics."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from laws import Law

import pkmsea
from pkmsea.task.payload import Payload
from pkmsea.verification.drives import Drives
from pkmsea.verification.dynamics import Robot


def changed(solution: pkmsea.Solution, stiffness: float, payload: float) -> pkmsea.Solution:
    """The planned path of the end effector on a robot with `stiffness` times the springs and, at its end effector,
    `payload` times the mass of its moving links."""
    problem, motion = solution.problem, solution.motion
    mass = payload * sum(inertia.mass for inertia in list(problem.actuation.mechanism.model.inertias)[1:])
    carried = Payload(mass=mass) if mass else None
    softer = replace(motion, stiffness=motion.stiffness * stiffness)
    return replace(solution, problem=replace(problem, payload=carried), motion=softer)


@dataclass(frozen=True, eq=False)
class Run:
    """A simulated run: r_E and its plan (steps, delta) at the control steps, torques (steps, m) and mean power (steps,)
    in them."""

    t: np.ndarray
    step: float
    r_E: np.ndarray
    planned: np.ndarray
    tau: np.ndarray
    power: np.ndarray

    @property
    def error(self) -> np.ndarray:
        """Distance of the end effector from the planned one (steps,) [m]."""
        return np.asarray(np.linalg.norm(self.r_E - self.planned, axis=1))

    def measures(self, solution: pkmsea.Solution) -> dict[str, float]:
        """Errors over all cycles, and the energy of the last one."""
        cycle, per_cycle = solution.problem.cycle, round(solution.problem.cycle.period / self.step)
        since = [(self.t - w.start + self.step / 2) % cycle.period for w in cycle.windows]
        outside = [
            np.abs(self.r_E[s < w.end - w.start + self.step, w.axis] - w.at).max() - w.deviation
            for w, s in zip(cycle.windows, since, strict=True)
        ]
        return {
            "rms error [mm]": 1e3 * float(np.sqrt((self.error**2).mean())),
            "largest error [mm]": 1e3 * float(self.error.max()),
            "outside rest windows [mm]": 1e3 * max(float(max(outside)), 0.0),
            "peak torque [N m]": float(np.abs(self.tau).max()),
            "energy [J]": float(np.maximum(self.power[-per_cycle:], 0).sum() * self.step),
        }


def simulate(plant: pkmsea.Solution, law: Law, start: pkmsea.Solution, step: float, cycles: int) -> Run:
    """`cycles` periods of a robot with elastic drives, from the planned state of `start`; every `step` [s] a new
    torque, limited as the drives are.

    Between two steps the torque is held and the plant integrated by one step of the classical Runge-Kutta method.
    """
    actuation, period = plant.problem.actuation, plant.problem.cycle.period
    robot = Robot(Drives(actuation, plant.motion.stiffness, plant.motion.parallel))
    limit = np.array([drive.torque or np.inf for drive in actuation.drives])
    per_cycle = round(period / step)
    first = start.series
    t = np.arange(cycles * per_cycle) * step
    states, torques = np.empty((t.size + 1, 2 * (robot.n + actuation.m))), np.empty((t.size, actuation.m))
    states[0] = np.concatenate([first.q[0], first.v[0], first.q_M[0], first.v_M[0]])
    for i, now in enumerate(t):
        torques[i] = np.clip(law(i % per_cycle, robot.split(states[i])), -limit, limit)
        states[i + 1] = runge_kutta(robot, now, states[i], torques[i], step)
    q, _, q_M, _ = robot.split(states)
    rest = np.zeros(robot.n)
    r_E = np.array([robot.end_effector(each, rest, rest)[0] for each in q[:-1]])
    power = (torques * np.diff(q_M, axis=0) / step + plant.problem.kappa * torques**2).sum(axis=1)
    return Run(t, step, r_E, start.motion.flat_output(t), torques, power)


def runge_kutta(robot: Robot, t: float, x: np.ndarray, tau: np.ndarray, h: float) -> np.ndarray:
    """One classical step of order 4 under constant torques."""
    k_1 = robot.rate(t, x, tau)
    k_2 = robot.rate(t + h / 2, x + h / 2 * k_1, tau)
    k_3 = robot.rate(t + h / 2, x + h / 2 * k_2, tau)
    k_4 = robot.rate(t + h, x + h * k_3, tau)
    return np.asarray(x + h / 6 * (k_1 + 2 * k_2 + 2 * k_3 + k_4))
