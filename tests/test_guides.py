"""The guides say what the code does: their blocks run and print what they show, and the files are as told."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
from guides import ROOT, WORD, alike, codes, outputs, rows, words
from typer.testing import CliRunner

from pkmsea import ending
from pkmsea.cli import app
from pkmsea.solution import netcdf

FILES = (ROOT / "examples" / "guides" / "files.md").read_text("utf-8")
LEFT = shutil.ignore_patterns("*.png", "__pycache__")


@pytest.fixture
def cycles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder beside the examples and the shipped mechanisms, as in a checkout."""
    monkeypatch.setattr(ending, "_deferring", False)  # commands defer signals to the end of their process: ours
    monkeypatch.setattr(ending, "_fresh", True)
    for name in ("examples", "urdf"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=LEFT)
    (folder := tmp_path / "cycles").mkdir()
    return folder


def follow(guide: str, folder: Path, long: bool) -> None:
    """Run a guide in a folder; what it shows is what is printed."""
    text = (ROOT / guide).read_text(encoding="utf-8")
    for block, printed in outputs(text, folder, long):
        shown = text[slice(*block.shown)] if block.shown else ""
        assert alike(shown, printed), f"{guide} shows\n{shown}\nbut this is printed:\n{printed}"


def check_result(file: Path) -> None:
    """Series and attributes of a result file, what its records hold, and its record for --json stand in the tables."""
    dataset, attributes = netcdf.read(file), rows(FILES, "Attributes; those marked JSON are JSON text:")
    assert {code for row in rows(FILES, "N m, verified\n```") for code in codes(row[:1])} == set(dataset.arrays)
    assert {code for row in attributes for code in codes(row[:1])} == set(dataset.attrs)
    for key in ("optimality", "optima", "audit", "starts", "meshes"):
        told = words(cell for row in attributes if f"`{key}`" in row[0] for cell in row)
        record = json.loads(dataset.attrs[key])
        assert set(record if isinstance(record, dict) else record[0]) <= told, key
    (shown,) = json.loads(CliRunner().invoke(app, ["show", str(file), "--json"]).stdout)
    assert {code for row in rows(FILES, "false, `energy` null.") for code in codes(row[:1])} == set(shown)


def check_feed_forward(file: Path) -> None:
    """The head of a feed-forward file stands in the text."""
    head = re.findall(r"^# (\w+):", file.read_text("utf-8"), re.M)
    section = FILES[FILES.index("## The feed-forward file") :]
    assert {key for key in head if not re.search(r"_[AB]$", key)} <= {*WORD.findall(section), "y_E"}


@pytest.mark.parametrize("long", [False, pytest.param(True, marks=pytest.mark.long)], ids=["short", "all"])
def test_first_cycle(cycles: Path, long: bool) -> None:
    """From an installation to results, which the next guides look at."""
    for name in ("start", "files", "verify"):
        follow(f"examples/guides/{name}.md", cycles, long)
    check_result(cycles / "results" / "elastic.nc")
    check_feed_forward(cycles / "results" / "elastic.csv")


@pytest.mark.parametrize("long", [False, pytest.param(True, marks=pytest.mark.long)], ids=["short", "all"])
def test_own_mechanism(cycles: Path, long: bool) -> None:
    follow("examples/guides/bring_your_own.md", cycles, long)


@pytest.mark.long
def test_study_and_readme(cycles: Path) -> None:
    follow("examples/guides/studies.md", cycles, long=True)
    follow("README.md", cycles.parent, long=True)


@pytest.mark.parametrize(
    ("shown", "printed", "same"),
    [
        ("a 0.123 J", "a   0.124 J", True),
        ("a 0.123 J", "a 0.126 J", False),
        ("0.3723   0.6   verified", "0.3723   7.1   verified", True),
        ("0.3723   0.6   verified", "0.3723   7.1   not verified: late", False),
        ("0.0919 J, verified", "0.0929 J, verified", False),
        ("residual 1.3e-14 m", "residual 5.6e-16 m", True),
        ("gap 3.1e-06", "gap 9.1e-03", False),
        ("best 4x of 4", "best 3x of 4", False),
        ("wrote a\n...\nwrote c", "wrote a\nwrote b\nwrote c", True),
        ("wrote a\n...\nwrote c", "wrote a\nwrote b", False),
        ("", "more", False),
    ],
)
def test_comparison(shown: str, printed: str, same: bool) -> None:
    assert alike(shown, printed) is same
