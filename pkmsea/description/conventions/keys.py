"""What conventions of loops share: placements on links, and two of them that coincide, as sidecar keys."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin

from pkmsea.description.xml import Element, numbers
from pkmsea.errors import MechanismError, NameNotFound

ELSEWHERE = "Open the loop at a pin, a ball or a weld instead, and put this joint into the tree."
LISTS = ("closures", "couplings", "notes")


def joined(said: dict[str, Any], more: dict[str, Any], file: Path) -> dict[str, Any]:
    """The keys of two conventions: lists follow each other, frames are united; else what is said first stays.

    Raises
    ------
    MechanismError : a frame stands in both.
    """
    frames, others = said.get("frames", {}), more.get("frames", {})
    for name in frames.keys() & others.keys():
        raise MechanismError("Two loops give a frame this name.", "Give each loop its own name.", file=file, key=name)
    lists = {key: (*said.get(key, ()), *more.get(key, ())) for key in LISTS if key in said or key in more}
    return more | said | lists | ({"frames": frames | others} if frames or others else {})


def names(root: Element) -> list[str]:
    """Of all links."""
    return [link.get("name", "") for link in root.findall("link")]


def placement(link: str | None, origin: Element | None, links: Sequence[str], file: Path, key: str) -> dict[str, Any]:
    """A place on a link, by the attributes xyz and rpy of an element.

    Raises
    ------
    NameNotFound, MechanismError : there is no such link, or these are no numbers.
    """
    if link is None or link not in links:
        raise NameNotFound("link", link or "", list(links), file=file, key=key)
    xyz, rpy = (tuple(numbers(origin, a, 3, file, key, "0 0 0")) for a in ("xyz", "rpy"))
    return {"link": link, "xyz": xyz, "rpy": rpy}


def at(link: str, place: pin.SE3) -> dict[str, Any]:
    """A place on a link."""
    rpy = pin.rpy.matrixToRpy(place.rotation)
    return {"link": link, "xyz": tuple(place.translation.tolist()), "rpy": tuple(np.asarray(rpy).tolist())}


def closure(
    name: str, kind: str, ends: dict[str, dict[str, Any]], axis: Sequence[float] | None = None
) -> dict[str, Any]:
    """Two new frames that coincide as `kind` asks; `ends` are their placements by name.

    A revolute closure whose axis nobody states joins the origins alone, and a note says so.
    """
    unknown = kind == "revolute" and axis is None
    one: dict[str, Any] = {"name": name, "frames": tuple(ends), "type": "point" if unknown else kind}
    if one["type"] == "revolute":
        one["axis"] = tuple(axis or ())
    note = f"loop '{name}': its axis is not stated; its two origins are joined, and all turns are left free"
    return {"frames": ends, "closures": (one,)} | ({"notes": (note,)} if unknown else {})


def kind_of(stated: str, kinds: dict[str, str], file: Path, key: str) -> str:
    """The type of closure that a stated type means.

    Raises
    ------
    MechanismError : none.
    """
    if stated not in kinds:
        raise MechanismError(
            "A loop that is closed by a joint of this type is not read.",
            f"{ELSEWHERE} Types that are read: {', '.join(kinds)}.",
            file=file,
            key=f"{key}: type",
            value=stated,
        )
    return kinds[stated]
