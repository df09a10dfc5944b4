"""Independent jobs on an existing engine: processes of this machine, Ray or Dask.

    for done in run(diagnose_one, jobs, engine="ray", address="auto"):
        print(done.index, done.value if done.failure is None else done.failure.message)

All engines go through joblib. A job whose worker dies is run again, `TRIES` times in all; a job
that raises an error, or that takes its worker with it each time, is reported, and the others go on.
Outcomes come as they are done, so that their order is the engine's, and nothing else is. Jobs share
no state, and each has one thread of BLAS unless the user's own workers were started with more.

The function and the jobs are pickled: on a cluster, its machines have to have the same packages.
"""

from __future__ import annotations

import traceback
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any, Final, Generic, TypeVar

import joblib
from joblib.externals.loky.process_executor import TerminatedWorkerError

from walkerkit.gap.errors import InputError, closest, one_line
from walkerkit.gap.fleet.clusters import Cluster, dask, ray

T = TypeVar("T")

PROCESSES: Final = "processes"
ENGINES: Final = {PROCESSES: None, "ray": ray, "dask": dask}
TRIES: Final = 3


@dataclass(frozen=True, kw_only=True)
class Failure:
    """Why a job has no value.

    Attributes:
        message: one line.
        refused: whether its input cannot be used, rather than that something broke.
        details: the traceback, or "" where there is none to show.
    """

    message: str
    refused: bool = False
    details: str = ""


@dataclass(frozen=True, kw_only=True)
class Done(Generic[T]):
    """The outcome of one job.

    Attributes:
        index: its place among the jobs.
        value: what the function returned, or None.
        failure: why there is no value, or None.
        lost: whether that is the death of its worker.
    """

    index: int
    value: T | None
    failure: Failure | None = None
    lost: bool = False


def run(
    function: Callable[[Any], T],
    jobs: Sequence[Any],
    *,
    engine: str = PROCESSES,
    address: str | None = None,
    workers: int | None = None,
) -> Iterator[Done[T]]:
    """Calls a function of a module with each of the jobs, each in a process that is not this one.

    Args:
        function: called with one job.
        jobs: what it is called with.
        engine: `processes`, `ray` or `dask`.
        address: of a cluster that runs; by default one is started on this machine, and ended.
        workers: how many jobs run at a time, by default as many as there are cores.

    Yields:
        The outcomes, as they come.

    Raises:
        InputError: the engine is unknown, not installed, or does not answer.
    """
    check_engine(engine, address, workers)
    opened = ENGINES[engine]
    if not jobs:
        return
    if opened is None:
        yield from _with_tries(function, jobs, min(workers or joblib.cpu_count(), len(jobs)))
        return
    with opened(address, workers) as cluster:
        cluster.give_up = _given_up
        yield from _with_tries(function, jobs, cluster.workers, cluster)


def check_engine(engine: str, address: str | None, workers: int | None) -> None:
    """Raises InputError where an engine cannot be meant so."""
    if engine not in ENGINES:
        raise InputError(
            f"engine {engine!r} is unknown{closest(engine, ENGINES)}. "
            f"Choose one of {', '.join(ENGINES)}."
        )
    if address is not None and ENGINES[engine] is None:
        raise InputError(
            f"address {address!r} is given, but processes run on this machine alone. "
            "Choose --engine ray or --engine dask, or leave the address out."
        )
    if workers is not None and workers < 1:
        raise InputError(f"workers is {workers}; give 1 or more, or leave it out for all cores.")


def _with_tries(
    function: Callable[[Any], T], jobs: Sequence[Any], count: int, cluster: Cluster | None = None
) -> Iterator[Done[T]]:
    """Runs jobs until each has an outcome.

    Whatever runs beside a job that kills its worker may be lost with it. So what was lost runs
    again in company, and at last on its own, where only its own death ends it.
    """
    left = dict.fromkeys(range(len(jobs)))
    deaths: Counter[int] = Counter()
    while left:
        company = [index for index in left if deaths[index] < TRIES - 1]
        for done in _round(function, jobs, company or [next(iter(left))], count, cluster):
            deaths[done.index] += done.lost
            if not done.lost or deaths[done.index] == TRIES:
                del left[done.index]
                yield done


def _round(
    function: Callable[[Any], T],
    jobs: Sequence[Any],
    indices: Sequence[int],
    count: int,
    cluster: Cluster | None,
) -> Iterator[Done[T]]:
    """Runs jobs `count` at a time, and each once or, where processes broke down, not at all."""
    options: dict[str, Any] = {"inner_max_num_threads": 1} if cluster is None else {}
    with joblib.parallel_config(cluster or "loky", **options):
        parallel = joblib.Parallel(
            n_jobs=max(count, 2),  # one would be this process itself
            pre_dispatch=count,  # and this is what bounds them
            batch_size=1,
            return_as="generator_unordered",
        )
    begun: list[int] = []

    def calls() -> Iterator[Any]:
        for index in indices:
            begun.append(index)
            yield joblib.delayed(_guarded)(index, function, jobs[index])

    with closing(parallel(calls())) as outcomes:
        try:
            for done in outcomes:
                begun.remove(done.index)
                yield done
        except TerminatedWorkerError:
            lost = list(begun)
        else:
            return
    for index in lost:
        yield _lost(index)


def _lost(index: int) -> Done[Any]:
    message = f"its worker died {TRIES} times: out of memory, or a crash"
    return Done(index=index, value=None, failure=Failure(message=message), lost=True)


def _given_up(arguments: tuple[Any, ...], error: Exception, died: bool) -> Done[Any]:
    """The outcome of a job from which a cluster brings back no outcome of its own."""
    index = arguments[0]
    if died:
        return _lost(index)
    last = (str(error).strip().splitlines() or [""])[-1]
    message = f"no worker could run it: {type(error).__name__}: {last}"
    return Done(index=index, value=None, failure=Failure(message=message, details=str(error)))


def _guarded(index: int, function: Callable[[Any], T], job: Any) -> Done[T]:
    """The outcome of a job, whatever it raises: an error would end those that run beside it."""
    try:
        return Done(index=index, value=function(job))
    except InputError as error:
        return Done(index=index, value=None, failure=Failure(message=str(error), refused=True))
    except Exception as error:
        message = f"{type(error).__name__}: {one_line(error)}"
        failure = Failure(message=message, details=traceback.format_exc())
        return Done(index=index, value=None, failure=failure)
