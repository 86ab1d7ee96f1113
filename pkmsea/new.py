"""A first task for somebody's own mechanism: a folder with tree, sidecar and task file, ready to be corrected."""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from itertools import product
from pathlib import Path

import numpy as np
from lxml import etree

from pkmsea.description import find, meshes, skeleton
from pkmsea.description.conventions import transmission, xacro
from pkmsea.description.sidecar import SIDECAR
from pkmsea.description.source import Source, read_source
from pkmsea.errors import InputError, Unreachable, noting
from pkmsea.files import write_whole
from pkmsea.mechanism import Mechanism, load_mechanism
from pkmsea.mechanism.workspace import reach

TASK = "task.yaml"
PERIOD = 1.0  # [s], or longer where the joints' limits ask for it
USED = 0.5  # of what they allow
REST, WINDOW = 0.1, 0.01  # of the period; of the way
MOST = {"m": np.inf, "rad": 1.0}  # of a coordinate on one side of the seed
SHARES = (0.6, 0.5, 0.4, 0.3, 0.2, 0.1, 0.05)  # of the reach from the seed, tried as operating points
ROOM = 0.2  # of the way, left around the points
KEEP = 0.4  # of the seed's distance to singularities, on the whole way
STEPS = 15  # at which the way is looked at
TINY = 1e-12  # keeps ratios finite where nothing moves
ROTOR, FRICTION, LOSS = 0.1, 0.03, 0.5  # of the load's inertia; of inertia w; of 1/(inertia w)
SOFT, STIFF = 0.05, 50.0  # of inertia w^2


def new(folder: Path, tree: Path | None) -> list[Path]:
    """Write tree, sidecar and task of a mechanism into `folder`; without `tree`, the task of what is there.

    Raises
    ------
    InputError : a file is there already, or something must be filled in by hand first; says what.
    """
    written = _take(folder, find(tree)) if tree else []
    try:
        mechanism = load_mechanism(folder, guess=True)
    except InputError as error:
        file = skeleton.write_incomplete(read_source(folder), error)
        raise InputError(
            error.cause,
            f"{error.remedy} Then run 'pkmsea new {folder}' again.",
            file=file or error.file,
            key=error.key,
            value=error.value,
        ) from None
    sidecar = skeleton.write(mechanism.description)
    task = folder / TASK
    if task.exists():
        raise InputError("The file exists; it is not overwritten.", "Move it away first.", file=task)
    source = read_source(folder)
    completed = load_mechanism(folder)
    with noting(completed.description.notes):
        first = task_text(completed, transmission.gears(source.root, source.tree))
    write_whole(task, lambda temporary: temporary.write_text(first, encoding="utf-8"))
    return [*dict.fromkeys([*written, *([sidecar] if sidecar else []), task])]


def _take(folder: Path, path: Path) -> list[Path]:
    """Copy a tree with its meshes and its sidecar; xacro is expanded."""
    source = read_source(path)
    if folder.exists() and any(folder.iterdir()):
        raise InputError("The folder is not empty.", "Name a new one.", file=folder)
    copied = folder / source.tree.name
    if source.tree.suffix in xacro.SUFFIXES:
        copied = copied.with_suffix("" if copied.stem.endswith(".urdf") else ".urdf")
        write_whole(copied, lambda temporary: temporary.write_bytes(etree.tostring(source.root)))
    else:
        _copy(source.tree, copied)
    for file in source.files:
        _copy(file, folder / file.relative_to(source.tree.parent.resolve()))
    _take_meshes(folder, source)
    if source.sidecar is None:
        return [copied]
    sidecar = folder / SIDECAR
    if source.sidecar.name == SIDECAR:
        _copy(source.sidecar, sidecar)
    else:
        draft = source.draft.model_copy(update={"urdf": copied.name})
        text = skeleton.draft_text(draft, source.labels)
        write_whole(sidecar, lambda temporary: temporary.write_text(text, encoding="utf-8"))
    return [copied, sidecar]


def _copy(source: Path, target: Path) -> None:
    write_whole(target, lambda temporary: shutil.copyfile(source, temporary))


def _take_meshes(folder: Path, source: Source) -> None:
    for mesh in source.root.findall("link/visual/geometry/mesh"):
        name = mesh.get("filename", "")
        found, target = meshes.resolve(name, source.folder), meshes.beside(name, folder)
        if found is not None and target is not None:
            _copy(found, target)


def task_text(mechanism: Mechanism, gears: Mapping[str, transmission.Gear]) -> str:
    """A task for a mechanism: two points inside the workspace, rigid drives beside elastic ones of a plausible size.

    `gears` is what the tree tells by joint.
    """
    points = operating_points(mechanism)
    way, period = float(np.linalg.norm(points[1] - points[0])), period_of(mechanism, points)
    end_effector = mechanism.description.end_effector
    cycle = [
        f"    - {{at: [{', '.join(_short(x, 3) for x in point)}], rest: {_short(REST * period)}, "
        f"window: {_short(WINDOW * way)}}}"
        for point in points
    ]
    sides = zip(end_effector.coordinates, *box(points), strict=True)
    room = ", ".join(f"{axis}: [{_short(low, 3)}, {_short(high, 3)}]" for axis, low, high in sides)
    rigid, elastic = _drives(mechanism, gears, period)
    weak = too_weak(mechanism, points)
    off = f"  urdf: false  # the efforts of {', '.join(weak)} there cannot even hold the weight" if weak else ""
    return "\n".join([
        f"# A first task for '{mechanism.name}'. Drives are GUESSED from the mass that they move: put your own in.",
        f"name: {mechanism.name}",
        "cycle:",
        f"  period: {period}  # [s]",
        f"  points:  # {end_effector.frame}: {', '.join(end_effector.coordinates)} [m, rad]; rest [s], window [m, rad]",
        *cycle,
        "limits:",
        f"  end_effector: {{position: {{{room}}}}}  # [m, rad]; keeps clear of singularities",
        *([off] if off else []),
        "setups:  # the first one is the reference",
        "  - name: rigid",
        "    mechanism: .  # the folder of this file",
        "    drives:  # at the output side of the gear, or the motor's own with gear_ratio: inertia [kg m^2, kg],",
        "      # friction [N m s/rad, N s/m], copper loss R/k_m^2 [W/(N m)^2, W/N^2]",
        *rigid,
        "  - name: elastic",
        "    mechanism: .",
        "    drives:  # stiffness [N m/rad, N/m]: a number, or bounds in which it is optimised",
        *elastic,
        "options: {starts: 4}  # more starts find better optima; 12 is the default",
        "",
    ])  # fmt: skip


def operating_points(mechanism: Mechanism) -> list[np.ndarray]:
    """Two points on both sides of the seed, with a straight way between them that keeps clear of singularities.

    Raises
    ------
    InputError : the seed is too close to a border or a singularity.
    """
    start, most = (
        mechanism.end_effector(mechanism.seed),
        np.array([MOST[unit] for unit in mechanism.end_effector_units]),
    )
    way = [np.array([reach(mechanism, sign * axis) for axis in np.eye(start.size)]) for sign in (-1, 1)]
    sides = [sign * np.minimum(along, most) for sign, along in zip((-1, 1), way, strict=True)]
    for share in SHARES:
        points = [np.array([float(_short(x, 3)) for x in start + share * side]) for side in sides]
        if _is_clear(mechanism, points):
            return points
    raise InputError(
        "The seed is too close to a singularity or to the border of the workspace for a task around it.",
        "Give another 'seed' in mechanism.yaml.",
        file=mechanism.description.origin.sidecar,
        key="seed",
    )


def box(points: list[np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Lower and upper corner of the room that the end effector may use: around the points, and somewhat more."""
    low, high = np.minimum(*points), np.maximum(*points)
    room = ROOM * max(high - low)
    return low - room, high + room


def _is_clear(mechanism: Mechanism, points: list[np.ndarray]) -> bool:
    """Whether the way between the points, and the corners of the room around them, keep clear of singularities."""
    least = KEEP * np.array(mechanism.singularity(mechanism.seed))
    lower, upper = mechanism.model.lowerPositionLimit, mechanism.model.upperPositionLimit
    corners = [np.array(corner) for corner in product(*zip(*box(points), strict=True))]
    way = [points[0] + s * (points[1] - points[0]) for s in np.linspace(0, 1, STEPS)]
    for point in (*corners, *way):
        try:
            q = mechanism.configuration(point)
        except Unreachable:
            return False
        if np.any(q < lower) or np.any(q > upper) or np.any(mechanism.singularity(q) < least):
            return False
    return bool(np.any(points[1] != points[0]))


def period_of(mechanism: Mechanism, points: list[np.ndarray]) -> float:
    """PERIOD, or the longer one in which a harmonic motion between the points, s = (1 - cos wt) / 2, has USED what the
    joints allow of velocities and efforts [s]; those that drives take for themselves are not counted.
    """
    s, q = np.linspace(0, 1, STEPS)[:, None], _way(mechanism, points)
    slope = np.gradient(q, s.ravel(), axis=0)
    v = slope * np.sqrt(s * (1 - s))  # for w = 1
    a = np.gradient(slope, s.ravel(), axis=0) * s * (1 - s) + slope * (1 - 2 * s) / 2
    largest = np.array([joint.velocity for joint in mechanism.limits])
    w = [float((USED * largest / np.maximum(np.abs(v).max(axis=0), TINY)).min())]
    effort, own = np.array([mechanism.limits[i].effort for i in mechanism.actuated]), mechanism.independent
    for pose, speed, acceleration in zip(q, v[:, own], a[:, own], strict=True):
        still = mechanism.bias(pose, np.zeros(len(own)))
        moved = mechanism.mass_matrix(pose) @ acceleration + mechanism.bias(pose, speed) - still
        held, carried = (_shared(mechanism, pose, load) for load in (still, moved))
        left = np.where(effort > held, USED * (effort - held), np.inf)  # where it cannot even be held, no period helps
        w.append(float(np.sqrt((left / np.maximum(carried, TINY)).min())))
    return max(PERIOD, float(_short(1.05 * 2 * np.pi / min(w) / (1 - 2 * REST))))


def too_weak(mechanism: Mechanism, points: list[np.ndarray]) -> list[str]:
    """Actuated joints whose effort in the tree cannot hold the weight on the straight way between the points."""
    still = np.zeros(len(mechanism.independent))
    held = [_shared(mechanism, q, mechanism.bias(q, still)) for q in _way(mechanism, points)]
    names = zip(mechanism.description.actuated, mechanism.actuated, np.max(held, axis=0), strict=True)
    return [name for name, joint, load in names if load > mechanism.limits[joint].effort]


def _way(mechanism: Mechanism, points: list[np.ndarray]) -> np.ndarray:
    """Poses on the straight way between the points (STEPS, n)."""
    return np.array([mechanism.configuration(x) for x in np.linspace(points[0], points[1], STEPS)])


def _shared(mechanism: Mechanism, q: np.ndarray, load: np.ndarray) -> np.ndarray:
    """What each drive bears of a generalised load, at least in sum of squares."""
    return np.asarray(np.abs(np.linalg.pinv(mechanism.actuation_jacobian(q).T) @ load))


def _drives(mechanism: Mechanism, gears: Mapping[str, transmission.Gear], period: float) -> tuple[list[str], list[str]]:
    """One line per drive, rigid and elastic, scaled by the inertia that the drive feels: 1 / (H_A M^-1 H_A^T)_ii.

    Of a drive with a gear N, inertia and friction are the motor's, those at the output over N^2, and so is the copper
    loss, times N^2.
    """
    H_A, M = mechanism.actuation_jacobian(mechanism.seed), mechanism.mass_matrix(mechanism.seed)
    felt = 1 / np.diag(H_A @ np.linalg.solve(M, H_A.T))
    w = 2 * np.pi / period
    lines: tuple[list[str], list[str]] = ([], [])
    for joint, inertia in zip(mechanism.description.actuated, felt, strict=True):
        gear = gears.get(joint, transmission.Gear(1.0, 0.0))
        N = abs(gear.reduction) or 1.0
        rotor, loss = gear.rotor or ROTOR * inertia / N**2, LOSS * N**2 / (inertia * w)
        friction = FRICTION * inertia * w / N**2
        same = f"inertia: {_short(rotor)}, friction: {_short(friction)}, copper_loss: {_short(loss)}"
        same += "" if gear.plain else f", gear_ratio: {_short(N, 6)}"
        bounds = f"[{_short(SOFT * inertia * w**2)}, {_short(STIFF * inertia * w**2)}]"
        lines[0].append(f"      - {{kind: rigid, {same}}}  # {joint}")
        lines[1].append(f"      - {{kind: sea, {same}, stiffness: {{bounds: {bounds}}}}}  # {joint}")
    return lines


def _short(value: float, digits: int = 2) -> str:
    """A number with few digits that YAML reads as one: 1.0e-05 rather than 1e-05."""
    text = repr(float(f"{value:.{digits}g}") + 0.0)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text
