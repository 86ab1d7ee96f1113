"""Which transcription claims the truth? The two-arm robot of the paper, solved by six of them at four sizes.

    python examples/studies/transcriptions [--quick] [-o DIR]      (about 20 minutes on one core)

Writes transcriptions.csv, .md and .png. 'True' is the energy of the motion that a scheme's end-effector path stands
for, by the exact flat map on a dense grid. Schemes that know the path only at nodes are given the periodic spline of
degree 7 through these: a motion that satisfies the equations of motion.
"""

import argparse
from itertools import product
from pathlib import Path

from balance import EnergyBalance
from cases import DRIVES, LOSSES, SIZES, Run, make_problem, run, shared_start
from collocation import Radau
from default import Default
from exact_map import KnotSamples, Oversampled
from figure import figure
from report import summary, table, write_csv
from variational import Variational

SCHEMES = (Default, KnotSamples, EnergyBalance, Oversampled, Radau, Variational)
QUICK = ((10.0,), ("friction",), (50,))


def main() -> list[Run]:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--quick", action="store_true", help="only one case at one size")
    parser.add_argument("-o", "--out", type=Path, default=Path("results"), help="folder for table and figure")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)

    losses, drives, sizes = QUICK if asked.quick else (LOSSES, tuple(DRIVES), SIZES)
    runs = []
    for kappa, kind in product(losses, drives):
        problem = make_problem(kappa, kind)
        start = shared_start(problem)
        for scheme, size in product(SCHEMES, sizes):
            found = run(problem, kappa, kind, scheme, size, start)
            runs.append(found)
            print(
                f"kappa {kappa:<6g} {kind:<12} {scheme.__name__:<14} {size:>4}  claimed {found.claimed:.5f} J  "
                f"true {found.true:.5f} J  {found.outcome} after {found.iterations} iterations, {found.seconds:.1f} s",
                flush=True,
            )
            write_csv(runs, asked.out / "transcriptions.csv")
    titles = {scheme.__name__: scheme.title for scheme in SCHEMES}
    (asked.out / "transcriptions.md").write_text(f"{summary(runs, titles)}\n{table(runs, titles)}", encoding="utf-8")
    figure(runs, titles).savefig(asked.out / "transcriptions.png", dpi=150)
    return runs


if __name__ == "__main__":
    main()
