"""Broken task, mechanism and result files: each loads and is sound, or ends in a typed error; and soon."""

from __future__ import annotations

import json
import random
import time
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import five_bar
import h5py
import numpy as np
import pytest
from conftest import ELASTIC, PARALLEL, task
from test_mutations import mutate_xml, mutate_yaml

from pkmsea.errors import PkmseaError
from pkmsea.mechanism import load_mechanism
from pkmsea.problem import build_problem
from pkmsea.solution import Solution, solve
from pkmsea.solution.store import load
from pkmsea.task import load_task
from pkmsea.verification.reference import reference
from pkmsea.views.records import solutions
from pkmsea.views.tables import mechanism_record

ALL = {"task": 400, "mechanism": 250, "result": 350}  # the 1,000 of the long run
SHARE = 0.12  # of them in the default run
PATIENCE = 10.0  # [s] of this process
SEED = 1
TASKS = sorted((Path(__file__).parents[1] / "examples").rglob("task*/*.yaml")) + sorted(
    (Path(__file__).parents[1] / "examples").rglob("task.yaml")
)
NASTY = [b"\0", b"\xff", b"\n", b"{", b"&", b"<", b"-", b"9" * 400, b"1e999", b"\xef\xbb\xbf", b"!!", b"%", b"\t"]
WORDS: list[Any] = [
    None,
    True,
    -1,
    0,
    10**400,
    1e308,
    -1e308,
    1e-308,
    "",
    "nan",
    [],
    {},
    [[[]]],
    "x" * 10_000,
    "../..",
    "\0",
]


def mutate_bytes(content: bytes, rng: random.Random) -> bytes:
    """Some bytes flipped, inserted, deleted, doubled, or the rest cut off."""
    for _ in range(rng.choice([1, 1, 2, 5, 50])):
        at, length = rng.randrange(max(len(content), 1)), rng.choice([1, 1, 4, 16, 200])
        kind = rng.choice(["flip", "insert", "delete", "double", "cut"])
        if kind == "flip":
            content = content[:at] + rng.randbytes(length) + content[at + length :]
        elif kind == "insert":
            content = content[:at] + rng.choice(NASTY) + content[at:]
        elif kind == "delete":
            content = content[:at] + content[at + length :]
        elif kind == "double":
            content = content[: at + length] + content[at:]
        elif rng.random() < 0.1:
            content = content[:at]
    return content


def broken_task(folder: Path, rng: random.Random, solved: Solution) -> Path:
    source = rng.choice(TASKS)
    path = folder / "task.yaml"
    if rng.random() < 0.3:
        path.write_bytes(mutate_bytes(source.read_bytes(), rng))
        return path
    text = source.read_text(encoding="utf-8")
    for _ in range(rng.choice([1, 1, 2, 4])):
        text = mutate_yaml(text, rng)
    path.write_text(text, encoding="utf-8")
    return path


def broken_mechanism(folder: Path, rng: random.Random, solved: Solution) -> Path:
    robot = five_bar.CONVENTIONS[rng.choice(sorted(five_bar.CONVENTIONS))](folder / "robot")
    file = rng.choice(sorted(robot.iterdir()))
    if rng.random() < 0.4:
        file.write_bytes(mutate_bytes(file.read_bytes(), rng))
        return robot
    mutate = mutate_yaml if file.suffix == ".yaml" else mutate_xml
    file.write_text(mutate(file.read_text(), rng))
    return robot


def broken_result(folder: Path, rng: random.Random, solved: Solution) -> Path:
    path = solved.save(folder / "result.nc")
    if rng.random() < 0.4:
        path.write_bytes(mutate_bytes(path.read_bytes(), rng))
        return path
    with h5py.File(path, "r+") as file:
        for _ in range(rng.choice([1, 1, 2])):
            rng.choice([_attribute, _json, _series, _series])(file, rng)
    return path


def _attribute(file: h5py.File, rng: random.Random) -> None:
    """An attribute of the file, deleted or of another kind."""
    name = rng.choice(sorted(set(file.attrs) - {"_NCProperties"}))
    del file.attrs[name]
    values = [
        "",
        "x",
        "nan",
        "[]",
        "{}",
        "[" * 5000,
        1,
        np.nan,
        np.inf,
        1e308,
        np.arange(3.0),
        np.void(b"\x80\x04."),
        h5py.Empty("f"),
    ]
    if rng.random() < 0.8:
        file.attrs[name] = rng.choice(values)


def _json(file: h5py.File, rng: random.Random) -> None:
    """A value somewhere in the JSON text of an attribute."""
    name = rng.choice(["task", "basis", "starts", "meshes", "audit", "versions"])
    if name not in file.attrs or not isinstance(file.attrs[name], str):
        return
    data = json.loads(file.attrs[name])
    places: list[tuple[Any, Any]] = []
    _walk(data, places)
    node, key = rng.choice(places)
    if rng.random() < 0.2:
        del node[key]
    else:
        node[key] = rng.choice(WORDS)
    file.attrs[name] = json.dumps(data)


def _walk(node: Any, places: list[tuple[Any, Any]]) -> None:
    for key in list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else []:
        places.append((node, key))
        _walk(node[key], places)


def _series(file: h5py.File, rng: random.Random) -> None:
    """A series, deleted, cut, with other numbers, or of another type."""
    name = rng.choice(sorted(file))
    values, kept = file[name][()], dict(file[name].attrs)
    kind = rng.choice(["delete", "cut", "number", "type", "scalar", "attribute"])
    if kind == "attribute":
        file[name].attrs[rng.choice(["units", "scale_factor", "_FillValue", "coordinates", "calendar"])] = rng.choice(
            ["seconds since 1970-01-01", "days", 1e308, 0.0, np.nan]
        )
        return
    if kind == "number" and values.dtype.kind == "f" and values.size:
        values.flat[rng.randrange(values.size)] = rng.choice([np.nan, np.inf, -1e300, 1e300, 0.0, -1.0])
        file[name][...] = values
        return
    del file[name]
    if kind == "cut" and values.ndim:
        file[name] = values[: rng.randrange(values.shape[0] + 1)]
    elif kind == "type":
        file.create_dataset(name, data=np.full(values.shape, "x", dtype=object), dtype=h5py.string_dtype())
    elif kind == "scalar":
        file[name] = 1.0
    if name in file:
        for key in kept.keys() & {"units", "long_name"}:
            file[name].attrs[key] = kept[key]


def use_task(path: Path) -> None:
    loaded = load_task(path)
    for setup in loaded.setups:
        problem = build_problem(loaded, setup.name)
        assert problem.cycle.period > 0 and np.all(np.isfinite(problem.span)) and problem.actuation.labels


def use_mechanism(path: Path) -> None:
    json.dumps(mechanism_record(load_mechanism(path, guess=True)), allow_nan=False)


def use_result(path: Path) -> None:
    """What loads has numbers of the right shapes, and says whether it is to be believed."""
    loaded, said = load(path), reference(path)
    assert loaded.motion.coefficients.shape == (loaded.motion.basis.size, loaded.problem.actuation.m)
    assert all(np.all(np.isfinite(series)) for series in said.series.values())
    assert loaded.verified == (loaded.status == "verified")
    if loaded.verified:
        assert loaded.energy == pytest.approx(loaded.claimed, rel=loaded.problem.options.energy_tolerance, abs=1e-6)
    solutions([loaded], None, {})


KINDS: dict[str, tuple[Callable[..., Path], Callable[[Path], None]]] = {
    "task": (broken_task, use_task),
    "mechanism": (broken_mechanism, use_mechanism),
    "result": (broken_result, use_result),
}


@pytest.fixture(scope="module")
def solved() -> Solution:
    options = {"trajectory": {"kind": "spline", "knots": 24, "degree": 5}, "starts": 1}
    return solve(task("pkm_2rrr", ELASTIC | PARALLEL | {"friction": 1e-3}, options=options), workers=1)


def fuzz(kind: str, count: int, folder: Path, solved: Solution) -> None:
    make, use = KINDS[kind]
    outcomes: dict[str, int] = {"sound": 0}
    for number in range(count):
        rng = random.Random(f"{SEED} {kind} {number}")
        place = folder / str(number)
        place.mkdir()
        path = make(place, rng, solved)
        started = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                use(path)
            outcomes["sound"] += 1
        except PkmseaError as error:
            assert error.remedy and error.exit_code in (1, 2)
            outcomes[type(error).__name__] = outcomes.get(type(error).__name__, 0) + 1
        except Exception as error:
            raise AssertionError(f"{path}: {type(error).__name__}: {error}") from error
        assert time.process_time() - started < PATIENCE, path
    print(kind, outcomes)
    assert count / 50 < outcomes["sound"] < count / 2, outcomes  # the faults are neither harmless nor all alike


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_some_broken_files(tmp_path: Path, solved: Solution, kind: str) -> None:
    fuzz(kind, int(SHARE * ALL[kind]), tmp_path, solved)


@pytest.mark.long
@pytest.mark.parametrize("kind", sorted(KINDS))
def test_a_thousand_broken_files(tmp_path: Path, solved: Solution, kind: str) -> None:
    fuzz(kind, ALL[kind], tmp_path, solved)
