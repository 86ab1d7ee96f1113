"""The mechanism without its drives: URDF and sidecar in; H, H_A, M and g out."""

from pkmsea.mechanism.assemble import load_mechanism
from pkmsea.mechanism.mechanism import Mechanism

__all__ = ["Mechanism", "load_mechanism"]
