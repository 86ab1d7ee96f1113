"""Jobs on the cores of this machine (joblib's loky), or on a Dask cluster that its user has started."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from contextlib import contextmanager
from itertools import count
from typing import Any

from pkmsea.errors import InputError, SolveError
from pkmsea.solver.processes import available_cores, unordered

PATIENCE = 15  # [s] for the scheduler to answer
WAIT = 120  # [s] for the first worker of a cluster

Row = dict[str, Any]


class Pool:
    """Where jobs run: `workers` processes here, or the workers of a Dask `client`."""

    def __init__(self, workers: int | None = None, client: Any = None) -> None:
        self.workers, self.client = workers or available_cores(), client

    def unordered(
        self, function: Callable[[Any], Row], more: Callable[[], Sequence[Any]], lost: Callable[[Any], Row]
    ) -> Iterator[Row]:
        """The rows of jobs, as they come; `more` gives jobs, at first and after every row.

        `lost` makes the row of a job that kills its process.
        """
        if self.client is not None:
            return self._on_cluster(function, more)
        if self.workers == 1:
            return _here(function, more)
        return self._on_processes(function, more, lost)

    def _on_processes(
        self, function: Callable[[Any], Row], more: Callable[[], Sequence[Any]], lost: Callable[[Any], Row]
    ) -> Iterator[Row]:
        jobs: dict[int, Any] = {}  # that are not done
        numbers = count()

        def numbered() -> dict[int, tuple[Any]]:
            new = {next(numbers): job for job in more()}
            jobs.update(new)
            return {number: (job,) for number, job in new.items()}

        for number, row in unordered(function, numbered, self.workers, lambda number: lost(jobs[number])):
            del jobs[number]
            yield row

    def _on_cluster(self, function: Callable[[Any], Row], more: Callable[[], Sequence[Any]]) -> Iterator[Row]:
        from distributed import KilledWorker

        executor = self.client.get_executor()
        running: set[Future[Row]] = set()
        try:
            self.client.wait_for_workers(1, timeout=WAIT)
            while True:
                running |= {executor.submit(function, job) for job in more()}
                if not running:
                    return
                done, running = wait(running, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        except (KilledWorker, TimeoutError) as error:
            raise SolveError(
                f"The cluster has no workers, or has lost them ({type(error).__name__}).",
                "Look at their logs, start workers anew, and run the same command again: it goes on.",
                key="--scheduler",
            ) from error
        finally:
            executor.shutdown(wait=False)


def _here(function: Callable[[Any], Row], more: Callable[[], Sequence[Any]]) -> Iterator[Row]:
    waiting = deque(more())
    while waiting:
        yield function(waiting.popleft())
        waiting.extend(more())


@contextmanager
def open_pool(workers: int | None, scheduler: str | None) -> Iterator[Pool]:
    """A pool here, or on the cluster at the scheduler's address.

    Raises
    ------
    InputError : dask.distributed is not installed, or nobody answers at the address.
    """
    if scheduler is None:
        yield Pool(workers)
        return
    try:
        from distributed import Client
    except ImportError:
        raise InputError(
            "dask.distributed is not installed.", "Install it: pip install 'pkmsea[cluster]'.", key="--scheduler"
        ) from None
    try:
        client = Client(scheduler, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"No Dask scheduler answers ({error}).",
            "Start one with 'dask scheduler', and its workers with 'dask worker ADDRESS'.",
            key="--scheduler",
            value=scheduler,
        ) from None
    with client:
        yield Pool(workers, client)
