"""What a mechanism is, as a value: files of any convention in, one frozen `Description` out."""

from pkmsea.description.description import CompleteDescription, Description, Origin
from pkmsea.description.limits import JointLimits
from pkmsea.description.locate import find, shipped
from pkmsea.description.parts import Closure, Coupling, EndEffector, Frame, Placement, Plane
from pkmsea.description.reader import read

__all__ = [
    "Closure",
    "CompleteDescription",
    "Coupling",
    "Description",
    "EndEffector",
    "Frame",
    "JointLimits",
    "Origin",
    "Placement",
    "Plane",
    "find",
    "read",
    "shipped",
]
