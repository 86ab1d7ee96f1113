"""Ctrl-C and SIGTERM end a command alike, between its steps: what is finished is saved and printed before it ends."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TypeVar

T = TypeVar("T")
signals: list[int] = []  # that came
_held = False  # whether a first signal waits for the next `interruptible`


def listen() -> None:
    """Raise KeyboardInterrupt on SIGTERM and on SIGINT, unless that is ignored: a job in the background."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _stop)
    signal.signal(signal.SIGTERM, _stop)


def hold() -> None:
    """From now on, let a first signal wait for the next `interruptible`; a second one does not wait.

    So imports, some of which swallow exceptions, and the writing of results run to their end.
    """
    global _held
    _held = True


@contextmanager
def interruptible() -> Iterator[None]:
    """Where a signal, also one that waits, raises KeyboardInterrupt."""
    global _held
    stop_if()
    _held = False
    try:
        yield
    finally:
        hold()


def each(items: Iterator[T]) -> Iterator[T]:
    """The items of an iterator, each made `interruptible`."""
    nothing = object()
    while True:
        with interruptible():
            item: Any = next(items, nothing)
        if item is nothing:
            return
        yield item


def stop_if(interrupted: bool = False) -> None:
    """Raise KeyboardInterrupt where something was interrupted, or a signal came."""
    if interrupted or signals:
        raise KeyboardInterrupt


def _stop(number: int, frame: Any) -> None:
    signals.append(number)
    if not _held or len(signals) > 1:
        raise KeyboardInterrupt
