"""Imports only point upstream along the way of the data."""

import ast
from pathlib import Path

import pkmsea

ORDER = (
    "errors", "files", "ending", "bridge", "kernels", "mechanism", "actuation", "task", "problem", "transcription",
    "solver", "solution", "verification", "study", "paper", "new", "views", "cli",
)  # fmt: skip
ROOT = Path(pkmsea.__file__).parent
FREE = {"__init__", "__main__"}  # the package's front doors


def test_imports_point_upstream() -> None:
    wrong = []
    for path in ROOT.rglob("*.py"):
        here = path.relative_to(ROOT).parts[0].removesuffix(".py")
        if here in FREE:
            continue
        for node in ast.walk(ast.parse(path.read_text())):
            if not isinstance(node, ast.ImportFrom) or not (node.module or "").startswith("pkmsea."):
                continue
            there = (node.module or "").split(".")[1]
            if ORDER.index(there) > ORDER.index(here):
                wrong.append(f"{path.relative_to(ROOT)} imports {node.module}")
    assert not wrong, wrong


def test_a_problem_knows_no_file() -> None:
    """Files and tasks become problems in `build` alone."""
    tree = ast.parse((ROOT / "problem" / "problem.py").read_text())
    names = {name.name for node in ast.walk(tree) if isinstance(node, ast.ImportFrom) for name in node.names}
    assert not names & {"Path", "Task", "Setup", "read", "load_task", "load_mechanism"}


def test_only_the_solver_knows_ipopt() -> None:
    knowing = [p for p in ROOT.rglob("*.py") if "nlpsol" in p.read_text()]
    assert [p.relative_to(ROOT).as_posix() for p in knowing] == ["solver/ipopt.py"]


def test_modules_stay_small() -> None:
    long = {p.name: n for p in ROOT.rglob("*.py") if (n := p.read_text().count("\n")) > 300}
    assert not long
