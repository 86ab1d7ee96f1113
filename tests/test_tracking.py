"""The tracking example, reduced to one start and one cycle."""

from __future__ import annotations

from pathlib import Path

from test_examples import run

ROUNDING = 1e-2  # of the printed numbers, which have three digits


def test_tracking(tmp_path: Path) -> None:
    """As modelled every law follows the plan; on the wrong plant the flatness-based one is by far the best."""
    printed = run("tracking/tracking.py", tmp_path, "--quick", "-o", str(tmp_path))
    head, _, *lines = [[cell.strip() for cell in line.strip("| ").split("|")] for line in printed.splitlines()]
    rows = {(plant, law): dict(zip(head[2:], map(float, cells), strict=True)) for plant, law, *cells in lines}
    largest = {key: row["largest error [mm]"] for key, row in rows.items()}
    assert max(value for (plant, _), value in largest.items() if plant == "as modelled") < 0.01
    assert largest["wrong", "flatness-based"] < 5
    assert largest["wrong", "flatness-based"] < largest["wrong", "with motor feedback"] / 5
    assert largest["wrong", "flatness-based"] < largest["wrong", "feed-forward"] / 5
    modelled = [row for (plant, _), row in rows.items() if plant == "as modelled"]
    assert all(abs(row["energy [J]"] - row["planned [J]"]) <= ROUNDING * row["planned [J]"] for row in modelled)
    tracked = rows["wrong", "flatness-based"]
    assert tracked["energy [J]"] > tracked["planned [J]"]
    assert (tmp_path / "tracking.png").stat().st_size > 0
