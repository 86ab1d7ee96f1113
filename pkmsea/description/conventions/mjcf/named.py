"""The files that an MJCF model names, found before MuJoCo opens any of them: they lie in the model's folder."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from math import prod
from pathlib import Path
from typing import NamedTuple

from pkmsea.description import meshes, xml
from pkmsea.description.xml import Element
from pkmsea.errors import MechanismError

FOLDERS = ("meshdir", "assetdir", "texturedir")
MODELS = ("include", "model")  # elements that name more MJCF
COPYING = {"replicate": ("count",), "composite": ("count",), "flexcomp": ("count",)}
FILLING = {"texture": ("width", "height"), "hfield": ("nrow", "ncol"), "numeric": ("size",)}
COPIES, VALUES = 10_000, 100_000_000  # MuJoCo needs a minute from there on; a GB of memory


class Named(NamedTuple):
    document: Path
    element: Element
    name: str
    path: Path


def named_files(root: Element, file: Path) -> dict[str, list[Path]]:
    """Existing files, by the name that the model or a model that it includes gives them.

    MuJoCo counts names from the folder of the main file or of the including one, and from those of <compiler>.

    Raises
    ------
    MechanismError : one of them lies outside the main file's folder or is too large, or the model multiplies itself
        beyond `COPIES`.
    """
    folder = file.parent.resolve()
    documents = {folder / file.name: root}
    while True:
        for path, document in documents.items():
            _check_document(document, path)
        found = [named for named in _named(documents, folder) if os.path.exists(named.path)]
        for named in found:
            _check_file(named, folder)
        new = {named.path for named in found if named.element.tag in MODELS} - documents.keys()
        if not new:
            break
        documents |= {path: xml.parse(path) for path in sorted(new)}
    attached = {named.path: documents[named.path] for named in found if named.element.tag == "model"}
    _check_size(documents, attached)
    by_name: dict[str, list[Path]] = {}
    for named in found:
        paths = by_name.setdefault(named.name, [])
        paths += [named.path] if named.path not in paths else []
    return by_name


def _named(documents: Mapping[Path, Element], folder: Path) -> Iterator[Named]:
    """Every path that MuJoCo might take a name for, the likeliest first."""
    compilers = [compiler for root in documents.values() for compiler in root.iter("compiler")]
    places = dict.fromkeys([*(compiler.get(key, "") for key in FOLDERS for compiler in reversed(compilers)), ""])
    for document, root in documents.items():
        for element in root.iter():
            for name in [value for key, value in element.attrib.items() if key.startswith("file")]:
                plain = name.replace("\\", "/")
                words = (name, plain, plain.rpartition("/")[2])  # the last one with strippath
                paths = [
                    base / place / word for word in words for base in (folder, document.parent) for place in places
                ]
                for path in dict.fromkeys(
                    os.path.realpath(way(path)) for path in paths for way in (str, os.path.normpath)
                ):
                    if not os.path.isdir(path):
                        yield Named(document, element, name, Path(path))


def _check_document(document: Element, file: Path) -> None:
    """MuJoCo reads UTF-8 whatever the file declares, and would find other names in it; two plugins crash 3.10."""
    encoding = document.getroottree().docinfo.encoding or "UTF-8"
    if encoding.upper() not in ("UTF-8", "US-ASCII", "ASCII"):
        raise MechanismError("MuJoCo reads UTF-8 alone.", "Save it so.", file=file, key="encoding", value=encoding)
    for element in document.iter("body", "geom"):
        if len(element.findall("plugin")) > 1:
            key = f"{element.tag} '{element.get('name', '')}': plugin"
            raise MechanismError("There are two of them.", "Remove one.", file=file, key=key)


def _check_file(named: Named, folder: Path) -> None:
    limit = xml.MAX_BYTES if named.element.tag in MODELS else meshes.MAX_BYTES
    if not named.path.is_relative_to(folder) or not named.path.is_file() or named.path.stat().st_size > limit:
        raise MechanismError(
            f"This is no file inside the model's folder of at most {limit} bytes.",
            "Put the file there, and correct its name.",
            file=named.document,
            key=f"<{named.element.tag}> file",
            value=named.name,
        )


def _check_size(documents: Mapping[Path, Element], attached: Mapping[Path, Element]) -> None:
    """A few lines of MJCF may stand for any number of bodies."""
    for path, root in attached.items():
        if root.find(".//attach") is not None:
            raise MechanismError(
                "An attached model attaches another one.",
                "Save it once from MuJoCo (mj_saveLastXML).",
                file=path,
                key="<attach>",
            )
    child = max((_size(root, path, 1) for path, root in attached.items()), default=1)
    for path, root in documents.items():
        _size(root, path, child)


def _size(root: Element, file: Path, attached: int) -> int:
    """The number of elements that a document stands for."""
    total = copies = 0
    for element in root.iter():
        times = prod(_count(e, COPYING) for e in (element, *element.iterancestors()))
        times *= attached if element.tag == "attach" else 1
        total, copies = total + times, copies + times - 1
        if copies > COPIES or _count(element, FILLING) > VALUES:
            raise MechanismError(
                f"The model multiplies itself beyond {COPIES} elements or {VALUES} values.",
                "Lower the counts.",
                file=file,
                key=f"<{element.tag}>",
            )
    return total


def _count(element: Element, keys: Mapping[str, tuple[str, ...]]) -> int:
    words = [word for key in keys.get(str(element.tag), ()) for word in element.get(key, "").split()]
    return prod(int(word) for word in words if word.isdecimal())
