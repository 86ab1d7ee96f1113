"""One case of the benchmark in a process of its own: its record goes to standard output as one line of JSON.

Run by benchmark.py: python case.py '{"kind": "flat", "table": 3, ...}'.
"""

from __future__ import annotations

import json
import resource
import sys
import time
from typing import Any

import numpy as np
import ours

SETUP = "PKM SEA"
KILO = 1024.0 if sys.platform == "darwin" else 1.0  # ru_maxrss is in bytes there, in kB elsewhere
NEIGHBOUR = 1.05  # factor between the stiffnesses of two neighbours in a sweep


def peak_memory() -> float:
    """Peak resident memory of this process [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / KILO / 1024


def flat(case: dict[str, Any]) -> dict[str, Any]:
    """Several starts of a setup with one transcription, ours or (`kind` paper) the paper's.

    The paper's derivatives are made by CasADi at the start of a solve; that counts as building, as for rockit.
    """
    make = ours.paper_options if case["kind"] == "paper" else ours.flat_options
    posed = ours.problem(case["table"], case["setup"], make(case["samples"], case["iterations"], case["limit"]))
    begin = time.perf_counter()
    transcription = ours.transcribe(posed)
    build = time.perf_counter() - begin
    runs, ends = [], []
    for index in range(case["starts"]):
        record, x = ours.solve(transcription, ours.start(transcription, index))
        if case["kind"] == "paper":
            build += record["seconds"] - record["solver_seconds"]
            record["seconds"] = record["solver_seconds"]
        runs.append({"start": index} | record)
        ends.append(x)
    memory = peak_memory()
    for record, x in zip(runs, ends, strict=True):
        record |= ours.truth(posed, transcription.motion(x), record["claimed"])
    return {"samples": transcription.samples, "build_seconds": build, "memory_MB": memory, "runs": runs}


def neighbours(case: dict[str, Any]) -> dict[str, Any]:
    """Fixed stiffness: cold, and warm from the solution at a stiffness NEIGHBOUR times as small."""
    options = ours.flat_options(case["samples"], case["iterations"], case["limit"])
    posed = ours.problem(case["table"], case["setup"], options, tuple(case["stiffness"]))
    before = ours.transcribe(posed)
    _, x = ours.solve(before, ours.start(before, 0))
    after = ours.transcribe(
        ours.problem(case["table"], case["setup"], options, tuple(NEIGHBOUR * c for c in case["stiffness"]))
    )
    cold, _ = ours.solve(after, ours.start(after, 0))
    springs = len(case["stiffness"])
    moved = x.copy()
    moved[-springs:] += np.log(NEIGHBOUR)
    warm, _ = ours.solve(after, moved, last_step=True)
    return {"samples": after.samples, "memory_MB": peak_memory(), "cold": cold, "warm": warm}


def rockit(case: dict[str, Any]) -> dict[str, Any]:
    """One formulation of the rockit baseline, from our plain start."""
    from baseline_rockit import Baseline
    from solve_rockit import disagreement, solve

    options = ours.flat_options(case["samples"], case["iterations"], case["limit"])
    posed = ours.problem(case["table"], SETUP, options)
    transcription = ours.transcribe(posed)
    x = ours.start(transcription, 0)
    guess = transcription.motion(x)
    _, best = ours.solve(transcription, x)
    lifted = case["formulation"] == "lifted"
    baseline = Baseline(posed, guess, case["samples"], lifted)
    ipopt = {
        "max_iter": case["iterations"],
        "max_wall_time": case["limit"],
        "tol": options.tolerance,
        "acceptable_tol": 10 * options.tolerance,
        "acceptable_iter": 10,
        "mu_strategy": "monotone",  # the better one here
        "print_level": 0,
        "sb": "yes",
    }
    record, motion = solve(baseline, lifted, ipopt)
    memory = peak_memory()
    record |= ours.truth(posed, motion, record["claimed"])
    model = disagreement(posed, transcription.motion(best))
    return {"samples": case["samples"], "build_seconds": record.pop("build_seconds"), "memory_MB": memory,
            "model_disagreement": model, "runs": [record]}  # fmt: skip


KINDS = {"flat": flat, "paper": flat, "neighbours": neighbours, "rockit": rockit}

if __name__ == "__main__":
    asked = json.loads(sys.argv[1])
    print(json.dumps(KINDS[asked["kind"]](asked)))
