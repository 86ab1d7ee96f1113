"""An independent model of the planar n-RRR robot, from Lagrange's equations with plain NumPy; nothing of pkmsea.

Arm i: base b_i, proximal angle phi, distal angle psi, both absolute. With uniform rods of length l and masses m1, m2

    T = (m1/3 + m2) l^2 phi'^2 / 2 + m2 l^2 psi'^2 / 6 + m2 l^2 phi' psi' cos(phi - psi) / 2

so M_i = [[(m1/3 + m2) l^2, m2 l^2 cos(phi - psi)/2], [.., m2 l^2/3]] and
h_i = m2 l^2 sin(phi - psi)/2 (psi'^2, -phi'^2). The tip is r = b_i + l e(phi) + l e(psi), hence r' = J_i (phi', psi')
with J_i = l [e'(phi), e'(psi)], and r'' = J_i (phi'', psi'') - l e(phi) phi'^2 - l e(psi) psi'^2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

LENGTH, UPPER, LOWER = 0.2, 0.1104, 0.0448
RADIUS = 0.4 / np.sqrt(3)
ANGLES = {"A": 90.0, "B": 210.0, "C": 330.0}
SIGNS = {"A": 1, "B": -1, "C": 1}


def e(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle)])


def e_turned(angle: float) -> np.ndarray:
    return np.array([-np.sin(angle), np.cos(angle)])


@dataclass
class Arm:
    """One arm with its tip at r: its angles, Jacobian and inertia."""

    phi: float
    psi: float

    @classmethod
    def reaching(cls, name: str, r: np.ndarray) -> Arm:
        base = RADIUS * e(np.radians(ANGLES[name]))
        away = r - base
        direction = np.arctan2(away[1], away[0])
        half = np.arccos(np.linalg.norm(away) / (2 * LENGTH))
        return cls(direction + SIGNS[name] * half, direction - SIGNS[name] * half)

    @property
    def J(self) -> np.ndarray:
        return LENGTH * np.column_stack([e_turned(self.phi), e_turned(self.psi)])

    @property
    def M(self) -> np.ndarray:
        coupling = LOWER * np.cos(self.phi - self.psi) / 2
        return LENGTH**2 * np.array([[UPPER / 3 + LOWER, coupling], [coupling, LOWER / 3]])

    def h(self, rates: np.ndarray) -> np.ndarray:
        return LOWER * LENGTH**2 * np.sin(self.phi - self.psi) / 2 * np.array([rates[1] ** 2, -(rates[0] ** 2)])

    def drift(self, rates: np.ndarray) -> np.ndarray:
        """(phi'', psi'') for r'' = 0."""
        return np.linalg.solve(self.J, LENGTH * (e(self.phi) * rates[0] ** 2 + e(self.psi) * rates[1] ** 2))


def model(names: str, r: np.ndarray, v_ind: np.ndarray) -> dict[str, np.ndarray]:
    """q (n,), M, g, H, H_A in q_A,ind = (phi_A, phi_B), joints in the order proximal, elbow of each arm."""
    arms = [Arm.reaching(name, r) for name in names]
    inverse = [np.linalg.inv(arm.J) for arm in arms]
    K = np.array([inverse[0][0], inverse[1][0]])  # v_ind = K r'
    to_r = np.linalg.inv(K)
    dr = to_r @ v_ind
    rates = [J_inv @ dr for J_inv in inverse]
    drifts = [arm.drift(rate) for arm, rate in zip(arms, rates, strict=True)]
    ddr = -to_r @ np.array([drifts[0][0], drifts[1][0]])  # r'' that leaves phi_A'' = phi_B'' = 0
    M_r = sum(J_inv.T @ arm.M @ J_inv for arm, J_inv in zip(arms, inverse, strict=True))
    force = sum(
        J_inv.T @ (arm.M @ (J_inv @ ddr + drift) + arm.h(rate))
        for arm, J_inv, rate, drift in zip(arms, inverse, rates, drifts, strict=True)
    )
    relative = np.array([[1.0, 0.0], [-1.0, 1.0]])  # the elbow's joint angle is psi - phi
    H = np.vstack([relative @ J_inv @ to_r for J_inv in inverse])
    q = np.concatenate([[arm.phi, arm.psi - arm.phi] for arm in arms])
    return {"q": q, "M": to_r.T @ M_r @ to_r, "g": to_r.T @ force, "H": H, "H_A": H[::2]}
