"""Linear algebra on one thread.

How a library splits a sum among threads decides its last digits, and with them, now and then, where a hard solve ends:
a result would depend on the number of cores.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import wraps
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

P = ParamSpec("P")
T = TypeVar("T")

_lock = threading.Lock()
_inside: list[object] = []  # a mark for each call that runs, in any thread
_limits: list[threadpool_limits] = []  # at most one


def one_thread(function: Callable[P, T]) -> Callable[P, T]:
    """The function, with BLAS and OpenMP on one thread while it runs; what was set before comes back after the last."""

    @wraps(function)
    def limited(*args: P.args, **kwargs: P.kwargs) -> T:
        mark = object()
        try:
            with _lock:
                _inside.append(mark)
                if not _limits:
                    _limits.append(threadpool_limits(1))
            return function(*args, **kwargs)
        finally:
            with _lock:
                if mark in _inside:
                    _inside.remove(mark)
                if not _inside and _limits:
                    _limits.pop().restore_original_limits()

    return limited
