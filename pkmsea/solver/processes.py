"""Calls on several processes of this machine (joblib), which may die or be left behind."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from typing import Any, TypeVar

from joblib import Parallel, delayed

POOLS = 2  # that may break before every call gets processes of its own
WATCH = 0.5  # [s] between looks at whether the parent is alive

K = TypeVar("K")
T = TypeVar("T")


def unordered(
    function: Callable[..., T], arguments: Mapping[K, tuple[Any, ...]], jobs: int, lost: Callable[[K], T]
) -> Iterator[tuple[K, T]]:
    """Key and result of each call, as they come.

    Where a process dies, the calls that are not done run again in fresh ones, at last each alone: `lost` makes the
    result of the one that kills its process.
    """
    left, broken = dict(arguments), 0
    while left:
        alone = broken >= POOLS
        chosen = dict([next(iter(left.items()))]) if alone else dict(left)
        pool = Parallel(n_jobs=jobs, return_as="generator_unordered", batch_size=1)
        try:
            for key, result in pool(delayed(_remote)(os.getpid(), function, k, chosen[k]) for k in chosen):
                del left[key]
                yield key, result
        except BrokenProcessPool:
            broken += 1
            for key in chosen if alone else ():
                del left[key]
                yield key, lost(key)


def available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _remote(parent: int, function: Callable[..., T], key: K, arguments: tuple[Any, ...]) -> tuple[K, T]:
    _end_with(parent)
    return key, function(*arguments)


@cache
def _end_with(parent: int) -> None:
    """Let this process end when its parent has: one that was killed cannot tell it to."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
