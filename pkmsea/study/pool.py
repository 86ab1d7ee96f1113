"""Jobs on the cores of this machine (joblib), or on a Dask cluster that its user has started."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from joblib import Parallel, delayed, parallel_config

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
        self, function: Callable[[Any], Row], jobs: Sequence[Any], lost: Callable[[Any], Row]
    ) -> Iterator[Row]:
        """The rows of all jobs, as they come; `lost` makes the row of a job that kills its process."""
        if self.client is not None:
            yield from self._on_cluster(function, jobs)
        elif self.workers == 1 or len(jobs) <= 1:
            yield from map(function, jobs)
        else:
            arguments = {number: (job,) for number, job in enumerate(jobs)}
            count = min(self.workers, len(jobs))
            for _, row in unordered(function, arguments, count, lambda number: lost(jobs[number])):
                yield row

    def _on_cluster(self, function: Callable[[Any], Row], jobs: Sequence[Any]) -> Iterator[Row]:
        from distributed import KilledWorker

        with parallel_config(backend="dask", client=self.client, wait_for_workers_timeout=WAIT):
            try:
                yield from Parallel(return_as="generator_unordered", batch_size=1)(delayed(function)(j) for j in jobs)
            except (KilledWorker, TimeoutError) as error:
                raise SolveError(
                    f"The cluster has lost its workers ({type(error).__name__}).",
                    "Look at their logs, start workers anew, and run the same command again: it goes on.",
                    key="--scheduler",
                ) from error


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
            key="--scheduler", value=scheduler,
        ) from None  # fmt: skip
    with client:
        yield Pool(workers, client)
