"""Every error that pkmsea raises on purpose: one root, data on the exception, the remedy in the message.

`exit_code` is what the command line returns: 2 for bad input, 1 for a problem that has no answer or found none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from pathlib import Path
from typing import Any


class PkmseaError(Exception):
    """Root of all pkmsea errors.

    Attributes
    ----------
    cause : what is wrong, one sentence.
    remedy : what to do next, one sentence.
    file, key, value : where it is wrong, as far as that is known.
    notes : what was noticed on the way and may be the reason, one sentence each.
    """

    exit_code = 2
    notes: tuple[str, ...] = ()

    def __init__(
        self, cause: str, remedy: str, *, file: str | Path | None = None, key: str | None = None, value: Any = None
    ) -> None:
        self.cause, self.remedy, self.file, self.key, self.value = cause, remedy, file, key, value
        super().__init__(cause, remedy)

    def __repr__(self) -> str:
        return one_line(f"{type(self).__name__}({str(self)!r})")

    def __str__(self) -> str:
        where = [str(self.file)] if self.file is not None else []
        if self.key is not None:
            where.append(self.key if self.value is None else f"{self.key} = {one_line(repr(self.value), 80)}")
        place = ", ".join(where)
        return (f"{place}: " if place else "") + f"{self.cause} {self.remedy}"


@contextmanager
def blaming(file: str | Path | None) -> Iterator[None]:
    """Errors of pkmsea that name no file name this one."""
    try:
        yield
    except PkmseaError as error:
        error.file = file if error.file is None else error.file
        raise


@contextmanager
def noting(notes: Iterable[str]) -> Iterator[None]:
    """Errors of pkmsea tell these notes, too."""
    try:
        yield
    except PkmseaError as error:
        error.notes = tuple(dict.fromkeys((*error.notes, *notes)))
        raise


def one_line(text: str, limit: int = 160) -> str:
    """A text on one line, cut where it is too long."""
    text = " ".join(text.split())
    return text if len(text) <= limit else text[: limit - 3] + "..."


def meant(name: str, known: Iterable[str]) -> str:
    """'Did you mean ...? ' where one of the known names is like this one, else nothing."""
    near = get_close_matches(name, known, 1)
    return f"Did you mean '{near[0]}'? " if near else ""


def listed(names: Iterable[str]) -> str:
    return ", ".join(sorted(names)) or "none"


class BridgeError(PkmseaError):
    """The compiled module is missing, does not fit the installed casadi, or cannot model a joint."""


class InputError(PkmseaError):
    """A file does not say what pkmsea needs, or says something impossible."""


class Unwritable(InputError):
    """A file cannot be written: the disk is full, or the rights are missing."""


class MechanismError(InputError):
    """A URDF or its sidecar describes no usable mechanism."""


class NameNotFound(InputError):
    """A name that does not exist where it is looked up; the message lists the names that do."""

    def __init__(self, kind: str, name: str, known: list[str], **where: Any) -> None:
        self.name, self.known = name, known
        super().__init__(
            f"There is no {kind} named '{name}'.", f"{meant(name, known)}Use one of: {listed(known)}.", **where
        )


class Unreachable(InputError):
    """A task-space point that the mechanism cannot reach on its declared assembly mode."""


class SolveError(PkmseaError):
    """The optimisation ended without a usable answer."""

    exit_code = 1


class Infeasible(SolveError):
    """No motion satisfies the task's windows and limits, as far as the solver could tell.

    `contention` says which limits contend, where that is known (`pkmsea.solution.contention.Contention`).
    """

    contention: Any = None


class NotConverged(SolveError):
    """No start reached an optimum within its limits of time and iterations."""


class Unverified(SolveError):
    """A result that is not verified was to be passed on as if it were."""
