"""Jobs on the workers of a Dask cluster, which come, go and die, as does its scheduler; nothing waits without end."""

from __future__ import annotations

import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import partial
from queue import Empty, SimpleQueue

from distributed import Client, Future, KilledWorker

from pkmsea.errors import InputError, PkmseaError, SolveError
from pkmsea.study.pool import A, J, More, Pool

log = logging.getLogger(__name__)

PATIENCE = 15  # [s] for the scheduler to answer
WAIT = 120  # [s] for a worker to come
PAUSE = 0.2  # [s] between looks for a worker
LOOK = 2  # [s] without an answer after which scheduler and workers are looked for


class ClusterPool(Pool):
    """The workers of a cluster. Jobs of a worker that is lost go to others; those of a scheduler that is lost go to one
    that is started in its place within PATIENCE."""

    def __init__(self, client: Client) -> None:
        self._client = client

    def unordered(self, function: Callable[[J], A], more: More[J], crashed: Callable[[J], A]) -> Iterator[A]:
        running: dict[Future, J] = {}
        ended: SimpleQueue[Future] = SimpleQueue()
        waiting, look = list(more()), True
        while waiting or running:
            if look or self._client.status != "running":
                self._await_workers()
                look = False
            for job in waiting:
                future = self._client.submit(partial(function, job), pure=False)
                running[future] = job
                future.add_done_callback(ended.put)
            waiting = []
            try:
                future = ended.get(timeout=LOOK)
            except Empty:
                look = True
                continue
            job = running.pop(future)
            try:
                answer = future.result(timeout=WAIT)
            except KilledWorker:
                answer = crashed(job)
            except PkmseaError:
                raise
            except Exception as error:
                if future.status == "error":
                    raise _unable(error) from error
                waiting = [job]  # scheduler or worker have gone with what was found
                continue
            yield answer
            waiting = list(more())

    def _await_workers(self) -> None:
        """Wait until the scheduler answers and has a worker.

        Raises
        ------
        SolveError : it does not in time.
        """
        client, deadline = self._client, time.monotonic() + WAIT
        if client.status != "running":
            log.warning("The scheduler has gone away; waiting for it.")
        while client.status != "closed" and time.monotonic() < deadline:
            scheduler = client.scheduler
            with suppress(OSError, TimeoutError):
                if scheduler is not None and client.sync(scheduler.identity, callback_timeout=PATIENCE)["workers"]:
                    return
            time.sleep(PAUSE)
        what = "has no workers" if self._client.status == "running" else "does not answer any more"
        raise SolveError(
            f"The scheduler {what}.",
            "Start scheduler and workers anew, and run the same command again: it goes on.",
            key="--scheduler",
        )


def _unable(error: Exception) -> SolveError:
    return SolveError(
        f"A worker cannot do its job ({type(error).__name__}: {error}).",
        "Give the workers the environment of this command; what was finished stays.",
        key="--scheduler",
    )


@contextmanager
def connected(scheduler: str) -> Iterator[Client]:
    """A client of the scheduler at an address.

    Raises
    ------
    InputError : nobody answers there.
    """
    try:
        client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"No Dask scheduler answers ({error}).",
            "Start one with 'dask scheduler', and its workers with 'dask worker ADDRESS'.",
            key="--scheduler",
            value=scheduler,
        ) from None
    try:
        yield client
    finally:
        with suppress(OSError, TimeoutError):
            client.close(timeout=PATIENCE)
