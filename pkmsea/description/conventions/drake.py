"""Drake's `<drake:ball_constraint>`: a point of body A and a point of body B coincide."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pkmsea.description.conventions import keys
from pkmsea.description.xml import Element, numbers, tag
from pkmsea.errors import MechanismError, NameNotFound

LABEL = "<drake:ball_constraint> elements"
TAGS: tuple[str, ...] = ("drake:ball_constraint",)
PARTS = {"A": "drake:ball_constraint_p_AP", "B": "drake:ball_constraint_p_BQ"}
BODY = "drake:ball_constraint_body_"


def read(root: Element, file: Path) -> dict[str, Any]:
    """Ball constraints as point closures between two new frames; empty where there are none."""
    said: dict[str, Any] = {}
    for i, ball in enumerate(element for element in root if tag(element) in TAGS):
        name = f"ball_constraint{i + 1}"
        key = f"drake:ball_constraint {i + 1}"
        inside = {tag(element): element for element in ball}
        ends = {f"{name}_{body}": _end(inside, body, keys.names(root), file, key) for body in PARTS}
        said = keys.joined(said, keys.closure(name, "point", ends), file)
    return said


def _end(inside: dict[str, Element], body: str, links: list[str], file: Path, key: str) -> dict[str, Any]:
    for part in (BODY + body, PARTS[body]):
        if part not in inside:
            raise MechanismError(f"<{part}> is missing.", "Name two bodies, and a point of each.", file=file, key=key)
    link = inside[BODY + body].get("name", "")
    if link not in links:
        raise NameNotFound("link", link, links, file=file, key=f"{key}: {BODY}{body}")
    point = numbers(inside[PARTS[body]], "value", 3, file, f"{key}: {PARTS[body]}")
    return {"link": link, "xyz": tuple(point)}
