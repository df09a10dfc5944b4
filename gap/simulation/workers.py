"""Other processes of this machine that share the work on what Python does step by step.

    done = side_by_side(function, jobs)      # the first job in this process, each other in its own

They are started when they are first needed, know nothing but what they are sent, and end when they
have had nothing to do for a while, or when this process ends.
"""

from __future__ import annotations

import pickle
import signal
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import closing
from multiprocessing.connection import Connection
from typing import Any, Generic, TypeVar

from joblib.externals.loky.backend import get_context
from joblib.externals.loky.cloudpickle_wrapper import dumps

from walkerkit.walkers.batch import count_warnings, counted_warnings

Job = TypeVar("Job")
Result = TypeVar("Result")

_IDLE = 60.0  # s after which a process ends
_FREE = threading.Lock()
_free: list[_Worker] = []


def side_by_side(function: Callable[[Job], Result], jobs: Sequence[Job]) -> list[Result]:
    """What a function makes of each of some jobs, each in a process of its own.

    Args:
        function: called with one job; both are pickled, laws that a script defines among them.
        jobs: what it is called with, at least one.

    Returns:
        The results, in the order of the jobs. The jobs of processes that died, as those do that the
        system has no memory for, and those that they could not read are done in this one.

    Raises:
        Exception: what the function raised.
    """
    sent = [_Sent(function, job) for job in jobs[1:]]
    try:
        return [function(jobs[0]), *(one.result() for one in sent)]
    finally:
        for one in sent:
            one.end()


class _Worker:
    """A process that waits for jobs."""

    def __init__(self) -> None:
        # Loky's processes do not run the user's script again.
        context = get_context("loky")
        self.pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
        self._process.start()
        theirs.close()

    def end(self) -> None:
        """Ends the process, whatever it does."""
        self.pipe.close()
        self._process.terminate()
        self._process.join()


class _Sent(Generic[Job, Result]):
    """A job that is being done elsewhere."""

    def __init__(self, function: Callable[[Job], Result], job: Job):
        self._function, self._job = function, job
        self._worker: _Worker | None = None
        with _FREE:
            known = [_free.pop()] if _free else []
        for worker in (*known, None):
            try:
                self._worker = worker or _Worker()
                self._worker.pipe.send(sys.path)
                # A user's laws may come from a script, or from a folder that joined the path late.
                self._worker.pipe.send_bytes(dumps((function, job)))
            except OSError:  # it has ended, or cannot be started
                self.end()
            else:
                return

    def result(self) -> Result:
        """What the function made of it."""
        if self._worker is None:
            return self._function(self._job)
        try:
            answer = self._worker.pipe.recv()
        except (EOFError, OSError):
            self.end()
            return self._function(self._job)
        with _FREE:
            _free.append(self._worker)
        self._worker = None
        if answer is None:
            return self._function(self._job)
        result, error, warned = answer
        count_warnings(warned)
        if error is not None:
            raise error
        return result  # type: ignore[no-any-return]

    def end(self) -> None:
        """Ends the process where its result is not wanted any more."""
        if self._worker is not None:
            self._worker.end()
            self._worker = None


def _serve(pipe: Connection) -> None:
    """Does jobs as they come: their results, errors and MuJoCo's warnings."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the process that asks
    with closing(pipe):
        while pipe.poll(_IDLE):
            try:
                sys.path[:] = pipe.recv()
                sent = pipe.recv_bytes()
            except EOFError:
                return
            try:
                function, job = pickle.loads(sent)
            except Exception:  # it needs what the asking process alone has
                pipe.send(None)
                continue
            result: Any = None
            error = None
            with counted_warnings() as counted:
                try:
                    result = function(job)
                except Exception as raised:  # raised where the job comes from
                    error = raised
            pipe.send((result, error, dict(counted)))
