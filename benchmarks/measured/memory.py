"""The most memory that a process has held, of itself alone."""

from __future__ import annotations

import re
import resource
from pathlib import Path


def peak(*, helpers: int = 0) -> float:
    """What this process has held at most, and so many others that it started [GiB].

    Of those that share the work the largest alone is known, and each counts as much. What
    `getrusage` says of a process itself is that of the one that it was forked from, if that is
    more.
    """
    status = Path("/proc/self/status").read_text(encoding="utf-8")
    own = re.search(r"VmHWM:\s+(\d+)", status)
    if own is None:
        raise OSError("/proc/self/status has no line VmHWM; memory is measured on Linux alone")
    others = resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss
    return (int(own.group(1)) + helpers * others) / 2**20
