"""From files to a description: located, read in their conventions, checked and cleaned."""

from __future__ import annotations

import io
import logging
from pathlib import Path

import yourdfpy
from lxml import etree

from pkmsea.description.clean import clean
from pkmsea.description.description import Description, Origin
from pkmsea.description.limits import placeholder_notes
from pkmsea.description.locate import find
from pkmsea.description.source import Source, read_source
from pkmsea.errors import MechanismError
from pkmsea.files import parse


def read(source: str | Path) -> Description:
    """The description of a mechanism: of a folder, a sidecar or a tree in any convention, or of one that pkmsea or
    example-robot-data ships, by its name.

    Raises
    ------
    InputError : names file, key, value and remedy.
    """
    said = read_source(find(source))
    draft = said.draft
    placeholders = placeholder_notes(said.root, draft.locked, draft.actuated, said.tree)
    notes = [*said.notes, *placeholders, *clean(said.root, said.tree, draft.locked)]
    text = etree.tostring(said.root, encoding="unicode")
    _validate(text, said.tree)
    data = {
        "name": said.name,
        "tree": text,
        "frames": [{"name": name, **dict(placement)} for name, placement in draft.frames.items()],
        "closures": draft.closures,
        "couplings": draft.couplings,
        "locked": tuple(draft.locked.items()),
        "plane": draft.plane,
        "gravity": draft.gravity,
        "actuated": draft.actuated,
        "independent": draft.independent,
        "end_effector": draft.end_effector,
        "seed": None if draft.seed is None else tuple(draft.seed.items()),
        "notes": notes,
        "origin": _origin(said),
    }
    return parse(Description, data, said.sidecar or said.tree)


def _origin(said: Source) -> Origin:
    return Origin(
        folder=said.folder,
        tree=said.tree,
        sidecar=said.sidecar,
        meshes=said.tree.parent.absolute(),
        urdf=said.draft.urdf or said.tree.name,
        conventions=said.labels,
        in_sidecar=said.in_sidecar,
        in_tree=said.in_tree,
    )


def _validate(text: str, file: Path) -> None:
    """What yourdfpy finds wrong with a cleaned tree."""
    logging.getLogger("yourdfpy").setLevel(logging.CRITICAL)  # it logs what the error below says
    try:
        robot = yourdfpy.URDF.load(
            io.BytesIO(text.encode()), build_scene_graph=False, load_meshes=False, build_collision_scene_graph=False
        )
        valid, faults = robot.validate(), robot.errors
    except Exception as error:
        raise MechanismError(f"The URDF cannot be read: {error!r}.", "Mend that element.", file=file) from error
    if not valid:
        raise MechanismError(f"The URDF is not valid: {faults[0]}.", "Mend that element.", file=file)
