"""The description of a mechanism is a value: plain, equal to its copies, and all that a mechanism follows from."""

from __future__ import annotations

import json
import pickle
import shutil
from pathlib import Path, PurePath
from typing import Any

import five_bar
import numpy as np
import pytest
import spatial
from conftest import SHIPPED

from pkmsea.description import CompleteDescription, Description, find, read
from pkmsea.errors import InputError, MechanismError
from pkmsea.files import Record, parse
from pkmsea.mechanism import Mechanism, build_mechanism, load_mechanism, pose

WRITTEN = {**five_bar.CONVENTIONS, "delta": spatial.delta, "welded": spatial.welded}
PLAIN = (str, int, float, type(None), PurePath)
EXACT = 1e-12  # relative; the same Functions at the same poses


def folder_of(name: str, tmp_path: Path) -> Path:
    return find(name) if name in SHIPPED else WRITTEN[name](tmp_path / "robot")


def again(description: Description) -> CompleteDescription:
    """Written as JSON, and read."""
    return parse(CompleteDescription, json.loads(description.model_dump_json()), "result.nc")


def closed_poses(mechanism: Mechanism, count: int = 5) -> list[np.ndarray]:
    f, rng = mechanism.functions, np.random.default_rng(3)
    starts = (mechanism.seed + rng.uniform(-0.2, 0.2, mechanism.seed.size) for _ in range(count))
    poses = [pose.close(lambda q: (f["closure_residual"](q), f["closure_jacobian"](q)), q) for q in starts]
    return [q for q in poses if q is not None]


def is_plain(value: Any) -> bool:
    """Strings, numbers, paths, tuples and frozen records of them: nothing that can change."""
    if isinstance(value, Record):
        return bool(value.model_config.get("frozen")) and all(is_plain(inner) for _, inner in value)
    return all(map(is_plain, value)) if isinstance(value, tuple) else isinstance(value, PLAIN)


@pytest.mark.parametrize("name", [*SHIPPED, *WRITTEN])
def test_a_description_is_all_that_a_mechanism_follows_from(name: str, tmp_path: Path) -> None:
    """Read back from JSON, with the files gone, it gives the same M, g, H_A and seed, and describes itself again."""
    mechanism = load_mechanism(folder_of(name, tmp_path))
    shutil.rmtree(tmp_path / "robot", ignore_errors=True)
    copy = build_mechanism(again(mechanism.description))
    assert copy.description == mechanism.description
    np.testing.assert_array_equal(copy.seed, mechanism.seed)
    poses, v_ind = closed_poses(mechanism), np.linspace(1.0, -0.5, mechanism.mobility)
    assert len(poses) >= 3
    for q in poses:
        for ours, theirs in (
            (copy.mass_matrix(q), mechanism.mass_matrix(q)),
            (copy.bias(q, v_ind), mechanism.bias(q, v_ind)),
            (copy.actuation_jacobian(q), mechanism.actuation_jacobian(q)),
        ):
            np.testing.assert_allclose(ours, theirs, rtol=0, atol=EXACT * max(np.abs(theirs).max(), 1e-9))


@pytest.mark.parametrize("name", [*SHIPPED, *WRITTEN])
def test_a_description_is_plain_data(name: str, tmp_path: Path) -> None:
    description = read(folder_of(name, tmp_path))
    copies = [pickle.loads(pickle.dumps(description)), Description.model_validate_json(description.model_dump_json())]
    assert copies == [description, description]
    assert {hash(description), *map(hash, copies)} == {hash(description)}
    assert is_plain(description)
    assert len(repr(description)) < 200 and "\n" not in repr(description)
    with pytest.raises(ValueError, match="frozen"):
        description.name = "other"  # type: ignore[misc]


def test_the_digest_is_of_the_motion(tmp_path: Path) -> None:
    """It is the same in another folder, and another with another mass, loop or gravity."""
    first = read(five_bar.native(tmp_path / "first"))
    other = read(five_bar.native(tmp_path / "second"))
    assert first.digest == other.digest and first != other
    file = tmp_path / "second" / "robot.urdf"
    file.write_text(file.read_text().replace('mass value="0.1104"', 'mass value="0.1105"', 1))
    changed = [
        read(tmp_path / "second"),
        first.model_copy(update={"closures": ()}),
        first.model_copy(update={"gravity": (0.0, 0.0, -9.81)}),
    ]
    assert len({first.digest, *(description.digest for description in changed)}) == 4


def test_what_is_proposed_is_kept(tmp_path: Path) -> None:
    """A completed description says what no file says, and nothing is proposed a second time."""
    folder = five_bar.native(tmp_path / "robot")
    file = folder / "mechanism.yaml"
    file.write_text("closures: [{frames: [tip_1, tip_2]}]\nplane: {normal: [0, 0, 1]}\n")
    open_ = read(folder)
    assert (open_.actuated, open_.independent, open_.end_effector, open_.seed) == (None, None, None, None)
    with pytest.raises(MechanismError, match=r"mechanism\.yaml, actuated: This key is missing"):
        build_mechanism(open_)
    mechanism = build_mechanism(open_, guess=True)
    assert {"actuated", "end_effector", "independent"} <= set(mechanism.description.origin.proposed)
    copy = build_mechanism(again(mechanism.description))
    assert copy.description == mechanism.description
    np.testing.assert_array_equal(copy.seed, mechanism.seed)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"tree": "<robot"}, "does not parse"),
        ({"tree": '<!DOCTYPE r [<!ENTITY a "a">]><robot name="r"/>'}, "document type"),
        ({"tree": '<robot name="r"><link name="a"/><link name="b"/></robot>'}, "do not hang together"),
        ({"closures": [{"frames": ["tip_1"]}]}, r"closures\.0\.frames"),
        ({"seed": [["A", float("inf")]]}, r"seed\.0\.1"),
        ({"more": 1}, "more: This key is not known"),
    ],
)
def test_a_foreign_description_is_checked(mechanisms: dict[str, Mechanism], change: dict, message: str) -> None:
    data = json.loads(mechanisms["pkm_2rrr"].description.model_dump_json()) | change
    with pytest.raises(InputError, match=message):
        parse(Description, data, "result.nc")
