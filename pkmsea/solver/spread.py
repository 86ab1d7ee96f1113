"""Calls on one transcription, spread over processes: each gets a pickle of what it is made of, and builds it once."""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from functools import lru_cache, partial
from typing import Any, NoReturn, TypeVar

from pkmsea.errors import SolveError
from pkmsea.solver.processes import available_cores, once, unordered
from pkmsea.transcription import Transcription

T = TypeVar("T")


def collect(results: Iterator[T], progress: Callable[[T], None] | None = None) -> tuple[list[T], bool]:
    """All that finish before an interrupt, and whether there was one."""
    done = []
    try:
        for result in results:
            if progress is not None:
                progress(result)
            done.append(result)
    except KeyboardInterrupt:
        return done, True
    return done, False


def spread(transcription: Transcription, workers: int | None, calls: list[tuple[Callable[..., T], Any]]) -> Iterator[T]:
    """Run calls (function, argument) on a transcription here, or on several processes.

    Where a process dies, the calls that are not done run again in fresh ones.

    Raises
    ------
    SolveError : a process has died again.
    """
    jobs = min(workers or available_cores(), len(calls))
    if jobs <= 1:
        return (function(transcription, argument) for function, argument in calls)
    content = pickle.dumps(transcription)
    arguments = {number: (content, *call) for number, call in enumerate(calls)}
    lost = partial(_died, transcription.problem.name)
    return (result for _, result in unordered(_remote, once(arguments), jobs, lost))


def _died(name: str, number: int) -> NoReturn:
    raise SolveError(
        "A worker process has died again and again: something has killed it, or the memory is full.",
        "Run again with fewer processes (--workers), and free memory.",
        key=f"setup '{name}'",
    )


def _remote(content: bytes, function: Callable[..., T], argument: Any) -> T:
    return function(_built(content), argument)


@lru_cache(maxsize=4)
def _built(content: bytes) -> Transcription:
    """The transcription of a pickle, built once per process; equal pickles are told by their content."""
    transcription: Transcription = pickle.loads(content)
    return transcription
