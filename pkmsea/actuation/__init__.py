"""The drives around a mechanism: rigid or series elastic, in any mixture; flat outputs and the flat map."""

from pkmsea.actuation.actuation import Actuation, Parameter
from pkmsea.actuation.drive import Bounds, Drive, ParallelSpring, Range
from pkmsea.actuation.flat_map import flat_map
from pkmsea.actuation.laws import NUMBERS

__all__ = ["NUMBERS", "Actuation", "Bounds", "Drive", "ParallelSpring", "Parameter", "Range", "flat_map"]
