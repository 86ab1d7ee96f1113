"""Forward dynamics of the whole robot in Pinocchio's doubles: the open tree, its loops as constraints, the drives.

Nothing here is shared with the optimiser: no symbolic Function, no minimal coordinates, no flat map.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from pkmsea.bridge import frame_id
from pkmsea.mechanism import Mechanism
from pkmsea.verification.drives import Drives
from pkmsea.verification.loops import WORLD, Loops

AXES = ("x", "y", "z")
RANK = 1e-11  # relative; redundant rows of the closures, such as those across a planar loop, lie far below


@dataclass(frozen=True, eq=False)
class Robot:
    """A tree of n joints with its m drives, and loops closed by forces lambda:

        (M + S_A^T M_M S_A) a + h(q, v) + J^T m_L (J a + dJ/dt v - g) = S_A^T f + G^T lambda,    G a + dG/dt v = 0

    where f are the spring forces of elastic drives, and tau less friction of rigid ones, whose rotors M_M belong to the
    joints; m_L(t) is the payload at the end effector. The state is x = (q, v, q_M, v_M), the last two of the elastic
    drives only. All rows of all closures are kept, redundant ones too: the least-norm solution gives the unique
    acceleration.
    """

    drives: Drives

    @property
    def mechanism(self) -> Mechanism:
        return self.drives.actuation.mechanism

    @cached_property
    def model(self) -> pin.Model:
        return self.mechanism.model

    @cached_property
    def data(self) -> pin.Data:
        return self.model.createData()

    @property
    def n(self) -> int:
        return int(self.model.nq)

    @cached_property
    def at(self) -> list[int]:
        """Index into q of each drive's joint (m)."""
        return self.mechanism.actuated

    @cached_property
    def on_joints(self) -> np.ndarray:
        """S_A^T, (n, m)."""
        return np.eye(self.n)[:, self.at]

    @cached_property
    def rotors_on_joints(self) -> np.ndarray:
        """S_A^T M_M S_A of the rigid drives, (n, n)."""
        return np.diag(self.on_joints @ self.drives.inertia_on_joints)

    @cached_property
    def upper(self) -> np.ndarray:
        """Weights that make a symmetric matrix, together with its transpose, of an upper triangle (n, n)."""
        return np.triu(np.ones((self.n, self.n))) - np.eye(self.n) / 2

    @cached_property
    def loops(self) -> Loops:
        return Loops(self.mechanism)

    @cached_property
    def constrained(self) -> bool:
        sidecar = self.mechanism.description
        return bool(sidecar.closures or sidecar.couplings)

    @cached_property
    def end_effector_frame(self) -> int:
        return frame_id(self.model, self.mechanism.description.end_effector.frame)

    @cached_property
    def axes(self) -> list[int]:
        """World axes along which the end effector is followed; none where joints are followed in place of it."""
        return [AXES.index(axis) for axis in self.mechanism.description.end_effector.axes]

    @cached_property
    def followed(self) -> list[int]:
        """Index into q of the joints that are followed in place of the end effector."""
        return [self.mechanism.joints.index(name) for name in self.mechanism.description.end_effector.joints]

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """q, v, q_M, v_M of states (..., 2n + 2e), the last two of the e elastic drives."""
        n, e = self.n, int(self.drives.elastic.sum())
        return x[..., :n], x[..., n : 2 * n], x[..., 2 * n : 2 * n + e], x[..., 2 * n + e :]

    def motors(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q_M, v_M of all drives (..., m); joint coordinates where a drive is rigid."""
        q, v, q_M, v_M = self.split(x)
        position, speed = q[..., self.at], v[..., self.at]
        position[..., self.drives.elastic], speed[..., self.drives.elastic] = q_M, v_M
        return position, speed

    def rate(self, t: float, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """dx/dt under motor torques tau (m,)."""
        drives = self.drives
        q, v, _, _ = self.split(x)
        q_M, v_M = self.motors(x)
        q_A, left, own = q[self.at], tau - drives.friction(v_M), drives.elastic
        u = drives.forces(q_M - q_A, v_M - v[self.at], left)
        a_M = (left - u)[own] / drives.inertia[own]
        return np.concatenate([v, self.acceleration(t, q, v, u + drives.parallel_spring(q_A)), v_M[own], a_M])

    def acceleration(self, t: float, q: np.ndarray, v: np.ndarray, f: np.ndarray) -> np.ndarray:
        """a (n,) from the KKT system of the constrained tree, under forces f (m,) of the drives on the joints."""
        n, model, data = self.n, self.model, self.data
        force = self.on_joints @ f - pin.nonLinearEffects(model, data, q, v)
        M = pin.crba(model, data, q) * self.upper  # Pinocchio sets the upper triangle only
        M = M + M.T + self.rotors_on_joints
        loops = self.loops.at(data, q, v)
        mass = self.payload(t)
        if mass > 0:
            J, drift = self._end_effector()
            M += mass * J.T @ J
            force -= mass * J.T @ (drift - model.gravity.linear)
        if not self.constrained:
            return np.asarray(np.linalg.solve(M, force))
        scale, rows = M.trace() / n, loops.Phi.size
        K, right = np.zeros((n + rows, n + rows)), np.concatenate([force / scale, -loops.bias])
        K[:n, :n], K[n:, :n], K[:n, n:] = M / scale, loops.G, loops.G.T
        return np.asarray(np.linalg.lstsq(K, right, rcond=RANK)[0][:n])

    def payload(self, t: float) -> float:
        """m_L(t) [kg]."""
        carried = self.drives.actuation.payload
        return 0.0 if carried is None else float(carried(np.array([t]), 0)[0])

    def payload_power(self, t: float, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> float:
        """Power that the end effector gives to the payload [W]."""
        mass = self.payload(t)
        if mass == 0:
            return 0.0
        self.loops.at(self.data, q, v)
        J, drift = self._end_effector()
        return float(mass * (J @ v) @ (J @ a + drift - self.model.gravity.linear))

    def _end_effector(self) -> tuple[np.ndarray, np.ndarray]:
        """J (3, n) and dJ/dt v (3,) of the end effector's origin, after `loops.at` has set Pinocchio's data."""
        frame = self.end_effector_frame
        J = pin.getFrameJacobian(self.model, self.data, frame, WORLD)[:3]
        return J, pin.getFrameClassicalAcceleration(self.model, self.data, frame, WORLD).linear

    def end_effector(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """r_E, dr_E/dt, d^2r_E/dt^2, (3, delta)."""
        if self.followed:
            return np.array([q, v, a])[:, self.followed]
        frame = self.end_effector_frame
        pin.forwardKinematics(self.model, self.data, q, v, a)
        pin.updateFramePlacements(self.model, self.data)
        velocity = pin.getFrameVelocity(self.model, self.data, frame, WORLD).linear
        acceleration = pin.getFrameClassicalAcceleration(self.model, self.data, frame, WORLD).linear
        return np.array([self.data.oMf[frame].translation, velocity, acceleration])[:, self.axes]

    def energy(self, x: np.ndarray) -> float:
        """Kinetic and potential energy of tree, rotors and springs, without the payload [J]."""
        q, v, _, _ = self.split(x)
        q_M, v_M = self.motors(x)
        kinetic = pin.computeKineticEnergy(self.model, self.data, q, v) + self.drives.inertia @ v_M**2 / 2
        potential = pin.computePotentialEnergy(self.model, self.data, q)
        return float(kinetic + potential + self.drives.spring_energy(q_M - q[self.at], q[self.at]))
