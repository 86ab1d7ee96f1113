"""Calls on several processes of this machine (loky), which may die or be left behind."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import FIRST_COMPLETED, Future, wait
from concurrent.futures.process import BrokenProcessPool
from functools import cache
from multiprocessing import resource_tracker
from typing import Any, TypeVar

from joblib.externals.loky import ProcessPoolExecutor

AHEAD = 2  # calls per process that are handed over at a time
POOLS = 2  # that may break before every call gets processes of its own
BREAKS = 20  # after which not even a fresh one can be had
IDLE = 300  # [s] until a process without a call ends
WATCH = 0.5  # [s] between looks at whether the parent is alive
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")  # one each

K = TypeVar("K")
T = TypeVar("T")
Arguments = tuple[Any, ...]

_idle: list[_Executor] = []  # at most one
_lock = threading.Lock()


class _Executor:
    """Processes for one run of calls at a time. loky's reusable executor is one for the whole program instead, where
    calls of joblib and of other threads run, too."""

    def __init__(self, size: int) -> None:
        self.size = size
        resource_tracker.ensure_running()  # its start unblocks Ctrl-C
        self._pool = ProcessPoolExecutor(size, timeout=IDLE, env=dict.fromkeys(THREADS, "1"))
        self.shutdown = self._pool.shutdown

    def submit(self, function: Callable[..., T], *arguments: Any) -> Future[T]:
        """Hand a call over. Processes that this starts leave Ctrl-C to their parent, which ends them."""
        before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            future: Future[T] = self._pool.submit(function, *arguments)
            return future
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, before)

    @classmethod
    def take(cls, size: int) -> _Executor:
        """The idle one if it is large enough, else a new one."""
        with _lock:
            found = _idle.pop() if _idle else None
        if found is not None and found.size < size:
            found.shutdown(wait=False)
            found = None
        return found or cls(size)

    def give_back(self) -> None:
        """Keep it for the next calls: processes take a second to start."""
        with _lock:
            kept = not _idle
            _idle.extend([self] * kept)
        if not kept:
            self.shutdown(wait=False)


def unordered(
    function: Callable[..., T],
    more: Callable[[], Mapping[K, Arguments]],
    jobs: int,
    lost: Callable[[K], T],
) -> Iterator[tuple[K, T]]:
    """Key and result of each call, as they come; `more` gives calls, at first and after every result.

    Where a process dies, the calls that are not done run again in fresh ones, at last each alone: `lost` makes the
    result of the one that kills its process.
    """
    waiting: dict[K, Arguments] = {}
    running: dict[Future[T], tuple[K, Arguments]] = {}
    broken, executor = 0, None
    try:
        while True:
            waiting |= more()
            alone = broken >= POOLS
            while waiting:
                executor = executor or _Executor.take(jobs)
                ahead = jobs if executor.size > jobs else AHEAD * jobs
                if len(running) >= (1 if alone else ahead):
                    break
                key = next(iter(waiting))
                try:
                    future = executor.submit(_remote, os.getpid(), function, waiting[key])
                except BrokenProcessPool:  # it broke just now
                    broken, executor = broken + 1, None
                    if broken > BREAKS:
                        raise
                    continue
                running[future] = key, waiting.pop(key)
            if not running:
                return
            dead: dict[K, Arguments] = {}
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                key, arguments = running.pop(future)
                try:
                    result = future.result()
                except BrokenProcessPool:
                    dead[key] = arguments
                    continue
                yield key, result
            if dead:
                broken, executor = broken + 1, None
            if alone:
                yield from ((key, lost(key)) for key in dead)
            elif dead:
                waiting = dead | dict(running.values()) | waiting
                running.clear()
    finally:
        if executor is not None and running:
            executor.shutdown(wait=True, kill_workers=True)
        elif executor is not None:
            executor.give_back()


def once(calls: Mapping[K, Arguments]) -> Callable[[], Mapping[K, Arguments]]:
    """`more` of `unordered` for calls that are all known."""
    given = iter([calls])
    return lambda: next(given, {})


def available_cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _remote(parent: int, function: Callable[..., T], arguments: Arguments) -> T:
    _end_with(parent)
    return function(*arguments)


@cache
def _end_with(parent: int) -> None:
    """Let this process end when its parent has: one that was killed cannot tell it to."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(WATCH)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
