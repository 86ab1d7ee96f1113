"""Running a study, here or on a cluster, from where it stopped."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from pkmsea.ending import deferred
from pkmsea.errors import InputError
from pkmsea.study.fingerprint import fingerprint
from pkmsea.study.pool import Pool
from pkmsea.study.result import StudyResult
from pkmsea.study.runner import Progress, Runner
from pkmsea.study.study import Study, load_study
from pkmsea.study.table import NAME, Table
from pkmsea.study.tasks import check


def run_study(
    source: Study | str | Path,
    out: str | Path,
    *,
    workers: int | None = None,
    scheduler: str | None = None,
    progress: Callable[[Progress], None] | None = None,
) -> StudyResult:
    """Run a study, or what is left of it, into a folder.

    Parameters
    ----------
    source : a study, or the path of a study file.
    out : folder of the table (study.sqlite), of result files and of changed mechanisms.
    workers : processes; default: the cores that this process may use. Results do not depend on it.
    scheduler : address of a Dask scheduler whose workers are used instead; they need no folder in common.
    progress : called after every point.

    Raises
    ------
    InputError : the study is wrong, or the folder holds points of another one. Unwritable : the disk is full, say.
    SolveError : the cluster does not answer any more. What was stored by then stays, and the next call goes on.
    """
    study = load_study(source) if isinstance(source, str | Path) else source
    out = Path(out)
    drives = check(study, out)
    interrupted = False
    with _pool(workers, scheduler) as pool, deferred():
        columns = list(study.vary), drives, fingerprint(study)
        with closing(Table(out / NAME, *columns)) as table:
            try:
                Runner(study, out, table, pool, progress).everything()
            except KeyboardInterrupt:
                interrupted = True
            rows = table.rows()
    result = StudyResult(study, rows, out, interrupted)
    if study.results != "none":
        result.save_best()
    return result


@contextmanager
def _pool(workers: int | None, scheduler: str | None) -> Iterator[Pool]:
    """A pool here, or on the cluster at the scheduler's address.

    Raises
    ------
    InputError : dask.distributed is not installed, or nobody answers at the address.
    """
    if scheduler is None:
        yield Pool(workers)
        return
    try:
        from pkmsea.study import cluster
    except ImportError:
        raise InputError(
            "dask.distributed is not installed.", "Install it: pip install 'pkmsea[cluster]'.", key="--scheduler"
        ) from None
    with cluster.connected(scheduler) as client:
        yield cluster.ClusterPool(client)
