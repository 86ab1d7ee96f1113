"""What the robot has to do: the cycle with its rest windows, limits, and the setups to compare."""

from pkmsea.task.cycle import Cycle, Limits, OperatingPoint, Window
from pkmsea.task.payload import Payload
from pkmsea.task.task import Chain, Fourier, Options, Setup, Spline, Task, TaskLimits, load_task

__all__ = [
    "Chain",
    "Cycle",
    "Fourier",
    "Limits",
    "OperatingPoint",
    "Options",
    "Payload",
    "Setup",
    "Spline",
    "Task",
    "TaskLimits",
    "Window",
    "load_task",
]
