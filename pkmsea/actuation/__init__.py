"""The drives around a mechanism: rigid or series elastic, in any mixture; flat outputs and the flat map."""

from pkmsea.actuation.actuation import Actuation
from pkmsea.actuation.drive import Bounds, Drive
from pkmsea.actuation.flat_map import flat_map

__all__ = ["Actuation", "Bounds", "Drive", "flat_map"]
