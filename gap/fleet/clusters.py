"""Ray and Dask as backends of joblib.

    with ray(None, workers=4) as cluster, joblib.parallel_config(cluster):
        ...

joblib's own for Dask waits for ever for a call whose worker died too often, and Ray's deals calls
out to actors of which a dead one stays dead. Here a call that its engine gives up comes back as an
outcome, beside which the others go on.
"""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import joblib
from joblib.parallel import ParallelBackendBase

from walkerkit.gap.errors import InputError, one_line, refusal

GiveUp = Callable[[tuple[Any, ...], Exception, bool], Any]
_ANSWER = 20  # s, for a cluster to answer


class Cluster(ParallelBackendBase):  # type: ignore[misc]
    """A backend of joblib made of what takes a call and returns its future.

    Attributes:
        workers: how many calls are under way at a time.
        give_up: given the arguments of a call that came to nothing, why, and whether its worker
            died, returns what is taken for its result.
    """

    supports_retrieve_callback = True

    def __init__(
        self,
        workers: int,
        send: Callable[..., Any],
        cancel: Callable[[Any], object],
        died: Callable[[Exception], bool],
    ):
        """Makes a backend.

        Args:
            workers: how many calls are under way at a time.
            send: starts a function with its arguments in another process; returns a future.
            cancel: ends what a future stands for.
            died: whether an error of a future says that a worker has died.
        """
        super().__init__()
        self.workers = workers
        self.give_up: GiveUp | None = None
        self._send = send
        self._cancel = cancel
        self._died = died
        self._calls: dict[Any, tuple[Any, ...]] = {}

    def effective_n_jobs(self, n_jobs: int) -> int:
        """The number of workers; joblib takes one for its own process."""
        return max(self.workers, 2)

    def submit(self, func: Any, callback: Callable[[Any], None]) -> Any:
        """Starts a batch of one call."""
        ((function, arguments, _),) = func.items
        future = self._send(function, *arguments)
        self._calls[future] = arguments
        future.add_done_callback(callback)
        return future

    def retrieve_result_callback(self, out: Any) -> list[Any]:
        """What a batch has returned, or what `give_up` makes of a call without a result."""
        arguments = self._calls.pop(out)
        try:
            return [out.result()]
        except Exception as error:  # whatever the engine says of a call that it could not finish
            if self.give_up is None:
                raise
            return [self.give_up(arguments, error, self._died(error))]

    def abort_everything(self, ensure_ready: bool = True) -> None:
        """Ends what is under way, on a cluster that may outlive this program."""
        for future in list(self._calls):
            self._cancel(future)
        self._calls.clear()


@contextmanager
def ray(address: str | None, workers: int | None) -> Iterator[Cluster]:
    """Ray: a cluster that runs (`auto`, `HOST:PORT`, `ray://…`), or one on this machine.

    Args:
        address: where it is, or None to start one and to end it.
        workers: calls at a time; by default as many as it has cores.

    Raises:
        InputError: Ray is not installed, or does not answer.
    """
    try:
        import ray as engine
    except ImportError:
        raise _missing("ray", "Ray") from None
    ours = not engine.is_initialized()
    if ours:
        options: dict[str, Any] = {"address": address}
        if address is None:
            os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
            count = workers or joblib.cpu_count()
            options = {"address": "local", "num_cpus": count, "include_dashboard": False}
        try:
            _reach(address)
            engine.init(**options, log_to_driver=False, logging_level=logging.ERROR)
        except Exception as error:  # of many kinds: no such host, another version, ...
            raise _silent("Ray", address, error, "ray start --head") from error
    try:
        cores = int(engine.cluster_resources().get("CPU", 1))
        remote = engine.remote(num_cpus=1, max_retries=0)(_call)
        futures: dict[Any, Any] = {}

        def send(function: Any, *arguments: Any) -> Any:
            reference = remote.remote(function, *arguments)
            future = reference.future()
            futures[future] = reference
            future.add_done_callback(futures.pop)
            return future

        def cancel(future: Any) -> None:
            reference = futures.get(future)
            if reference is not None:
                engine.cancel(reference, force=True)

        def died(error: Exception) -> bool:
            raised = engine.exceptions.RayTaskError  # by the call itself
            return isinstance(error, engine.exceptions.RayError) and not isinstance(error, raised)

        yield Cluster(workers or cores, send, cancel, died)
    finally:
        if ours:
            engine.shutdown()


@contextmanager
def dask(address: str | None, workers: int | None) -> Iterator[Cluster]:
    """Dask: a scheduler that runs (`tcp://HOST:PORT`), or one on this machine.

    Args:
        address: where it is, or None to start one and to end it.
        workers: calls at a time; by default as many as it has threads.

    Raises:
        InputError: Dask is not installed, does not answer, or has no workers.
    """
    try:
        import distributed
        from dask import config
    except ImportError:
        raise _missing("dask", "Dask") from None
    if address is not None:
        try:
            client = distributed.Client(address, timeout=_ANSWER, set_as_default=False)
        except (OSError, ValueError) as error:
            raise _silent("Dask", address, error, "dask scheduler") from error
        with client:
            yield _of_client(client, address, workers)
        return
    count = workers or joblib.cpu_count()
    with (
        config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(
            n_workers=count,
            threads_per_worker=1,
            dashboard_address=None,
            silence_logs=logging.CRITICAL,
        ) as cluster,
        distributed.Client(cluster, set_as_default=False) as client,
    ):
        yield _of_client(client, address, workers)


def _of_client(client: Any, address: str | None, workers: int | None) -> Cluster:
    from distributed import KilledWorker

    try:
        client.wait_for_workers(1, timeout=_ANSWER)
    except TimeoutError as error:
        raise _silent("Dask", address, error, "dask worker") from error

    def send(function: Any, *arguments: Any) -> Any:
        return client.submit(_call, function, *arguments, pure=False)

    def cancel(future: Any) -> None:
        future.cancel()

    def died(error: Exception) -> bool:
        return isinstance(error, KilledWorker)

    return Cluster(workers or sum(client.nthreads().values()), send, cancel, died)


def _reach(address: str | None) -> None:
    """Raises OSError where nothing listens: Ray itself would try for minutes."""
    host, _, port = (address or "").removeprefix("ray://").rpartition(":")
    if host and port.isdigit():
        socket.create_connection((host.strip("[]"), int(port)), timeout=_ANSWER).close()


def _call(function: Callable[..., Any], *arguments: Any) -> Any:
    return function(*arguments)


def _missing(extra: str, name: str) -> InputError:
    return InputError(f"{name} is not installed: pip install 'walkerkit[{extra}]'.")


def _silent(name: str, address: str | None, error: Exception, command: str) -> InputError:
    where = f" at {address}" if address else ""
    return refusal(
        f"{name} does not answer{where}: {one_line(error)}. "
        f"Start it with `{command}`, or correct --address."
    )
