"""Proof of a result: an independent forward simulation of the whole robot, driven by the result's own torque."""

from pkmsea.verification.verification import Verification, verify

__all__ = ["Verification", "verify"]
