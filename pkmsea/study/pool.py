"""Jobs on the cores of this machine (joblib), or on a Dask cluster that its user has started."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, nullcontext
from typing import Any

from joblib import Parallel, delayed, parallel_config

from pkmsea.errors import InputError
from pkmsea.solver.multistart import available_cores
from pkmsea.study.study import KEY

ATTEMPTS = 3  # at a job whose worker died
WAIT = 60  # [s] for the first worker of a cluster


def unordered(
    function: Callable[[Any], dict[str, Any]],
    jobs: Sequence[Any],
    workers: int | None,
    scheduler: str | None,
    lost: Callable[[Any], dict[str, Any]],
) -> Iterator[dict[str, Any]]:
    """The rows of all jobs, as they come. Where a worker dies, what it had in hand is tried again; `lost` makes the row
    of a job that is never finished.

    Raises
    ------
    InputError : there is no cluster at the scheduler's address.
    """
    left = {job.key: job for job in jobs}
    for _ in range(ATTEMPTS):
        if not left:
            return
        try:
            for row in _run(function, list(left.values()), workers, scheduler):
                del left[tuple(row[name] for name in KEY)]
                yield row
        except BrokenProcessPool:
            continue
    for job in left.values():
        yield lost(job)


def _run(
    function: Callable[[Any], dict[str, Any]], jobs: list[Any], workers: int | None, scheduler: str | None
) -> Iterator[dict[str, Any]]:
    count = min(workers or available_cores(), len(jobs))
    if scheduler is None and count == 1:
        yield from map(function, jobs)
        return
    with _backend(scheduler):
        pool = Parallel(n_jobs=count if scheduler is None else -1, return_as="generator_unordered", batch_size=1)
        yield from pool(delayed(function)(job) for job in jobs)


def _backend(scheduler: str | None) -> AbstractContextManager[Any]:
    if scheduler is None:
        return nullcontext()
    try:
        import distributed  # noqa: F401
    except ImportError:
        raise InputError(
            "dask.distributed is not installed.", "Install it: pip install 'pkmsea[cluster]'.", key="--scheduler"
        ) from None
    try:
        return parallel_config(backend="dask", scheduler_host=scheduler, wait_for_workers_timeout=WAIT)
    except (OSError, TimeoutError, ValueError) as error:
        raise InputError(
            f"There is no Dask scheduler ({error}).",
            "Start one with 'dask scheduler', and its workers with 'dask worker'.",
            key="--scheduler", value=scheduler,
        ) from None  # fmt: skip
