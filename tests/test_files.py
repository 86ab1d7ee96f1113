"""What the words of a file mean, and what is said of those that mean nothing: file, key, value and remedy."""

from __future__ import annotations

from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any

import pytest
from conftest import SLIDER_ELASTIC, STROKE

from pkmsea.errors import InputError, PkmseaError
from pkmsea.files import parse, read_yaml
from pkmsea.solution import solve
from pkmsea.task import Task

TASK: dict[str, Any] = {
    "name": "t",
    "cycle": {"period": 2.0, "points": deepcopy(STROKE)},
    "limits": {"end_effector": {"position": {"x": [0.1, 1.9]}, "velocity": 3.0}},
    "setups": [{"name": "s", "mechanism": "linear_axis_1", "drives": [deepcopy(SLIDER_ELASTIC)]}],
    "options": {"starts": 1, "meshes": 1, "iterations": 10, "trajectory": {"kind": "fourier", "order": 6}},
}


@pytest.mark.parametrize(
    ("word", "value"),
    [
        ("010", 10), ("1:30", "1:30"), ("1e-3", 1e-3), ("1.e3", 1e3), ("-.5", -0.5), ("+3", 3), ("1_000", "1_000"),
        ("0x1F", "0x1F"), ("2001-01-01", "2001-01-01"), ("on", "on"), ("yes", "yes"), ("y", "y"), ("true", True),
        ("'1'", "1"), ("~", None), ("", None), ("NO", "NO"),
    ],
)  # fmt: skip
def test_plain_words_are_those_of_yaml_1_2(tmp_path: Path, word: str, value: Any) -> None:
    (tmp_path / "file.yaml").write_text(f"key: {word}")
    found = read_yaml(tmp_path / "file.yaml")["key"]
    assert found == value and type(found) is type(value)


def changed(key: str, value: Any) -> dict[str, Any]:
    """TASK with what stands at a key with dots replaced."""
    data = deepcopy(TASK)
    place: Any = data
    *path, last = key.split(".")
    for part in path:
        place = place[int(part) if part.isdigit() else part]
    place[int(last) if last.isdigit() else last] = value
    return data


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("cycle.period", True, "cycle.period = 'true': .* valid number"),
        ("cycle.points.0.at", [False], r"cycle\.points\.0\.at\.0 = 'false'"),
        ("cycle.points.0.rest", True, r"cycle\.points\.0\.rest = 'true'"),
        ("limits.end_effector.position.x.1", True, r"position\.x\.1 = 'true'"),
        ("limits.end_effector.velocity", {"x": True}, r"velocity\.x = 'true'"),
        ("setups.0.drives.0.stiffness", {"bounds": [True, 5]}, r"stiffness\.bounds\.0 = 'true'"),
        ("options.starts", True, "options.starts = 'true': .* valid integer"),
        ("setups.0.drives.0.stiffness", {"bounds": [5, 1]}, "lower bound is not below"),
        ("limits.end_effector.position.x", [1.9, 0.1], r"'x' are not \[low, high\]"),
        ("cycle.perod", 2.0, r"cycle\.perod: .*Did you mean 'period'\?"),
        ("setups.0.drives.0.inertai", 2.0, r"drives\.0\.inertai: .*Did you mean 'inertia'\?"),
        ("cycle.xyz", 2.0, r"cycle\.xyz: This key is not known\. Remove it"),
        ("setups.0.drives.0.copper_loss", 1e-300, r"copper_loss = 1e-300: .* 1e-30"),
        ("cycle.period", 1e300, r"cycle\.period = 1e\+300: .* 1e\+30"),
        ("cycle.points.0.at", [-1e300], r"at\.0 = -1e\+300"),
    ],
)
def test_what_is_wrong_is_told(key: str, value: Any, said: str) -> None:
    with pytest.raises(InputError, match=rf"t\.yaml, .*{said}"):
        parse(Task, changed(key, value), "t.yaml")


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("key", ["cycle.period", "setups.0.drives.0.inertia", "setups.0.drives.0.copper_loss"])
@pytest.mark.parametrize("value", [1e-30, 1e30])
def test_extreme_numbers_end_in_typed_errors_or_verdicts(key: str, value: float) -> None:
    with suppress(PkmseaError):
        assert not solve(parse(Task, changed(key, value), "t.yaml"), workers=1).verified
