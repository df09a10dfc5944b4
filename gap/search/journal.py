"""What a search has finished, on disk, so that one that was killed goes on from there.

    with Journal.open(path, key) as journal, journal.kept():
        name_effects(problem, effects)     # steps that the file has are read, others are added
    path.unlink()

A search is deterministic, so its steps come in the same order with the same inputs, and each is
known by its number and a digest of its inputs. The file has one JSON line per finished step, which
ends with its own digest: a line that was cut short by a crash is left out, and so is a whole file
of another key. Nothing is unpickled.
"""

from __future__ import annotations

import base64
import contextlib
import fcntl
import hashlib
import json
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextvars import ContextVar
from io import FileIO
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.search.effort import spend, spent
from walkerkit.walkers.batch import count_warnings, warnings_counted

FloatArray = NDArray[np.float64]
Result = TypeVar("Result")

_CURRENT: ContextVar[Journal | None] = ContextVar("journal", default=None)


class Journal:
    """The finished steps of one search.

    Args:
        file: open for reading and appending.
        key: of everything that the search depends on.
    """

    def __init__(self, file: FileIO, key: str):
        self._file = file
        self._numbers = [0]
        self._unwritten: list[bytes] = []
        file.seek(0)
        header, *lines = file.readall().split(b"\n")
        self._known: dict[str, Any] = {}
        size = 0
        if _content(header) == {"key": key}:
            size = len(header) + 1
            for line in lines:
                step = _content(line)
                if step is None:
                    break
                self._known[step["step"]] = step
                size += len(line) + 1
        self._size = size
        file.truncate(size)
        if not size:
            self._append(_line({"key": key}))

    @classmethod
    @contextlib.contextmanager
    def open(cls, path: Path, key: str) -> Iterator[Journal]:
        """Opens or makes a file that no other process writes meanwhile.

        Raises:
            BlockingIOError: another process has it.
            OSError: it cannot be written.
        """
        with path.open("a+b", buffering=0) as file:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            yield cls(file, key)

    def __len__(self) -> int:
        return len(self._known)

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """Makes `finished` read and write this journal."""
        token = _CURRENT.set(self)
        try:
            yield
        finally:
            _CURRENT.reset(token)

    def finished(
        self,
        inputs: str,
        make: Callable[[], Result],
        pack: Callable[[Result], Any],
        unpack: Callable[[Any], Result],
    ) -> Result:
        """The result of a step, from the file where it has it."""
        self._numbers[-1] += 1
        step = f"{'.'.join(map(str, self._numbers))} {inputs}"
        known = self._known.get(step)
        if known is not None:
            count_warnings(known["warnings"])
            spend(known["steps"])
            return unpack(known["result"])
        before, steps = warnings_counted(), spent()
        self._numbers.append(0)
        try:
            result = make()
        finally:
            self._numbers.pop()
        counted = Counter(warnings_counted())
        counted.subtract(before)
        content = {
            "step": step,
            "result": pack(result),
            "warnings": dict(+counted),
            "steps": spent() - steps,
        }
        self._write(_line(content))
        return result

    def _write(self, line: bytes) -> None:
        """Appends a line; what a full disk does not take now is tried again at the next step."""
        self._unwritten.append(line)
        with contextlib.suppress(OSError):
            self._append(b"".join(self._unwritten))
            self._unwritten.clear()

    def _append(self, data: bytes) -> None:
        left = memoryview(data)
        try:
            while left:
                left = left[self._file.write(left) :]
            os.fsync(self._file.fileno())
        except OSError:
            self._file.truncate(self._size)
            raise
        self._size += len(data)


def finished(
    inputs: str,
    make: Callable[[], Result],
    pack: Callable[[Result], Any],
    unpack: Callable[[Any], Result],
) -> Result:
    """What `make` returns, or what it returned in a run that was killed later.

    Args:
        inputs: a digest of what the result depends on beside the steps before.
        make: the work.
        pack: the result as something that JSON can hold.
        unpack: that back as a result.
    """
    journal = _CURRENT.get()
    if journal is None:
        return make()
    return journal.finished(inputs, make, pack, unpack)


def digest(*parts: str | bytes | FloatArray) -> str:
    """A short name for some inputs."""
    whole = hashlib.sha256()
    for part in parts:
        data = part.encode() if isinstance(part, str) else bytes(part)
        whole.update(len(data).to_bytes(8, "little") + data)
    return whole.hexdigest()[:32]


def packed(arrays: Sequence[FloatArray]) -> list[dict[str, Any]]:
    """Arrays as JSON, bit for bit."""
    return [
        {"shape": array.shape, "float64": base64.b64encode(array.tobytes()).decode()}
        for array in arrays
    ]


def unpacked(content: Sequence[dict[str, Any]]) -> list[FloatArray]:
    """What was packed."""
    return [
        np.frombuffer(base64.b64decode(one["float64"])).reshape(one["shape"]).copy()
        for one in content
    ]


def _line(content: dict[str, Any]) -> bytes:
    text = json.dumps(content, separators=(",", ":"))
    return f"{text}\t{digest(text)}\n".encode()


def _content(line: bytes) -> Any:
    """What a line holds, or None of one that is not whole."""
    text, _, seal = line.rpartition(b"\t")
    return json.loads(text) if text and seal == digest(text).encode() else None
