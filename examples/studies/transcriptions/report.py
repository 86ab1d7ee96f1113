"""The runs as tables."""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import numpy as np
from cases import Run

TRUTH = 0.005  # gap that pkmsea accepts
TINY = 1e-7  # [J]; a claim of nothing


def write_csv(runs: Sequence[Run], file: Path) -> None:
    """One line per run."""
    with file.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, [*asdict(runs[0]), "gap"])
        writer.writeheader()
        for run in runs:
            writer.writerow(asdict(run) | {"gap": f"{run.gap:.6f}"})


def cases(runs: Sequence[Run]) -> list[tuple[float, str]]:
    """The cases that were run, in their order."""
    return list(dict.fromkeys((run.kappa, run.drives) for run in runs))


def table(runs: Sequence[Run], titles: dict[str, str]) -> str:
    """Per case and scheme, claimed / true energy at each size as Markdown."""
    sizes = sorted({run.size for run in runs})
    lines = [
        "| case | scheme | " + " | ".join(f"N = {size}" for size in sizes) + " |",
        "|---|---|" + "---|" * len(sizes),
    ]
    for kappa, drives in cases(runs):
        name = f"κ = {kappa:g}, {drives}"
        for scheme, title in titles.items():
            found = {r.size: r for r in runs if (r.kappa, r.drives, r.scheme) == (kappa, drives, scheme)}
            lines.append(f"| {name} | {title} | " + " | ".join(cell(found[size]) for size in sizes) + " |")
            name = ""
    return "\n".join(lines) + "\n"


def summary(runs: Sequence[Run], titles: dict[str, str]) -> str:
    """Per scheme: how often it claims the truth, how far it misses it at worst, and what it takes, as Markdown."""
    lines = [
        "| scheme | converged | converged, claim within 0.5 % | largest true / claimed | unknowns | seconds, median |",
        "|---|---|---|---|---|---|",
    ]
    for scheme, title in titles.items():
        found = [run for run in runs if run.scheme == scheme]
        done = [run for run in found if run.outcome == "optimal"]
        truthful = sum(abs(run.gap) <= TRUTH for run in done)
        worst = max(run.true / max(run.claimed, TINY) for run in done)
        factor = f"{worst:.4g}" if worst < 1e5 else "claims 0 J"
        unknowns = f"{min(run.unknowns for run in found)} to {max(run.unknowns for run in found)}"
        seconds = np.median([run.seconds for run in found])
        lines.append(f"| {title} | {len(done)} of {len(found)} | {truthful} | {factor} | {unknowns} | {seconds:.1f} |")
    return "\n".join(lines) + "\n"


def cell(run: Run) -> str:
    """Claimed / true [mJ]; bold where they agree and the solve converged, starred where it did not converge."""
    text = f"{_millijoules(run.claimed)} / {_millijoules(run.true)}"
    if run.outcome != "optimal":
        return f"{text} *"
    return f"**{text}**" if abs(run.gap) <= TRUTH else text


def _millijoules(energy: float) -> str:
    value = 1e3 * energy
    return "-" if not np.isfinite(value) else f"{value:.1f}" if value < 1e4 else f"{value:.0e}"
