"""Reading XML of unknown origin: no document types, entities or network; every number is checked."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeAlias

import pinocchio as pin
from lxml import etree

from pkmsea.errors import InputError, MechanismError
from pkmsea.files import is_file

MAX_BYTES = 20_000_000  # a tree of links has a few hundred kB at most
LARGEST = 1e6  # of any length, mass or inertia of a mechanism, in SI units

Element: TypeAlias = etree._Element
Attributes: TypeAlias = Element | Mapping[str, str]


def parse(file: Path) -> Element:
    """The root element of an XML file.

    Raises
    ------
    MechanismError : the file is missing, too large, no well-formed XML, or declares a document type.
    """
    if not is_file(file):
        raise InputError("The file does not exist.", "Check the path.", file=file)
    if file.stat().st_size > MAX_BYTES:
        raise MechanismError(f"The file is larger than {MAX_BYTES} bytes.", "Give the tree alone.", file=file)
    try:
        content = file.read_bytes()
    except OSError as error:
        raise InputError(f"The file cannot be read ({error.strerror}).", "Check its rights.", file=file) from error
    return parse_text(content, file)


def parse_text(text: bytes, file: Path) -> Element:
    """The root element of XML text that came from `file`; see `parse`."""
    parser = etree.XMLParser(
        resolve_entities=False, no_network=True, load_dtd=False, remove_comments=True, remove_pis=True
    )
    try:
        root = etree.fromstring(text, parser)
    except (etree.XMLSyntaxError, ValueError) as error:
        raise MechanismError(f"The file does not parse: {error}.", "Mend the XML at that line.", file=file) from error
    if root.getroottree().docinfo.doctype:
        raise MechanismError(
            "The file declares a document type, which may define entities.", "Remove the <!DOCTYPE> lines.", file=file
        )
    return root


def numbers(
    element: Attributes | None, attribute: str, count: int, file: Path, key: str, default: str = ""
) -> list[float]:
    """The numbers of an attribute, `default` where it is missing; `key` says where it stands.

    Raises
    ------
    MechanismError : there are not `count` finite numbers of a sensible size.
    """
    text = default if element is None else element.get(attribute, default)
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = [math.nan]
    where: dict[str, Any] = {"file": file, "key": f"{key} {attribute}", "value": text}
    if len(values) != count or not all(map(math.isfinite, values)):
        what = "a finite number" if count == 1 else f"{count} finite numbers"
        raise MechanismError(f"This is not {what}.", f"Give {what}.", **where)
    if max(map(abs, values)) > LARGEST:
        raise MechanismError("No mechanism has numbers of this size.", "Give SI units (m, kg, kg m^2, rad).", **where)
    return values


def number(element: Attributes | None, attribute: str, file: Path, key: str, default: str = "") -> float:
    """One number; see `numbers`."""
    return numbers(element, attribute, 1, file, key, default)[0]


def axis(holder: Element, file: Path, key: str) -> list[float]:
    """The direction that the <axis> of a joint or loop states; x where there is none."""
    element = holder.find("axis")
    return numbers(element, "xyz", 3, file, f"{key} axis", "1 0 0" if element is None else "")


def tag(element: Element) -> str:
    """How a file writes the name of an element: 'joint', 'drake:ball_constraint'."""
    name = str(element.tag).rpartition("}")[2]
    return f"{element.prefix}:{name}" if element.prefix else name


def text(values: Iterable[float]) -> str:
    """Numbers as an attribute, without loss."""
    return " ".join(repr(float(value)) for value in values)


def origin(element: Element, placement: pin.SE3) -> None:
    """Add <origin>, without loss."""
    rpy = pin.rpy.matrixToRpy(placement.rotation)
    etree.SubElement(element, "origin", xyz=text(placement.translation), rpy=text(rpy))
