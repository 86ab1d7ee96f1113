"""The tables of the guides hold the keys that exist, no others, and their defaults; what is denied does not exist."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from typing import Any, get_args

import pytest
import typer
from guides import CODE, ROOT, WORD, codes, rows, words
from pydantic import BaseModel
from typer.testing import CliRunner

from pkmsea.actuation.cost import COSTS
from pkmsea.actuation.drive import Drive
from pkmsea.cli import app
from pkmsea.description.conventions import BESIDE, FORMATS, MARKS
from pkmsea.description.parts import Closure
from pkmsea.description.sidecar import Draft
from pkmsea.solver import Outcome
from pkmsea.study.expressions import CONSTANTS, FUNCTIONS
from pkmsea.study.study import COLUMNS, KEY, Calibration, Study
from pkmsea.task import Cycle, Limits, Options, Setup, Task

GUIDES = ROOT / "examples" / "guides"
FILES, STUDIES, ASSUMPTIONS = (
    (GUIDES / f"{name}.md").read_text("utf-8") for name in ("files", "studies", "assumptions")
)
TABLES: dict[str, tuple[str, type[BaseModel]]] = {  # of keys, by the line before the table
    "[bring_your_own.md](bring_your_own.md).": (FILES, Draft),
    "A closure:": (FILES, Closure),
    "## The task file": (FILES, Task),
    "`cycle`:": (FILES, Cycle),
    "`limits.end_effector` and `limits.joints`, each:": (FILES, Limits),
    "A setup:": (FILES, Setup),
    "A drive; prismatic drives take the second unit:": (FILES, Drive),
    "`options`:": (FILES, Options),
    "prints the JSON Schema.": (STUDIES, Study),
}
DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "examples").glob("*/*.md")), *sorted((ROOT / ".github").glob("*.md"))]


def models(annotation: Any) -> Iterator[type[BaseModel]]:
    """The records that a field may hold."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in get_args(annotation):
        yield from models(inner)


@pytest.mark.parametrize("before", TABLES)
def test_keys(before: str) -> None:
    """Key by key: those of the schema, those of the records in them, and the default."""
    text, model = TABLES[before]
    table: dict[str, list[list[str]]] = {}
    for row in rows(text, before):
        for key in codes(row[:1]):
            table.setdefault(re.split(r"[.\[]", key)[0], []).append(row)
    assert set(table) == set(model.model_fields)
    elsewhere = {model for _, model in TABLES.values()}
    for key, field in model.model_fields.items():
        told = words(cell for row in table[key] for cell in row) | words(
            re.findall(rf"^`{key}` is .*?\n\n", text, re.M | re.S)
        )
        for inner in set(models(field.annotation)) - elsewhere:
            assert set(inner.model_fields) <= told, key
        last = table[key][0][-1]
        assert field.is_required() == last.startswith("required") or model in (Draft, Drive), key
        if isinstance(default := field.default, int | float) and not isinstance(default, bool):
            assert default in {float(x) for x in re.findall(r"\d+(?:\.\d+)?(?:e-?\d+)?", last)}, key
        elif isinstance(default, str) and default:
            assert f"`{default}`" in last, key


def test_ranges() -> None:
    told = re.search(r"Allowed ranges: (.*?)\.\n", FILES)
    assert told is not None
    found = {key: (int(low), int(high)) for key, low, high in re.findall(r"`(\w+)` (\d+) to (\d+)", told[1])}
    fields = {**Options.model_fields}
    for inner in models(fields["trajectory"].annotation):
        fields |= inner.model_fields
    for key, limits in found.items():
        assert limits == tuple(getattr(m, a) for a in ("ge", "le") for m in fields[key].metadata if hasattr(m, a))


def test_conventions() -> None:
    told = {code for *_, label in rows(FILES, "unless they are of the same joint.") for code in codes([label])}
    assert told == {convention.LABEL for convention in (*BESIDE, *FORMATS, *MARKS)}
    tags = {tag for mark in MARKS for tag in mark.TAGS}
    assert tags <= words(FILES.splitlines()) | set(re.findall(r"<([\w:]+)", FILES))


def test_outcomes_and_costs() -> None:
    told = re.search(r"`outcome` is one of (.*?)\.\n", FILES)
    assert told is not None and CODE.findall(told[1]) == [outcome.value for outcome in Outcome]
    assert set(COSTS) <= words(row[1] for row in rows(FILES, "## The task file"))


def test_columns_of_studies() -> None:
    told = words(row[0] for row in rows(STUDIES, "sqlite3.connect(...))`):"))
    assert {*KEY, *COLUMNS} <= told
    assert told - {*KEY, *COLUMNS} == {"c_1", "c_2", "vary"}
    section = STUDIES[STUDIES.index("\n## Expressions") :].split("\n## ")[1]
    assert {*FUNCTIONS, *CONSTANTS} <= words([section])
    assert set(Calibration.model_fields) <= words([STUDIES]) | set(WORD.findall(STUDIES))


def options(command: Any) -> set[str]:
    """The long names of a command's options."""
    return {max(p.opts, key=len) for p in command.params if p.opts[0].startswith("-") and "--help" not in p.opts}


def test_commands() -> None:
    """The table of commands is that of the program; no text names a command or option that is none."""
    commands: dict[str, Any] = typer.main.get_command(app).commands  # type: ignore[attr-defined]
    table = {row[0].strip("`").split()[1]: set(codes(row[1:2])) for row in rows(FILES, "## Commands")}
    assert table == {name: options(command) for name, command in commands.items()}
    for path in DOCUMENTS:
        for name, rest in re.findall(r"(?:^\$ |`)(?:\S*/)?pkmsea ([a-z]\w*)([^`\n&|]*)", path.read_text("utf-8"), re.M):
            assert name in commands or name in ("result", "feed"), f"{path.name}: pkmsea {name}"
            known = {opt for p in commands[name].params for opt in p.opts} if name in commands else set()
            assert set(re.findall(r"(?<= )--?[a-z][\w-]*", rest)) <= known, f"{path.name}: pkmsea {name}{rest}"


def test_record_of_check() -> None:
    record = json.loads(CliRunner().invoke(app, ["check", "pkm_2rrr", "--json"]).stdout)
    keys = set(record) - {"singularity"} | {f"singularity.{key}" for key in record["singularity"]}
    assert {code for row in rows(FILES, "`check --json` prints one record:") for code in codes(row[:1])} == keys


def test_nothing_denied_exists() -> None:
    """What the guide lists as not modelled has no key in a task or mechanism."""
    denied = " ".join(row[0].lower() for row in rows(ASSUMPTIONS, "behaves otherwise than its result:"))
    keys = {key for model in (Drive, Options, Task, Draft) for key in model.model_fields}
    keys |= {"pick", "place", "effort", "cubic", "parallel"}
    assert not [key for key in keys if all(re.search(rf"\b{part}", denied) for part in key.split("_"))]
    assert not re.search(r"\b(?:no|not|refused)\b[^|.]*\b(?:cubic|coulomb|damping|gear|continuous)", ASSUMPTIONS, re.I)
