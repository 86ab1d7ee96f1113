"""200 broken files: each ends in success or in a typed error that names file and key; never otherwise, and soon."""

from __future__ import annotations

import copy
import random
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import five_bar
import numpy as np
import pytest
import yaml
from lxml import etree

from pkmsea.errors import PkmseaError
from pkmsea.mechanism import load_mechanism
from pkmsea.views.tables import mechanism_record

COUNT = 200
PATIENCE = 10.0  # [s] of this process
CLOSED = 1e-9  # [m]
BAD = ["", "nan", "inf", "-inf", "1e308", "1e5", "-1", "0", "0 0 0", "abc", "1 2", "\u0000x"[1:], "../../../etc/passwd"]
WRONG: list[Any] = [
    None,
    True,
    -1,
    0,
    1e308,
    float("nan"),
    float("inf"),
    "abc",
    "",
    [],
    {},
    [1, 2],
    {"x": 1},
    "x" * 300,
]
PLACES = {"xml": (".urdf", ".xml"), "yaml": (".yaml",)}


def mutate_xml(text: str, rng: random.Random) -> str:
    """One fault in a tree: deleted, doubled or moved elements; deleted, wrong, exchanged or renamed attributes."""
    root = etree.fromstring(text.encode())
    elements = [e for e in root.iter() if e is not root]
    element = rng.choice(elements)
    holders = [e for e in elements if e.attrib]
    holder = rng.choice(holders)
    attribute = rng.choice(sorted(holder.attrib))
    kind = rng.choice(["delete", "double", "move", "drop", "bad", "exchange", "rename", "cut"])
    if kind == "delete":
        element.getparent().remove(element)
    elif kind == "double":
        element.getparent().append(copy.deepcopy(element))
    elif kind == "move":
        target = rng.choice([e for e in elements if element not in (e, *e.iterancestors())] or [root])
        target.append(element)
    elif kind == "drop":
        del holder.attrib[attribute]
    elif kind == "bad":
        holder.set(attribute, rng.choice(BAD))
    elif kind == "exchange":
        others = [e for e in holders if attribute in e.attrib and e.tag == holder.tag]
        other = rng.choice(others)
        value = holder.get(attribute)
        holder.set(attribute, other.get(attribute))
        other.set(attribute, value)
    elif kind == "rename":
        element.tag = "loop" if element.tag == "joint" else "joint"
    written = etree.tostring(root).decode()
    return written[: rng.randrange(len(written))] if kind == "cut" else written


def mutate_yaml(text: str, rng: random.Random) -> str:
    """One fault in a sidecar: a deleted, unknown, wrong or exchanged value anywhere in it."""
    data = yaml.safe_load(text)
    places: list[tuple[Any, Any]] = []

    def walk(node: Any) -> None:
        keys = list(node) if isinstance(node, dict) else range(len(node)) if isinstance(node, list) else []
        for key in keys:
            places.append((node, key))
            walk(node[key])

    walk(data)
    node, key = rng.choice(places)
    kind = rng.choice(["delete", "wrong", "unknown", "exchange", "double"])
    if kind == "delete":
        del node[key]
    elif kind == "wrong":
        node[key] = rng.choice(WRONG)
    elif kind == "unknown" and isinstance(node, dict):
        node[f"{key}x"] = node.pop(key)
    elif kind == "exchange":
        other, place = rng.choice([(n, k) for n, k in places if n is node])
        node[key], other[place] = other[place], node[key]
    elif isinstance(node, list):
        node.append(node[key])
    return yaml.safe_dump(data)


MUTATE: dict[str, Callable[[str, random.Random], str]] = {"xml": mutate_xml, "yaml": mutate_yaml}


def outcome(folder: Path) -> str:
    """'success' after the laws of a mechanism are checked, or the message of a typed error."""
    try:
        mechanism = load_mechanism(folder, guess=True)
        mechanism_record(mechanism)
    except PkmseaError as error:
        assert error.file is not None, error
        assert error.key is not None or "parse" in error.cause or "YAML" in error.cause, error
        assert error.exit_code == 2 and error.remedy
        return str(error)
    q = mechanism.seed
    G, H = np.array(mechanism.functions["closure_jacobian"](q)), mechanism.velocity_map(q)
    assert np.abs(mechanism.closure_residual(q)).max(initial=0) < CLOSED
    np.testing.assert_allclose(G @ H, 0, atol=1e-9 * np.abs(H).max())
    assert np.linalg.eigvalsh(mechanism.mass_matrix(q))[0] > 0
    root = etree.parse(str(mechanism.description.origin.tree)).getroot()
    if root.tag == "robot":  # nothing of the file is lost
        masses = [float(mass.get("value")) for mass in root.findall("link/inertial/mass")]
        assert sum(inertia.mass for inertia in mechanism.model.inertias) == pytest.approx(sum(masses))
        moving = {j.get("name") for j in root.findall("joint") if j.get("type") != "fixed"}
        assert moving == {*mechanism.joints, *dict(mechanism.description.locked)}
    return "success"


def test_mutations(tmp_path: Path) -> None:
    rng = random.Random(0)
    outcomes: dict[str, str] = {}
    names = list(five_bar.CONVENTIONS)
    for number in range(COUNT):
        name = names[number % len(names)]
        folder = five_bar.CONVENTIONS[name](tmp_path / f"{number}")
        place = "yaml" if number % 3 == 0 else "xml"
        file = next(f for f in sorted(folder.iterdir()) if f.suffix in PLACES[place])
        file.write_text(MUTATE[place](file.read_text(), rng))
        started = time.process_time()
        try:
            outcomes[f"{number} {name} {place}"] = outcome(folder)
        except Exception as error:
            raise AssertionError(f"{folder}: {type(error).__name__}: {error}") from error
        assert time.process_time() - started < PATIENCE, folder
    succeeded = sum(text == "success" for text in outcomes.values())
    assert COUNT / 10 < succeeded < COUNT / 2, outcomes  # the mutations are neither harmless nor all alike
