"""The files of one mechanism: which they are, in which conventions, and what they say as keys of a sidecar."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pkmsea.description import robots, xml
from pkmsea.description.conventions import BESIDE, FORMATS, MARKS
from pkmsea.description.conventions.keys import joined
from pkmsea.description.elements import refuse_unknown
from pkmsea.description.locks import hold
from pkmsea.description.parts import Coupling
from pkmsea.description.plain import make_plain
from pkmsea.description.sidecar import SIDECAR, Draft
from pkmsea.description.tree import check
from pkmsea.errors import InputError, MechanismError
from pkmsea.files import is_file, parse, read_yaml

TREES = (".urdf", ".xml", *(suffix for form in FORMATS for suffix in form.SUFFIXES))
SIDECARS = (".yaml", ".yml")


@dataclass(frozen=True, eq=False)
class Source:
    """What the files of one mechanism say, and where they say it.

    Attributes
    ----------
    folder : where the mechanism lies.
    tree : its file of links and joints; `root` is its content as URDF.
    sidecar : its YAML file; None where there is none.
    draft : the keys of a sidecar, as far as the files say them.
    in_sidecar, in_tree : the keys that each says; what a sidecar says goes before what the tree says.
    labels : the conventions that were met.
    notes : what is read in another way than it is written, or left out.
    files : those in the tree's folder that a copy of the tree needs beside it; meshes of a URDF are not among them.
    """

    folder: Path
    tree: Path
    root: xml.Element
    sidecar: Path | None
    draft: Draft
    in_sidecar: tuple[str, ...]
    in_tree: tuple[str, ...]
    labels: tuple[str, ...]
    notes: tuple[str, ...]
    files: tuple[Path, ...] = ()

    @property
    def name(self) -> str:
        """Of the folder, which is one mechanism; of the tree, where that stands alone."""
        return self.folder.resolve().name if self.sidecar else self.tree.stem


def read_source(path: Path) -> Source:
    """Read a folder, a sidecar or a tree in any convention.

    Raises
    ------
    InputError : names file, key, value and remedy.
    """
    folder = path if path.is_dir() else path.parent
    sidecar = _sidecar_of(path)
    data, labels = _yaml(sidecar) if sidecar else ({}, [])
    said = parse(Draft, data, sidecar)
    tree = path if path.is_file() and path != sidecar else _find_tree(folder, said.urdf, sidecar)
    root, in_tree, found, files = _read_tree(tree)
    notes = in_tree.pop("notes", ())
    from_tree = parse(Draft, in_tree, tree)
    ours, theirs = ({name: getattr(d, name) for name in d.model_fields_set} for d in (said, from_tree))
    if ours.keys() & {"closures", "couplings", "locked"}:
        theirs.pop("independent", None)  # the tree counts with its own loops
    merged = theirs | ours | {"frames": from_tree.frames | said.frames, "urdf": said.urdf or tree.name}
    merged |= {"couplings": _together(said.couplings, from_tree.couplings)}
    draft, held = hold(Draft.model_construct(**merged), sidecar or tree)
    if "actuated" in theirs.keys() - ours.keys():
        moving = tuple(name for name in draft.actuated or () if name not in draft.locked)
        draft = draft.model_copy(update={"actuated": moving or None})
    if draft.seed is not None and "seed" in theirs.keys() - ours.keys():
        free = {name: at for name, at in draft.seed.items() if name not in draft.locked}
        draft = draft.model_copy(update={"seed": free})
    said_by = tuple(sorted(ours)), tuple(sorted(theirs.keys() - ours.keys()))
    return Source(folder, tree, root, sidecar, draft, *said_by, (*labels, *found), (*notes, *held), files)


def _together(ours: tuple[Coupling, ...], theirs: tuple[Coupling, ...]) -> tuple[Coupling, ...]:
    """Couplings of the sidecar, and those of the tree for other joints."""
    named = {coupling.joint for coupling in ours}
    pairs = [{coupling.joint, coupling.of} for coupling in ours]
    return *ours, *(c for c in theirs if c.joint not in named and {c.joint, c.of} not in pairs)


def _sidecar_of(path: Path) -> Path | None:
    """The YAML file that belongs to a folder, a tree, or itself."""
    if path.is_file() and path.suffix in SIDECARS:
        return path
    folder = path if path.is_dir() else path.parent
    for name in (SIDECAR, *(convention.NAME for convention in BESIDE)):
        candidate = folder / name
        if candidate.is_file() and (path.is_dir() or _belongs(candidate, path)):
            return candidate
    return None


def _belongs(sidecar: Path, tree: Path) -> bool:
    data = read_yaml(sidecar)
    named = data.get("urdf") if isinstance(data, dict) else None
    return named == tree.name if named is not None else _trees(tree.parent) == [tree]


def _yaml(file: Path) -> tuple[dict[str, Any], list[str]]:
    data = read_yaml(file)
    for convention in BESIDE:
        if convention.speaks(data):
            return convention.read(data, file), [convention.LABEL]
    return data, [SIDECAR]


def _trees(folder: Path) -> list[Path]:
    """The trees of a folder, without those that are parts of another one."""
    found = sorted(p for p in folder.iterdir() if p.suffix in TREES and p.is_file())
    parts = {part for tree in found for part in _parts(tree)} if len(found) > 1 else set()
    return [tree for tree in found if tree.resolve() not in parts]


def _parts(tree: Path) -> Sequence[Path]:
    with suppress(InputError):  # raised where this tree is read
        root = xml.parse(tree)
        return [part for form in FORMATS if form.speaks(root, tree) for part in form.files(root, tree)]
    return []


def _find_tree(folder: Path, named: str | None, sidecar: Path | None) -> Path:
    """The tree that the sidecar names, else the only one of the folder."""
    if named is not None and robots.is_robot(named) and not is_file(folder / named):
        return robots.find_robot(named, file=sidecar, key="urdf")
    if named is not None:
        tree = folder / named
        if "\0" in named or not tree.resolve().is_relative_to(folder.resolve()) or not is_file(tree):
            raise MechanismError(
                "The file that 'urdf' names is not in the mechanism's folder.",
                f"Put it there, correct the name, or name a robot as '{robots.PACKAGE}/ur5_robot.urdf'.",
                file=sidecar,
                key="urdf",
                value=named,
            )
        return tree
    found = _trees(folder)
    if len(found) != 1:
        names = ", ".join(tree.name for tree in found[:5]) or "none"
        raise MechanismError(
            f"The folder holds {len(found)} files of links and joints ({names}).",
            f"Give the file itself, or name one in {SIDECAR} with the key 'urdf'.",
            file=folder,
            key="urdf",
        )
    return found[0]


def _read_tree(tree: Path) -> tuple[xml.Element, dict[str, Any], list[str], tuple[Path, ...]]:
    """A tree as URDF, with what its conventions say, and the files that it needs."""
    if tree.suffix not in TREES:
        raise InputError(
            f"A mechanism is a folder, a sidecar (.yaml), or a tree ({', '.join(TREES)}).",
            "Give one of these.",
            file=tree,
        )
    root = xml.parse(tree)
    said: dict[str, Any] = {}
    files: tuple[Path, ...] = ()
    form = next((form for form in FORMATS if form.speaks(root, tree)), None)
    if form is not None:
        files = tuple(form.files(root, tree))
        root, said = form.read(root, tree)
        if not form.MARKED:
            check(root, tree)
            return root, said, [form.LABEL], files
    make_plain(root, tree)
    check(root, tree)
    refuse_unknown(root, tree, [name for convention in MARKS for name in convention.TAGS])
    labels = []
    for convention in MARKS:
        more = convention.read(root, tree)
        labels += [convention.LABEL] if more.keys() - {"notes"} else []
        said = joined(said, more, tree)
    return root, said, labels, files
