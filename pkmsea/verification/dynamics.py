"""Forward dynamics of the whole robot in Pinocchio's doubles: the open tree, its loops as constraints, the drives.

Nothing here is shared with the optimiser: no symbolic Function, no minimal coordinates, no flat map.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import pinocchio as pin

from pkmsea.actuation import Actuation
from pkmsea.errors import InputError

AXES = ("x", "y", "z")
RANK = 1e-11  # relative; redundant rows of the closures, such as those across a planar loop, lie far below
WORLD = pin.LOCAL_WORLD_ALIGNED


@dataclass(frozen=True, eq=False)
class Loops:
    """The closures at one state: residual Phi [m, rad], Jacobian G (rows, n) and bias dG/dt v (rows,)."""

    Phi: np.ndarray
    G: np.ndarray
    bias: np.ndarray


@dataclass(frozen=True, eq=False)
class Robot:
    """A tree of n joints, m drives with motor torques tau, and loops closed by forces lambda.

    The state is x = (q, v, q_M, v_M), the last two of the elastic drives only:

        (M + S_A^T M_M S_A) a + h(q, v) + S_A^T d_v v_A = S_A^T u + G^T lambda,    G a + dG/dt v = 0,
        M_M a_M + d_v v_M + u = tau,    u = c (q_M - q_A)              where a drive is elastic,
        u = tau                                                       where it is rigid;

    rotor inertia M_M and friction d_v of rigid drives act on their joints, those of elastic ones on their motors. All
    rows of all closures are kept, redundant ones too: the least-norm solution gives the unique acceleration.
    `stiffness` (m,) is NaN for rigid drives.
    """

    actuation: Actuation
    stiffness: np.ndarray

    def __post_init__(self) -> None:
        for i in self.actuation.elastic:
            if self.actuation.drives[i].inertia == 0:
                raise InputError(
                    "A motor without inertia cannot be simulated.", "Give the drive a rotor inertia.",
                    key=f"drive {self.actuation.labels[i]}: inertia", value=0,
                )  # fmt: skip

    @cached_property
    def model(self) -> pin.Model:
        return self.actuation.mechanism.model

    @cached_property
    def data(self) -> pin.Data:
        return self.model.createData()

    @property
    def n(self) -> int:
        return int(self.model.nq)

    @cached_property
    def elastic(self) -> list[int]:
        return self.actuation.elastic

    @cached_property
    def on_joints(self) -> np.ndarray:
        """S_A^T, (n, m)."""
        return np.eye(self.n)[:, self.actuation.mechanism.actuated]

    @cached_property
    def on_rigid_joints(self) -> tuple[np.ndarray, np.ndarray]:
        """Rotor inertia (n, n) and friction (n,) that rigid drives add to the joints."""
        rigid = np.array([not drive.elastic for drive in self.actuation.drives])
        inertia, friction = (self.on_joints @ (rigid * self.actuation.numbers(k)) for k in ("inertia", "friction"))
        return np.diag(inertia), friction

    @cached_property
    def rotors(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Inertia, friction and stiffness of the elastic drives."""
        numbers = self.actuation.numbers("inertia"), self.actuation.numbers("friction"), self.stiffness
        return numbers[0][self.elastic], numbers[1][self.elastic], numbers[2][self.elastic]

    @cached_property
    def frames(self) -> list[tuple[int, int, bool]]:
        """Per closure its two frames, and whether their orientations coincide as well."""
        closures = self.actuation.mechanism.sidecar.closures
        return [(*(self.model.getFrameId(name) for name in c.frames), c.type == "frame") for c in closures]

    @cached_property
    def end_effector_rows(self) -> tuple[int, list[int]]:
        """Frame of the end effector, and the world axes along which it is followed."""
        declared = self.actuation.mechanism.sidecar.end_effector
        return self.model.getFrameId(declared.frame), [AXES.index(axis) for axis in declared.axes]

    def split(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """q, v, q_M, v_M of states (..., 2n + 2e)."""
        n, e = self.n, len(self.elastic)
        return x[..., :n], x[..., n : 2 * n], x[..., 2 * n : 2 * n + e], x[..., 2 * n + e :]

    def motors(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """q_M, v_M of all drives (..., m); joint coordinates where a drive is rigid."""
        q, v, q_M, v_M = self.split(x)
        at = self.actuation.mechanism.actuated
        position, speed = q[..., at].copy(), v[..., at].copy()
        position[..., self.elastic], speed[..., self.elastic] = q_M, v_M
        return position, speed

    def rate(self, x: np.ndarray, tau: np.ndarray) -> np.ndarray:
        """dx/dt."""
        q, v, q_M, v_M = self.split(x)
        inertia, friction, c = self.rotors
        spring = c * (q_M - q[self.actuation.mechanism.actuated][self.elastic])
        u = tau.copy()
        u[self.elastic] = spring
        a_M = (tau[self.elastic] - friction * v_M - spring) / inertia
        return np.concatenate([v, self.acceleration(q, v, u), v_M, a_M])

    def acceleration(self, q: np.ndarray, v: np.ndarray, u: np.ndarray) -> np.ndarray:
        """a (n,) from the KKT system of the constrained tree."""
        rotor, friction = self.on_rigid_joints
        h = pin.nonLinearEffects(self.model, self.data, q, v)
        M = np.triu(pin.crba(self.model, self.data, q))
        M = M + np.triu(M, 1).T + rotor
        force = self.on_joints @ u - friction * v - h
        if not self.frames:
            return np.asarray(np.linalg.solve(M, force))
        loops, scale = self.loops(q, v), np.trace(M) / self.n
        rows = loops.G.shape[0]
        K = np.block([[M / scale, loops.G.T], [loops.G, np.zeros((rows, rows))]])
        right = np.concatenate([force / scale, -loops.bias])
        return np.asarray(np.linalg.lstsq(K, right, rcond=RANK)[0][: self.n])

    def loops(self, q: np.ndarray, v: np.ndarray) -> Loops:
        """Frame origins p_2 - p_1 and, where orientations coincide, the rotation between them."""
        model, data = self.model, self.data
        pin.computeJointJacobians(model, data, q)
        pin.forwardKinematics(model, data, q, v, np.zeros(self.n))
        pin.updateFramePlacements(model, data)
        Phi, G, bias = [np.zeros(0)], [np.zeros((0, self.n))], [np.zeros(0)]
        for first, second, oriented in self.frames:
            rows = slice(0, 6 if oriented else 3)
            G.append((pin.getFrameJacobian(model, data, second, WORLD)
                      - pin.getFrameJacobian(model, data, first, WORLD))[rows])  # fmt: skip
            drift = [pin.getFrameClassicalAcceleration(model, data, f, WORLD).vector for f in (first, second)]
            bias.append((drift[1] - drift[0])[rows])
            Phi.append(data.oMf[second].translation - data.oMf[first].translation)
            if oriented:
                Phi.append(pin.log3(data.oMf[first].rotation.T @ data.oMf[second].rotation))
        return Loops(np.concatenate(Phi), np.vstack(G), np.concatenate(bias))

    def end_effector(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """r_E, dr_E/dt, d^2r_E/dt^2, (3, axes)."""
        frame, axes = self.end_effector_rows
        pin.forwardKinematics(self.model, self.data, q, v, a)
        pin.updateFramePlacements(self.model, self.data)
        velocity = pin.getFrameVelocity(self.model, self.data, frame, WORLD).linear
        acceleration = pin.getFrameClassicalAcceleration(self.model, self.data, frame, WORLD).linear
        return np.array([self.data.oMf[frame].translation, velocity, acceleration])[:, axes]

    def energy(self, x: np.ndarray) -> float:
        """Kinetic and potential energy of tree, rotors and springs [J]."""
        q, v, q_M, v_M = self.split(x)
        inertia, _, c = self.rotors
        wound = q_M - q[self.actuation.mechanism.actuated][self.elastic]
        tree = pin.computeKineticEnergy(self.model, self.data, q, v) + pin.computePotentialEnergy(
            self.model, self.data, q
        )
        moving = v @ self.on_rigid_joints[0] @ v + inertia @ v_M**2
        return float(tree + (moving + c @ wound**2) / 2)

    def singularity(self, q: np.ndarray) -> tuple[float, float]:
        """Reciprocal condition numbers of [G; J_E] and [G; S_A]: distances to singularities of type 1 and 2.

        Rows of lengths are divided by the largest entry of [G; J_E], to compare with joints.
        """
        frame, axes = self.end_effector_rows
        G = self.loops(q, np.zeros(self.n)).G
        J_E = pin.getFrameJacobian(self.model, self.data, frame, WORLD)[axes]
        A = np.vstack([G, J_E])
        scale = np.abs(A).max()
        inverse, direct = (
            np.linalg.svd(matrix, compute_uv=False) for matrix in (A / scale, np.vstack([G / scale, self.on_joints.T]))
        )
        return float(inverse[self.n - 1] / inverse[0]), float(direct[self.n - 1] / direct[0])
