"""What several tests share."""

from __future__ import annotations

import os
import signal
from typing import Any

import pytest

from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.task import Task

os.environ.setdefault("OMP_NUM_THREADS", "1")  # beside the processes of pytest-xdist
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:  # as in the background of a shell, which processes would inherit
    signal.signal(signal.SIGINT, signal.default_int_handler)

SHIPPED = ("linear_axis_1", "linear_axis_2", "pkm_2rrr", "pkm_3rrr")
RIGID = {"kind": "rigid", "inertia": 4.4e-6, "copper_loss": 63.2}
ELASTIC = {**RIGID, "kind": "sea", "stiffness": {"bounds": [0.01, 1.0]}}
SLIDER_RIGID = {"kind": "rigid", "inertia": 5, "friction": 2, "copper_loss": 1.4892e-3}
SLIDER_ELASTIC = {**SLIDER_RIGID, "kind": "sea", "stiffness": {"bounds": [5, 1000]}}
FRICTION = {"coulomb": 0.02, "coulomb_width": 0.5, "friction": 1e-3}
PARALLEL = {"parallel": {"stiffness": {"bounds": [0.01, 1.0]}, "rest": {"bounds": [-2.0, 2.0]}}}
DIAGONAL = [{"at": [-0.07, -0.07], "rest": 0.1, "window": 1e-3}, {"at": [0.07, 0.07], "rest": 0.1, "window": 1e-3}]
STROKE = [{"at": [0.7], "rest": 0.275, "window": 1e-3}, {"at": [1.1], "rest": 0.275, "window": 1e-3}]


@pytest.fixture(scope="session")
def mechanisms() -> dict[str, Mechanism]:
    return {name: load_mechanism(name) for name in SHIPPED}


def task(mechanism: str, drives: Any, **changes: Any) -> Task:
    """A task of one setup: the paper's cycle for the mechanism, with keys of the task replaced."""
    linear = mechanism.startswith("linear")
    cycle = {"period": 2.0, "points": STROKE} if linear else {"period": 1.0, "points": DIAGONAL}
    data = {
        "name": "test",
        "cycle": cycle,
        "setups": [{"name": "setup", "mechanism": mechanism, "drives": drives}],
        "options": {"starts": 1},
    }
    return Task.model_validate(data | changes)
