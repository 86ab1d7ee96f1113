"""The blocks of the guides as things that run.

In a guide, `console` blocks are commands behind `$` with what they print, `python` blocks are programs whose output is
the `text` block behind them, and a block behind "Save this as `NAME`:" is written to that file. They are run in order,
in a folder beside the examples. A second word, `long`, keeps a block out of the ordinary run. What no test runs stands
in blocks of `sh` and `py`. A line `...` stands for any lines.
"""

from __future__ import annotations

import contextlib
import io
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from typer.testing import CliRunner

from pkmsea.cli import app

ROOT = Path(__file__).parents[1]
FENCE = re.compile(r"^```(?P<language>\w+)(?P<long> long)?\n(?P<body>.*?)^```$", re.M | re.S)
SAVED = re.compile(r"[Ss]ave (?:this|it) as `([^`]+)`[^`]*:\s*\Z")
NUMBER = re.compile(r"((?<![\w.])[-−+]?\d+(?:\.\d+)?(?:[eE][-+]?\d+)?(?![\w.]*\w))")
TIME = re.compile(r"(?<=  )\d+\.\d(?= {2,}(?:verified|not verified|failed))")  # the column before the status
CODE = re.compile(r"`([^`]+)`")
WORD = re.compile(r"[A-Za-z_]\w*")
LAST_DIGITS = 2  # units of the last digit shown by which numbers of two computers may differ
ROUNDING = 1e-4  # below it a number is an error, of which the order of magnitude counts


@dataclass(frozen=True)
class Block:
    """A block that runs or is saved; `shown` is the span of the text that holds what it prints, if anything does."""

    language: str
    long: bool
    body: str
    file: str | None
    shown: tuple[int, int] | None


def blocks(text: str) -> Iterator[Block]:
    """The blocks of a guide that run or are saved, in order."""
    fences = list(FENCE.finditer(text))
    for last, fence, after in zip([None, *fences], fences, [*fences[1:], None], strict=False):
        saved = SAVED.search(text[last.end() if last else 0 : fence.start()])
        follows = after and after["language"] == "text" and not text[fence.end() : after.start()].strip()
        shown = fence if fence["language"] == "console" else after if follows else None
        if saved or fence["language"] in ("console", "python"):
            span = shown and shown.span("body")
            yield Block(fence["language"], bool(fence["long"]), fence["body"], saved and saved[1], span)


def outputs(text: str, folder: Path, long: bool) -> Iterator[tuple[Block, str]]:
    """Run a guide in a folder, and tell what each block prints, in the form in which the guide shows it."""
    for block in blocks(text):
        if block.file:
            (folder / block.file).write_text(block.body, encoding="utf-8")
        elif block.language == "console" and (long or not block.long):
            yield block, "".join(f"$ {command}\n{run(command, folder)}" for command in commands(block.body))
        elif block.language == "python" and (long or not block.long):
            yield block, run_program(block.body, folder)


def commands(body: str) -> list[str]:
    return [line[2:] for line in body.splitlines() if line.startswith("$ ")]


def run(command: str, folder: Path) -> str:
    """What a command prints: one of pkmsea in this process, any other one in a shell."""
    with contextlib.chdir(folder):
        name, *arguments = shlex.split(command)
        if name == "pkmsea":
            done = CliRunner().invoke(app, arguments)
            if done.exception and not isinstance(done.exception, SystemExit):
                raise done.exception
            assert done.exit_code == 0, done.output
            return done.output
        path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
        shell = subprocess.run(command, shell=True, capture_output=True, text=True, env=os.environ | {"PATH": path})
        assert shell.returncode == 0, shell.stderr
        return shell.stdout + shell.stderr


def run_program(program: str, folder: Path) -> str:
    """What lines of Python print."""
    printed = io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(printed):
        exec(compile(program, "guide", "exec"), {"__name__": "guide"})
    return printed.getvalue()


def alike(shown: str, printed: str) -> bool:
    """Whether two outputs are the same but for white space, times, last digits and sizes of errors."""
    parts = [_words(part) for part in re.split(r"^\.\.\.$", shown, flags=re.M)]
    words = _words(printed)
    if not _begins(parts[0], words) or sum(map(len, parts)) > len(words):
        return False
    at = len(parts[0])
    for part in parts[1:]:
        ends = [len(words) - len(part)] if part is parts[-1] else range(at, len(words))
        found = next((i for i in ends if _begins(part, words[i:])), None)
        if found is None:
            return False
        at = found + len(part)
    return at == len(words)


def _begins(shown: list[str], printed: list[str]) -> bool:
    return len(shown) <= len(printed) and all(map(_same, shown, printed))


def _words(text: str) -> list[str]:
    text = re.sub("─+", "─", TIME.sub("TIME", text))
    return [part for word in text.split() for part in NUMBER.split(word) if part]


def _same(shown: str, printed: str) -> bool:
    if shown == printed:
        return True
    if not (NUMBER.fullmatch(shown) and NUMBER.fullmatch(printed)) or shown.lstrip("-+").isdigit():
        return False
    a, b = float(shown), float(printed)
    if max(abs(a), abs(b)) < ROUNDING:
        return a == b == 0 or 0.1 < abs(a or ROUNDING) / abs(b or ROUNDING) < 10 or max(abs(a), abs(b)) < 1e-9
    mantissa, _, exponent = shown.lower().partition("e")
    digit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    return abs(a - b) <= (LAST_DIGITS + 1e-6) * digit


def rows(text: str, before: str) -> list[list[str]]:
    """The cells of the table behind a line that ends so."""
    _, table = re.split(rf"{re.escape(before)}\n\n(?=\|)", text, maxsplit=1)
    lines = table.split("\n\n")[0].splitlines()[2:]
    return [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]


def codes(cells: Iterable[str]) -> Iterator[str]:
    for cell in cells:
        yield from CODE.findall(cell)


def words(cells: Iterable[str]) -> set[str]:
    """All names in code."""
    return {word for code in codes(cells) for word in WORD.findall(code)}
