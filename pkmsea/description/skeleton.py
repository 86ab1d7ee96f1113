"""Writing a sidecar: what the files say and what was proposed, in our keys, with comments for its user."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import yaml

from pkmsea.description.description import CompleteDescription, Description
from pkmsea.description.parts import Placement
from pkmsea.description.sidecar import SIDECAR, Draft
from pkmsea.description.source import Source
from pkmsea.errors import InputError

COMMENTS = {
    "urdf": "file of links and joints",
    "frames": "frames that this file lacks [m, rad]",
    "closures": "pairs of frames that coincide; type point, revolute or frame",
    "couplings": "q_joint = ratio q_of + offset",
    "locked": "joints held at a position [rad, m]",
    "plane": "normal of the plane of motion; point closures keep two rows",
    "gravity": "[m/s^2], world frame",
    "actuated": "joint of each drive, in drive order",
    "independent": "minimal coordinates",
    "end_effector": "frame whose origin is followed along world axes; or joints in place of axes",
    "seed": "joint positions near a closed pose; they select the assembly mode [rad, m]",
}
FILL_IN = {
    "actuated": "actuated: [JOINT, ...]",
    "end_effector": "end_effector: {frame: FRAME, axes: [x, y]}",
}
ALWAYS = ("urdf", "gravity")
BLOCKS = ("frames", "closures", "couplings", "seed")


def write(description: CompleteDescription) -> Path | None:
    """Save the sidecar of a mechanism beside its tree. A mechanism.yaml that it has gets the proposed keys only, at its
    end; None where nothing was proposed.

    Raises
    ------
    InputError : another mechanism.yaml is there, or the folder cannot be written to.
    """
    origin = description.origin
    if not _is_ours(origin.sidecar):
        return _save(origin.folder, text(description), "x")
    if not origin.proposed:
        return None
    lines = _lines(_draft(description), origin.proposed, origin.proposed)
    return _save(origin.folder, "\n" + "\n".join(lines) + "\n", "a")


def write_incomplete(source: Source, problem: InputError) -> Path | None:
    """Save what is known of a mechanism that cannot be completed, and as comments why and what is missing; None where
    it has a mechanism.yaml already."""
    if _is_ours(source.sidecar):
        return None
    again = {"actuated", "independent"} & set(source.in_tree)  # the tree says them still
    draft = source.draft.model_copy(update=dict.fromkeys(again))
    missing = [line for key, line in FILL_IN.items() if getattr(draft, key) is None]
    comments = [f"# To fill in: {problem.cause}", f"# {problem.remedy}", *(f"# {line}" for line in missing)]
    return _save(source.folder, "\n".join([draft_text(draft, source.labels), *comments, ""]), "x")


def text(description: Description) -> str:
    """A description as a sidecar, in YAML."""
    return draft_text(_draft(description), description.origin.conventions, description.origin.proposed)


def draft_text(draft: Draft, labels: Sequence[str], proposed: Sequence[str] = ()) -> str:
    """The keys of a sidecar as YAML."""
    head = ["# Loops, drives and end effector; 'pkmsea schema mechanism' prints all keys."]
    if tuple(labels) != (SIDECAR,):
        head.append(f"# Read from: {', '.join(labels) or 'plain URDF'}.")
    said = [key for key in COMMENTS if key in ALWAYS or _plain(getattr(draft, key))]
    return "\n".join([*head, *_lines(draft, said, proposed), ""])


def _draft(description: Description) -> Draft:
    """The keys of a sidecar that say the same; a seed that no file says has six digits."""
    origin, seed = description.origin, dict(description.seed or ())
    if "seed" not in (*origin.in_sidecar, *origin.in_tree):
        seed = {joint: round(at, 6) + 0.0 for joint, at in seed.items()}
    return Draft(
        urdf=origin.urdf,
        frames={f.name: Placement(link=f.link, xyz=f.xyz, rpy=f.rpy) for f in description.frames},
        closures=description.closures,
        couplings=description.couplings,
        locked=dict(description.locked),
        plane=description.plane,
        gravity=description.gravity,
        actuated=description.actuated,
        independent=description.independent,
        end_effector=description.end_effector,
        seed=seed,
    )


def _is_ours(file: Path | None) -> bool:
    return file is not None and file.name == SIDECAR


def _save(folder: Path, content: str, mode: Literal["x", "a"]) -> Path:
    file = folder / SIDECAR
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with file.open(mode, encoding="utf-8") as stream:
            stream.write(content)
    except FileExistsError:
        raise InputError(
            "The file exists and is of another mechanism.", "Move one of the two to a folder of its own.", file=file
        ) from None
    except OSError as error:
        raise InputError(
            f"The file cannot be written ({error.strerror}).",
            "Work on a copy: 'pkmsea new FOLDER --urdf FILE' makes one.",
            file=file,
        ) from error
    return file


def _lines(draft: Draft, keys: Sequence[str], proposed: Sequence[str]) -> list[str]:
    lines: list[str] = []
    for key in (key for key in COMMENTS if key in keys):
        value, comment = _plain(getattr(draft, key)), COMMENTS[key]
        if key in proposed:
            comment += "; found by rank" if key == "independent" else "; PROPOSED, correct it"
        if key not in BLOCKS:
            lines.append(f"{key}: {_flow(value)}  # {comment}")
            continue
        entries = [f"{_flow(k)}: {_flow(v)}" for k, v in value.items()] if isinstance(value, dict) else []
        lines += [f"{key}:  # {comment}", *(f"  {entry}" for entry in entries or [f"- {_flow(v)}" for v in value])]
    return lines


def _flow(value: Any) -> str:
    written: str = yaml.safe_dump(value, default_flow_style=True, sort_keys=False, width=10_000, allow_unicode=True)
    return written.removesuffix("\n").removesuffix("\n...")


def _plain(value: Any) -> Any:
    """Records and tuples as dicts and lists, defaults left out."""
    if hasattr(value, "model_dump"):
        return _plain(value.model_dump(exclude_defaults=True))
    if isinstance(value, dict):
        return {key: _plain(inner) for key, inner in value.items()}
    return [_plain(inner) for inner in value] if isinstance(value, list | tuple) else value
