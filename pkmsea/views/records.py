"""What is printed, as plain data for --json; what is verified comes first, what has failed last."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict
from typing import Any, TypeVar

import numpy as np

from pkmsea.actuation.cost import ENERGY, Cost
from pkmsea.errors import Infeasible, SolveError
from pkmsea.mechanism.closed_tree import TURN
from pkmsea.paper import Row
from pkmsea.solution import Solution
from pkmsea.verification import Verification

T = TypeVar("T")


def ranked(results: Iterable[T], verified: Callable[[T], bool]) -> list[T]:
    """The same order, but what is not verified comes last."""
    return sorted(results, key=lambda result: not verified(result))


def relative(solution: Solution, reference: Solution | None) -> float | None:
    """Value of the cost over that of the reference; None where that one has failed."""
    return None if reference is None else solution.value / reference.value


def solutions(
    solved: Iterable[Solution], reference: Solution | None, failures: Mapping[str, SolveError]
) -> list[dict[str, Any]]:
    """The setups of a task."""
    first_verified = ranked(solved, lambda s: s.verified)
    cost = first_verified[0].cost if first_verified else ENERGY
    found = [solution_record(s, reference) for s in first_verified]
    return found + [_failure(error, cost, setup=name) for name, error in failures.items()]


def rows(found: Sequence[Row], failures: Mapping[tuple[int, str, str], SolveError]) -> list[dict[str, Any]]:
    """The paper's rows, table by table."""
    best_first = sorted(found, key=lambda row: (row.table, not row.solution.verified))
    failed = [
        _failure(error, table=number, reading=reading, setup=name)
        for (number, reading, name), error in failures.items()
    ]
    return [row.record() for row in best_first] + failed


def verifications(found: Mapping[str, Verification], failures: Mapping[str, SolveError]) -> list[dict[str, Any]]:
    """Verifications by the name of the result."""
    checked = [
        {"result": name, "status": v.status, "verified": v.verified, **_plain(v)}
        for name, v in ranked(found.items(), lambda item: item[1].verified)
    ]
    return checked + [_failure(error, result=name) for name, error in failures.items()]


def solution_record(solution: Solution, reference: Solution | None) -> dict[str, Any]:
    """One solution; `ratio` is relative to the first setup, null where that one has failed."""
    audit, optimality, series = solution.audit(), solution.optimality(), solution.series
    joints = solution.problem.mechanism.joints
    return {
        "setup": solution.name,
        "energy": solution.energy,
        solution.cost.name: solution.value,
        "claimed": solution.claimed,
        "ratio": relative(solution, reference),
        "reference_verified": None if reference is None else reference.verified,
        "stiffness": [float(c) for c in solution.stiffness],
        "parallel": [{"stiffness": float(k), "rest": float(rest)} for k, rest in parallel_springs(solution)],
        "status": solution.status,
        "verified": solution.verified,
        "gap": audit.gap,
        "power_balance": audit.balance,
        "closure": audit.closure,
        "binding": list(audit.binding),
        "turns": {name: gain / TURN for name, gain in zip(joints, series.gain.tolist(), strict=True) if gain},
        "optimality": optimality and asdict(optimality),
        "meshes": [vars(mesh) for mesh in solution.meshes],
        "optima": [asdict(optimum) for optimum in solution.optima],
        "starts": len(solution.starts),
        "unusable_starts": sum(not start.usable for start in solution.starts),
        "seconds": solution.seconds,
    }


def _plain(found: Verification) -> dict[str, Any]:
    """A verification with its values under the name of their cost."""
    fields = {key: value for key, value in asdict(found).items() if key != "cost"}
    return {found.cost.name if key == "value" else key: value for key, value in fields.items()}


def failure_status(error: SolveError) -> str:
    """In place of a result's status."""
    return f"failed: {error.cause}"


def parallel_springs(solution: Solution) -> np.ndarray:
    """Stiffness and rest position of each parallel spring, (springs, 2)."""
    found = solution.motion.parallel
    return np.asarray(found[~np.isnan(found[:, 0])])


def _failure(error: SolveError, cost: Cost = ENERGY, **what: Any) -> dict[str, Any]:
    contending = error.contention if isinstance(error, Infeasible) else None
    found = {**what, cost.name: None, "ratio": None, "status": failure_status(error), "verified": False}
    return found | ({"contention": asdict(contending)} if contending else {})
