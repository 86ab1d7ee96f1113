"""Jobs in this process, or on the cores of this machine."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from typing import Any, TypeVar

from pkmsea.solver.processes import available_cores, unordered

J = TypeVar("J")
A = TypeVar("A")
More = Callable[[], Sequence[J]]


class Pool:
    """Where jobs run: this process, or `workers` of this machine."""

    def __init__(self, workers: int | None = None) -> None:
        self.workers = workers or available_cores()

    def unordered(self, function: Callable[[J], A], more: More[J], crashed: Callable[[J], A]) -> Iterator[A]:
        """The answers to jobs, as they come; `more` gives jobs, at first and after every answer.

        `crashed` makes the answer to a job that kills its process.
        """
        return _here(function, more) if self.workers == 1 else self._on_processes(function, more, crashed)

    def _on_processes(self, function: Callable[[J], A], more: More[J], crashed: Callable[[J], A]) -> Iterator[A]:
        jobs: dict[int, J] = {}  # that are not done
        numbers = count()

        def numbered() -> dict[int, tuple[Any]]:
            new = {next(numbers): job for job in more()}
            jobs.update(new)
            return {number: (job,) for number, job in new.items()}

        for number, answer in unordered(function, numbered, self.workers, lambda number: crashed(jobs[number])):
            del jobs[number]
            yield answer


def _here(function: Callable[[J], A], more: More[J]) -> Iterator[A]:
    waiting = deque(more())
    while waiting:
        yield function(waiting.popleft())
        waiting.extend(more())
