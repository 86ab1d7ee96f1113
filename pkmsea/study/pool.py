"""Jobs on the cores of this machine (joblib), or on a Dask cluster that its user has started."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from joblib import Parallel, delayed, parallel_config

from pkmsea.errors import InputError
from pkmsea.solver.multistart import available_cores
from pkmsea.study.study import KEY

ATTEMPTS = 3  # at a job whose worker died
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
        """The rows of all jobs, as they come.

        Where a worker dies, what it had in hand is tried again; `lost` makes the row of a job that is never finished.
        """
        left = {job.key: job for job in jobs}
        for _ in range(ATTEMPTS):
            try:
                for row in self._run(function, list(left.values())):
                    del left[tuple(row[name] for name in KEY)]
                    yield row
            except BrokenProcessPool:
                continue
            return
        yield from map(lost, left.values())

    def _run(self, function: Callable[[Any], Row], jobs: list[Any]) -> Iterator[Row]:
        count = min(self.workers, len(jobs))
        if self.client is None and count <= 1:
            yield from map(function, jobs)
            return
        with self._backend():
            calls = Parallel(n_jobs=count if self.client is None else -1, return_as="generator_unordered", batch_size=1)
            yield from calls(delayed(function)(job) for job in jobs)

    def _backend(self) -> AbstractContextManager[Any]:
        if self.client is None:
            return nullcontext()
        return parallel_config(backend="dask", client=self.client, wait_for_workers_timeout=WAIT)


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
