"""Motions: periodic bases, the poses along a path, and every quantity on a dense grid by the exact flat map."""

from pkmsea.motion.bases import BASES, Basis, make_basis
from pkmsea.motion.motion import Motion
from pkmsea.motion.series import Series, series

__all__ = ["BASES", "Basis", "Motion", "Series", "make_basis", "series"]
