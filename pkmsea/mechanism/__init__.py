"""The mechanism without its drives: a description in; H, H_A, M and g out."""

from pkmsea.mechanism.assemble import build_mechanism, load_mechanism
from pkmsea.mechanism.mechanism import Mechanism

__all__ = ["Mechanism", "build_mechanism", "load_mechanism"]
