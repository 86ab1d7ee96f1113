"""Tables and progress on the terminal."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rich import box
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn, TimeElapsedColumn
from rich.table import Table

from pkmsea.actuation.cost import ENERGY, Cost
from pkmsea.errors import SolveError
from pkmsea.mechanism import Mechanism
from pkmsea.mechanism.workspace import reach
from pkmsea.paper import Row
from pkmsea.solution import Solution
from pkmsea.solver import Optimality, Start
from pkmsea.verification import Verification
from pkmsea.views.records import failure_status, parallel_springs, ranked, relative

PIPED_WIDTH = 160  # columns where there is no terminal


def console() -> Console:
    plain: dict[str, Any] = {"markup": False, "emoji": False}  # names are text, whatever brackets they have
    return Console(**plain) if sys.stdout.isatty() else Console(width=PIPED_WIDTH, color_system=None, **plain)


class Report:
    """Progress of multi-starts: one bar per setup."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars
        self._tasks: dict[str, TaskID] = {}
        self._best: dict[str, float] = {}

    def __call__(self, name: str, count: int, cost: Cost = ENERGY) -> Callable[[Start], None]:
        if name not in self._tasks:
            self._tasks[name] = self._bars.add_task(name, total=count, best="")
            self._best[name] = np.inf

        def advance(start: Start) -> None:
            self._best[name] = min(self._best[name], start.claimed)
            best = f"best {cost.show(self._best[name])}" if np.isfinite(self._best[name]) else ""
            self._bars.update(self._tasks[name], advance=1, best=best)

        return advance

    def note(self, text: str) -> None:
        self._bars.console.print(text)


@contextmanager
def progress(quiet: bool = False) -> Iterator[Report]:
    """Bars on a terminal's standard error; silent when piped or asked to be quiet."""
    where = Console(stderr=True, quiet=quiet or not sys.stderr.isatty())
    columns = (
        TextColumn("{task.description}", markup=False), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn(),
        TextColumn("{task.fields[best]}"),
    )  # fmt: skip
    with Progress(*columns, console=where, disable=where.quiet) as bars:
        yield Report(bars)


def print_solutions(
    solutions: Sequence[Solution], reference: Solution | None, failures: Mapping[str, SolveError]
) -> None:
    """Setups side by side, the first one is the reference; what is not verified comes behind, what failed last."""
    doubtful = reference is not None and not reference.verified
    caption = f"* relative to '{reference.name}', which is not verified" if reference and doubtful else None
    cost = solutions[0].cost
    true, claimed = (f"{cost.symbol} {what} [{cost.unit}]" for what in ("true", "claimed"))
    table = Table(title=solutions[0].problem.title, box=box.SIMPLE_HEAD, caption=caption, caption_justify="left")
    for name, justify in (
        ("setup", "left"), (true, "right"), (claimed, "right"), ("relative", "right"),
        ("stiffness [N m/rad, N/m]", "left"), ("limits reached", "left"), ("optima", "left"), ("time [s]", "right"),
        ("status", "left"),
    ):  # fmt: skip
        table.add_column(name, justify=justify)  # type: ignore[arg-type]
    for s in ranked(solutions, lambda s: s.verified):
        table.add_row(
            s.name, f"{s.value:.4g}", f"{s.claimed:.4g}", _ratio(relative(s, reference), doubtful), _all_springs(s),
            "\n".join(s.audit().binding) or "-", _optima(s), f"{s.seconds:.1f}", s.status,
        )  # fmt: skip
    for name, error in failures.items():
        table.add_row(name, *"-------", failure_status(error))
    out = console()
    out.print(table)
    for s in solutions:
        if s.turns:
            out.print(f"{s.name}: joint {', '.join(s.turns.values())} per cycle")


def print_verifications(found: Mapping[str, Verification], failures: Mapping[str, SolveError]) -> None:
    """Results side by side, those not verified behind, and under the table what speaks against them."""
    caption = "end effector, motors, loops: largest deviations [m, rad]"
    table = Table(title="forward simulation", box=box.SIMPLE_HEAD, caption=caption, caption_justify="left")
    costs = {v.cost: None for v in found.values()} or {ENERGY: None}
    E, unit = (" or ".join(getattr(cost, key) for cost in costs) for key in ("symbol", "unit"))
    values = f"{E} [{unit}]", f"{E} simulated [{unit}]"
    for heading in (
        "result", *values, "gap", "end effector", "motors", "loops", "balance",
        "feedback", "singularity", "KKT", "optimum", "status",
    ):  # fmt: skip
        table.add_column(heading, justify="left" if heading in ("result", "optimum", "status") else "right")
    for name, v in ranked(found.items(), lambda item: item[1].verified):
        table.add_row(
            _short_path(name), f"{v.value:.5g}", f"{v.simulated:.5g}", f"{v.gap:.0e}", f"{v.end_effector:.0e}",
            f"{v.motors:.0e}", f"{v.closure:.0e}", f"{v.balance:.0e}", f"{v.feedback:.0e}",
            f"{min(v.inverse, v.direct):.3f}", *_optimality(v.optimality), "verified" if v.verified else "not verified",
        )  # fmt: skip
    for name in failures:
        table.add_row(_short_path(name), *"-----------", "failed")
    out = console()
    out.print(table)
    for name, v in found.items():
        if v.status != "verified":
            out.print(f"{name}: {v.status}", markup=False)


def print_rows(rows: Sequence[Row], failures: Mapping[tuple[int, str, str], SolveError]) -> None:
    """The paper's tables, and under each of its rows ours in each reading; what failed comes at the end."""
    out = console()
    for number in sorted({row.table for row in rows}):
        chosen = [row for row in rows if row.table == number]
        calibrated = {
            row.reading: ", ".join(f"{key} {value:.4g}" for key, value in row.assumed.items()) for row in chosen
        }
        told = "; ".join(f"{reading} {numbers}" for reading, numbers in calibrated.items())
        table = Table(
            title=f"Table {number}: {chosen[0].title}", caption=f"calibrated: {told}; assumed: see assumed.yaml",
            box=box.SIMPLE_HEAD, title_justify="left", caption_justify="left",
        )  # fmt: skip
        for name in ("setup", "", "E [J]", "ratio", "at its springs", "stiffness", "status", "remark"):
            table.add_column(name, justify="right" if name in ("E [J]", "ratio", "at its springs") else "left")
        for setup in dict.fromkeys(row.setup for row in ranked(chosen, lambda row: row.solution.verified)):
            of_setup = [row for row in chosen if row.setup == setup]
            paper = of_setup[0]
            if paper.paper_energy is not None:
                table.add_row(
                    setup, "paper", f"{paper.paper_energy:.3g}", _or_dash(paper.paper_ratio, ".1%"), "",
                    _springs(paper.paper_stiffness),
                )  # fmt: skip
            for row in of_setup:
                s = row.solution
                table.add_row(
                    "" if row.paper_energy is not None or row is not paper else setup, row.reading, f"{s.energy:.4g}",
                    _ratio(row.ratio, row.reference_verified is False), _or_dash(row.ratio_at_paper, ".1%"),
                    _springs(s.stiffness), s.status, row.remark,
                )  # fmt: skip
            table.add_section()
        for (of, reading, name), error in failures.items():
            if of == number:
                table.add_row(name, reading, *"----", failure_status(error), "")
        out.print(table)


def mechanism_record(mechanism: Mechanism) -> dict[str, Any]:
    """What `check` tells, as plain data."""
    inverse, direct = mechanism.singularity(mechanism.seed)
    start = mechanism.end_effector(mechanism.seed).round(9) + 0.0
    along = {}
    for axis, direction in zip(mechanism.description.end_effector.coordinates, np.eye(start.size), strict=True):
        ends = [float(start @ direction) + sign * reach(mechanism, sign * direction) for sign in (-1, 1)]
        along[axis] = [round(end, 3) + 0.0 for end in ends]
    return {
        "mechanism": mechanism.name,
        "joints": mechanism.joints,
        "mobility": mechanism.mobility,
        "actuated": list(mechanism.description.actuated),
        "independent": list(mechanism.description.independent),
        "actuation_class": mechanism.actuation_class,
        "closures": [closure.label for closure in mechanism.description.closures],
        "couplings": [coupling.label for coupling in mechanism.description.couplings],
        "locked": dict(mechanism.description.locked),
        "conditioning": mechanism.conditioning,
        "conventions": list(mechanism.description.origin.conventions),
        "proposed": list(mechanism.description.origin.proposed),
        "notes": list(mechanism.description.notes),
        "closure_residual": float(np.abs(mechanism.closure_residual(mechanism.seed)).max(initial=0.0)),
        "seed": dict(zip(mechanism.joints, (mechanism.seed.round(6) + 0.0).tolist(), strict=True)),
        "end_effector": (start.round(6) + 0.0).tolist(),
        "end_effector_units": mechanism.end_effector_units,
        "H_A": mechanism.actuation_jacobian(mechanism.seed).round(6).tolist(),
        "singularity": {"inverse": inverse, "direct": direct},
        "workspace": along,
    }


def print_mechanism(mechanism: Mechanism, record: dict[str, Any]) -> None:
    """The record of a mechanism as a table."""
    table = Table(title=mechanism.name, box=box.SIMPLE_HEAD, show_header=False, title_justify="left")
    table.add_column(style="bold")
    table.add_column()
    follower, units = mechanism.description.end_effector, record["end_effector_units"]
    at = ", ".join(f"{x:.4g} {unit}" for x, unit in zip(record["end_effector"], units, strict=True))
    closures = ", ".join(record["closures"])
    drives = ", ".join(record["actuated"])
    matrix = "\n".join("  ".join(f"{x:9.4f}" for x in row) for row in record["H_A"])
    reached = "; ".join(
        f"{axis} from {low:g} to {high:g} {unit}"
        for (axis, (low, high)), unit in zip(record["workspace"].items(), units, strict=True)
    )
    lines = {
        "mobility": f"{record['mobility']} ({record['actuation_class']}: {len(record['actuated'])} drives)",
        "joints": ", ".join(record["joints"]),
        "closures": f"{closures} (residual {record['closure_residual']:.1e} m, rad)" if closures else "none",
        "couplings": ", ".join(record["couplings"]),
        "locked": ", ".join(f"{k} at {v:.4g}" for k, v in record["locked"].items()),
        "drives": drives,
        "independent": f"{', '.join(record['independent'])} (conditioning {record['conditioning']:.2g})",
        "seed pose": ", ".join(f"{k} {v:.4g}" for k, v in record["seed"].items()),
        "end effector": f"{follower.frame} ({', '.join(follower.coordinates)}) at {at}",
        "H_A at the seed": matrix,
        "singularity distance": f"inverse {record['singularity']['inverse']:.3f}, "
        f"direct {record['singularity']['direct']:.3f} (0 is singular, 1 the most)",
        "workspace from seed": reached,
        "read from": ", ".join(record["conventions"]),
        "proposed": ", ".join(record["proposed"]),
        "notes": "\n".join(record["notes"]),
    }  # fmt: skip
    for key, value in lines.items():
        if value:
            table.add_row(key, value)
    console().print(table)


def _short_path(name: str) -> str:
    """The last folder and the file."""
    return "/".join(Path(name).parts[-2:])


def _all_springs(solution: Solution) -> str:
    """Stiffnesses in series; those in parallel with their rest positions [rad, m]."""
    beside = "; ".join(f"{k:.3g} at {rest:.3g}" for k, rest in parallel_springs(solution))
    return f"{_springs(solution.stiffness)} | parallel {beside}" if beside else _springs(solution.stiffness)


def _springs(stiffness: Any) -> str:
    return ", ".join(f"{c:.3g}" for c in stiffness) or "-"


def _ratio(value: float | None, doubtful: bool) -> str:
    """With a star where the reference is not verified."""
    return _or_dash(value, ".1%") + ("*" if doubtful else "")


def _optima(solution: Solution) -> str:
    """'3, best 5x of 12 starts': distinct optima, and how many starts found the best."""
    optima = solution.optima
    found = f"{len(optima)}, best {optima[0].count}x" if optima else "none"
    return f"{found} of {len(solution.starts)} starts"


def _optimality(found: Optimality | None) -> tuple[str, str]:
    """KKT residual, and the kind of the optimum."""
    if found is None:
        return "-", "not available"
    kind = f"{found.kind} ({found.negative} negative)" if found.negative else found.kind
    return f"{found.error:.0e}", kind if found.stationary else "not stationary"


def _or_dash(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)
