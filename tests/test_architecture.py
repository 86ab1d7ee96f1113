"""Imports only point upstream along the way of the data, and no module reaches itself by them."""

from __future__ import annotations

import ast
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path

import pytest

import pkmsea

ORDER = (
    "errors", "files", "ending", "bridge", "kernels", "description", "mechanism", "actuation", "task", "problem",
    "motion", "transcription",
    "solver", "solution", "verification", "study", "paper", "new", "views", "cli",
)  # fmt: skip
ROOT = Path(pkmsea.__file__).parent
FREE = {"pkmsea", "pkmsea.__main__"}  # the package's front doors


def modules(root: Path) -> dict[str, Path]:
    """Every module of a package by its dotted name."""
    found = {}
    for path in root.rglob("*.py"):
        parts = path.relative_to(root.parent).with_suffix("").parts
        found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(name: str, path: Path, known: Mapping[str, Path]) -> Iterator[str]:
    """The modules of the package that a module names in any import: at the top, in functions, for types alone."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*above, *([node.module] if node.module else [])])
            inside = [f"{base}.{alias.name}" for alias in node.names]
            yield from (inner for inner in inside if inner in known)
            if base in known and not all(inner in known for inner in inside):
                yield base


def graph(root: Path) -> dict[str, set[str]]:
    known = modules(root)
    return {name: set(imports(name, path, known)) - {name} for name, path in known.items()}


def downstream(edges: Mapping[str, set[str]], order: tuple[str, ...], free: set[str]) -> list[str]:
    """Imports against the order of the folders."""

    def place(name: str) -> int:
        return order.index(name.split(".")[1]) if "." in name else len(order)

    return [
        f"{here} imports {there}" for here in edges.keys() - free for there in edges[here] if place(there) > place(here)
    ]


def circles(edges: Mapping[str, set[str]]) -> set[frozenset[str]]:
    """Sets of modules that reach each other."""

    def reached(start: str) -> set[str]:
        found, open_ = set[str](), [start]
        while open_:
            new = edges[open_.pop()] - found
            found |= new
            open_ += new
        return found

    far = {name: reached(name) for name in edges}
    return {frozenset({a, *(b for b in far[a] if a in far[b])}) for a in edges if a in far[a]}


def test_imports_point_upstream() -> None:
    assert downstream(graph(ROOT), ORDER, FREE) == []


def test_no_circles() -> None:
    edges = {name: there - FREE for name, there in graph(ROOT).items() if name not in FREE}
    assert not circles(edges)


@pytest.mark.parametrize(
    "line",
    [
        "import p.b.late",
        "import p.b.late as late",
        "from p.b import late",
        "from p.b.late import x",
        "from p import b",
        "from ..b import late",
        "from ..b.late import x",
        "def f():\n    from p.b import late",
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import p.b.late",
    ],
)
def test_every_form_of_import_is_seen(tmp_path: Path, line: str) -> None:
    """p/a lies upstream of p/b and p/b/late imports p/a/early: both arrow and circle are found."""
    files = {"__init__": "", "a/__init__": "", "a/early": line, "b/__init__": "from p.b import late"}
    files["b/late"] = "from p.a.early import f\nx = 1"
    for name, text in files.items():
        path = tmp_path / "p" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(textwrap.dedent(text))
    edges = graph(tmp_path / "p")
    assert [wrong.split(" imports ")[0] for wrong in downstream(edges, ("a", "b"), {"p"})] == ["p.a.early"]
    (circle,) = circles(edges)
    assert {"p.a.early", "p.b.late"} <= circle


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
