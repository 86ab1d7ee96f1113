"""How many seeded random starts end in a verified local optimum, for the twelve setups of tables 2 to 4.

python examples/benchmarks/starts.py -o results/starts    (--starts 100; about a quarter of an hour on two cores)

Every start goes through everything that `pkmsea solve` does with the best ones: screening, sharpening, refinement until
claimed and true energy and two meshes agree. starts.json is replaced after every setup; starts.md is the table.
"""

from __future__ import annotations

import argparse
import json
import statistics
import time
from collections import Counter
from itertools import product
from pathlib import Path
from typing import Any

from ours import NUMBERS

from pkmsea.paper.readings import paper_task
from pkmsea.problem import build_problem
from pkmsea.solution.refine import refine
from pkmsea.solver.multistart import finish, run_start
from pkmsea.solver.spread import collect, spread
from pkmsea.transcription import Transcription, transcribe

SETUPS = ("PKM RD", "PKM SEA", "RAPKM RD", "RAPKM SEA")


def one(transcription: Transcription, index: int) -> dict[str, Any]:
    """A start's end: verified, or how it failed; its true energy [J] and its time [s]."""
    begin = time.perf_counter()
    start = run_start(transcription, index)
    if start.usable:
        start = finish(transcription, start)
    found = refine(transcription, start) if start.usable else None
    end = start.outcome.value if found is None else "not verified"
    energy = None if found is None else found.audit.value
    if found is not None and found.verified:
        end = f"verified, {found.meshes[-1].outcome}"
    return {"end": end, "energy": energy, "seconds": time.perf_counter() - begin}


def summary(records: list[dict[str, Any]]) -> dict[str, Any]:
    """Ends counted; least and median energy of the verified ones [J]; median and longest time [s]."""
    energies = [record["energy"] for record in records if record["end"].startswith("verified")]
    seconds = [record["seconds"] for record in records]
    return {
        "starts": len(records),
        "verified": len(energies),
        "ends": dict(Counter(record["end"] for record in records)),
        "least": min(energies, default=None),
        "median": statistics.median(energies) if energies else None,
        "seconds": statistics.median(seconds),
        "longest": max(seconds),
    }


def table_of(results: list[dict[str, Any]]) -> str:
    """Markdown."""
    lines = ["| table | setup | verified | least [J] | median [J] | median time [s] | longest [s] | other ends |",
             "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    for r in results:
        others = ", ".join(f"{n} {end}" for end, n in r["ends"].items() if end != "verified, optimal") or "-"
        energies = " | ".join("-" if r[key] is None else f"{r[key]:.4f}" for key in ("least", "median"))
        lines.append(
            f"| {r['table']} | {r['setup']} | {r['verified']} of {r['starts']} | {energies} "
            f"| {r['seconds']:.2f} | {r['longest']:.1f} | {others} |"
        )
    return "\n".join(lines) + "\n"


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--starts", type=int, default=100)
    parser.add_argument("--tables", type=int, nargs="+", default=sorted(NUMBERS), choices=sorted(NUMBERS))
    parser.add_argument("--setups", nargs="+", default=SETUPS, choices=SETUPS)
    parser.add_argument("-o", "--out", type=Path, default=Path("results/starts"), help="folder for the results")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    results = []
    for table, setup in product(asked.tables, asked.setups):
        transcription = transcribe(build_problem(paper_task(table, NUMBERS[table]), setup))
        records, interrupted = collect(spread(transcription, None, [(one, index) for index in range(asked.starts)]))
        if interrupted:
            break
        results.append({"table": table, "setup": setup, **summary(records)})
        for name, text in (("starts.json", json.dumps(results, indent=1)), ("starts.md", table_of(results))):
            partial = asked.out / f"{name}.part"
            partial.write_text(text, encoding="utf-8")
            partial.replace(asked.out / name)
        print(table_of(results).splitlines()[-1], flush=True)


if __name__ == "__main__":
    main()
