"""Tasks that are their own mirror images have symmetric stationary points; none of them is taken for an optimum."""

from __future__ import annotations

from pathlib import Path

import five_bar
import numpy as np
import pytest
import spatial
from conftest import task

from pkmsea.problem import build_problem
from pkmsea.solution import solve
from pkmsea.solver.multistart import run_start
from pkmsea.solver.optimality import descent, last_parameter
from pkmsea.solver.saddles import leave_saddles
from pkmsea.task import Task
from pkmsea.transcription import transcribe
from pkmsea.verification import verify

DRIVES = {"inertia": 0.02, "friction": 0.05, "copper_loss": 0.5}
KINDS = {
    "rigid": {"kind": "rigid"},
    "series": {"kind": "sea", "stiffness": {"bounds": [5, 5000]}},
    "parallel": {"kind": "rigid", "parallel": {"stiffness": {"bounds": [0.1, 200]}, "rest": {"bounds": [-3, 3]}}},
}
SLIDERS = {"linear_axis_1": {"inertia": 5, "friction": 2, "copper_loss": 1.5e-3}}
WIDE, RESTS = 0.002, 0.05  # half width of a rest window [m], rest [s]


def there_and_back(*stops: tuple[float, ...], rest: float = RESTS) -> list[dict]:
    """Stops, and back through those in between."""
    way = [*stops, *stops[-2:0:-1]]
    return [{"at": list(at), "rest": rest, "window": WIDE} for at in way]


def beside(wide: float, out: float) -> tuple[float, float]:
    """A point at a distance from the five-bar's axis of symmetry, which runs through the origin at -30 deg."""
    along, across = np.array([np.sqrt(3) / 2, -0.5]), np.array([0.5, np.sqrt(3) / 2])
    x, y = wide * across + out * along
    return float(x), float(y)


def arch(wide: float, high: float, low: float) -> list[dict]:
    """Left, up over the middle, right, and back: its own mirror image in the plane x = 0."""
    over = {"at": [0.0, 0.0, low + high], "rest": 0, "window": [0.1, 0.05, 0.005]}
    sides = [{"at": [x, 0.0, low], "rest": 0.04, "window": WIDE} for x in (-wide, wide)]
    return [sides[0], over, sides[1], over]


def tasks() -> list:
    """Robot, drives, points and period; the first of each robot is in the ordinary run."""
    found = []
    for kind in KINDS:
        for points in ([(0.7,), (1.1,)], [(0.5,), (0.9,), (1.3,)]):
            found.append(("linear_axis_1", kind, there_and_back(*points), 2.0))
        for wide, out in ((0.07, 0.0), (0.05, 0.03)):
            found.append(("five_bar", kind, there_and_back(*(beside(x, out) for x in (-wide, wide))), 0.8))
        for wide, high, period in ((0.08, 0.03, 0.6), (0.05, 0.0, 0.5), (0.06, 0.04, 1.0)):
            found.append(("delta", kind, arch(wide, high, -0.28), period))
    quick = ("delta", "parallel", 0.6)
    return [
        pytest.param(
            *each, id=f"{i} {each[0]} {each[1]}", marks=() if (*each[:2], each[3]) == quick else pytest.mark.long
        )
        for i, each in enumerate(found)
    ]


def symmetric(robot: str, kind: str, points: list[dict], period: float, folder: Path) -> Task:
    if robot == "delta":
        source = str(spatial.delta(folder / robot))
    else:
        source = str(five_bar.native(folder / robot)) if robot == "five_bar" else robot
    drives = DRIVES | SLIDERS.get(robot, {}) | KINDS[kind]
    return task(source, drives, cycle={"period": period, "points": points}, options={"starts": 4})


@pytest.mark.parametrize(("robot", "kind", "points", "period"), tasks())
def test_no_saddle_is_left(robot: str, kind: str, points: list[dict], period: float, tmp_path: Path) -> None:
    solution = solve(symmetric(robot, kind, points, period, tmp_path), workers=1)
    assert solution.verified, solution.status
    assert solution.optimality().kind != "saddle"
    found = verify(solution)
    assert found.verified and found.status == solution.status


def test_a_saddle_is_left_downhill(tmp_path: Path) -> None:
    """The plain start of a rigid Delta stays in the plane of its task; the cost falls to both sides of it alike."""
    problem = build_problem(symmetric("delta", "rigid", arch(0.08, 0.03, -0.28), 0.6, tmp_path))
    transcription = transcribe(problem)
    start = run_start(transcription, 0)
    nlp = transcription.nlp(start.x)
    p = last_parameter(nlp, start.x)
    direction, curvature = descent(nlp, start.x, p)
    z = start.x / nlp.stacked("scale")
    here, *sides = (float(nlp.oracle((z + h * direction) * nlp.stacked("scale"), p)[0]) for h in (0.0, 1e-2, -1e-2))
    for side in sides:
        assert side - here == pytest.approx(curvature * 1e-4 / 2, rel=0.2)
    left = leave_saddles(transcription, start)
    assert left.claimed < start.claimed and np.isfinite(left.claimed)
    nlp = transcription.nlp(left.x)
    assert descent(nlp, left.x, last_parameter(nlp, left.x)) is None
