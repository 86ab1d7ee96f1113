"""Ctrl-C and SIGTERM end a command alike. A library that is just being imported may swallow the exception."""

from __future__ import annotations

import signal
from typing import Any

signals: list[int] = []  # that came


def listen() -> None:
    """Raise KeyboardInterrupt on SIGTERM and on SIGINT, unless that is ignored: a job in the background."""
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _stop)
    signal.signal(signal.SIGTERM, _stop)


def _stop(number: int, frame: Any) -> None:
    signals.append(number)
    raise KeyboardInterrupt


def stop_if(interrupted: bool = False) -> None:
    """Raise KeyboardInterrupt where something was interrupted, or a signal came."""
    if interrupted or signals:
        raise KeyboardInterrupt
