"""Solve one setup with rigid drives and one with springs, print both, and save the elastic one with its playback page.

Run it from anywhere: python examples/first_cycle.py
"""

from pathlib import Path

import pkmsea
from pkmsea.views.playback import write_page

TASK = Path(__file__).parent / "tasks" / "pkm_rigid_and_elastic_mixed.yaml"
OUT = Path("results")


def main() -> None:
    task = pkmsea.load_task(TASK).with_starts(4)
    rigid = pkmsea.solve(task, "both rigid")
    elastic = pkmsea.solve(task, "both elastic")

    print(f"rigid    {rigid.energy:.4f} J, {rigid.status}")
    print(f"elastic  {elastic.energy:.4f} J, {elastic.status}")
    print(f"springs  {elastic.stiffness.round(4)} N m/rad")
    print(f"energy   {elastic.energy / rigid.energy:.1%} of rigid")
    print(f"wrote    {elastic.save(OUT / 'first_cycle.nc')}, {write_page(elastic, OUT / 'first_cycle.html')}")


if __name__ == "__main__":
    main()
