"""How commands end: errors and exit codes; Ctrl-C and SIGTERM, between steps, so that what is finished is kept."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, NoReturn, TypeVar

from pkmsea.errors import InputError, PkmseaError

INTERRUPTED = 130  # how typer ends on Ctrl-C

T = TypeVar("T")
signals: list[int] = []  # that came
_deferring = False  # whether a first signal waits for the next `interruptible`
_fresh = True  # whether nothing was `interruptible` yet, so that there is nothing to be lost


def run(app: Callable[[], Any]) -> None:
    """Run a command: its errors become one paragraph and an exit code; a signal, exit code 1."""
    _open_streams()
    _listen()
    try:
        app()
    except PkmseaError as error:
        _end(error, error.exit_code)
    except (SystemExit, Exception) as stop:
        if signals and (not isinstance(stop, SystemExit) or stop.code == INTERRUPTED):
            _end("stopped; what was finished is printed, and saved where -o was given ('pkmsea plot' draws it)", 1)
        if not isinstance(stop, OSError):
            raise
        cause, remedy = f"The system refuses this ({stop.strerror or stop}).", "Look at its room and rights."
        _end(InputError(cause, remedy, file=stop.filename or "standard output"), InputError.exit_code)
    finally:
        gc.freeze()  # else Python searches all expressions for circles before it ends, which takes up to a second


def _open_streams() -> None:
    """Lead closed standard streams to the null device: the next file would get their place, and what is printed."""
    for descriptor in range(3):
        try:
            os.fstat(descriptor)
        except OSError:
            os.set_inheritable(os.open(os.devnull, os.O_RDWR), True)  # it becomes the lowest that is free
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:
            setattr(sys, name, open(os.devnull, "r" if name == "stdin" else "w"))  # noqa: SIM115, to the end


def _end(error: PkmseaError | str, code: int) -> NoReturn:
    """Print an error and end; what cannot be printed any more, a full disk behind standard output say, is dropped."""
    with suppress(OSError):
        print_error(error)
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            with suppress(OSError):  # a stream without a descriptor
                os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())
    sys.exit(code)


def print_error(error: BaseException | str) -> None:
    """One paragraph on standard error."""
    from rich.console import Console

    console = Console(stderr=True, highlight=False, soft_wrap=not sys.stderr.isatty())
    console.print("pkmsea: ", style="bold red", end="")
    console.print(str(error), markup=False, emoji=False)
    for note in getattr(error, "notes", ()):
        console.print(f"note: {note}", markup=False, emoji=False)


def _listen() -> None:
    """Raise KeyboardInterrupt on SIGTERM and on SIGINT, unless that is ignored: a job in the background."""
    _heed_ctrl_c()
    signal.signal(signal.SIGTERM, _stop)


def _heed_ctrl_c() -> bool:
    """Whether Ctrl-C was Python's own, and is kept in `signals` from now on."""
    ours = signal.getsignal(signal.SIGINT) is signal.default_int_handler
    if ours:
        signal.signal(signal.SIGINT, _stop)
    return ours


def defer() -> None:
    """From now on, let a first signal wait for the next `interruptible`, so that results are written to their end.

    A second one does not wait; and before the first `interruptible` a signal ends the process at once, because imports
    may swallow an exception.
    """
    global _deferring
    _deferring = True


@contextmanager
def interruptible() -> Iterator[None]:
    """Where a signal, also one that waits, raises KeyboardInterrupt.

    CasADi, for one, makes another exception of it on its way: after a signal that is a KeyboardInterrupt again.
    """
    global _deferring, _fresh
    stop_if()
    _deferring = _fresh = False
    try:
        yield
    except Exception:
        stop_if()
        raise
    finally:
        defer()


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


@contextmanager
def deferred() -> Iterator[None]:
    """Where Ctrl-C is kept in `signals` until the end, as in a command: on its way a library may make another exception
    of it, which looks like a failure of its own."""
    ours = threading.current_thread() is threading.main_thread() and _heed_ctrl_c()
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, signal.default_int_handler)
            signals.clear()


def _stop(number: int, frame: Any) -> None:
    signals.append(number)
    if _deferring and _fresh:
        os.write(sys.stderr.fileno(), b"pkmsea: stopped\n")
        atexit._run_exitfuncs()  # folders for temporary files go
        os._exit(1)
    if not _deferring or len(signals) > 1:
        raise KeyboardInterrupt
