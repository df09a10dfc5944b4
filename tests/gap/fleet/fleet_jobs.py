"""Jobs for the engines; they live in a module, so that workers can import them."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path

from walkerkit.gap.errors import InputError

SLOW = 60.0  # s; a job that waits to be killed


def act(job: tuple[str, int, str]) -> tuple[int, int]:
    """Does what it is told: (what, number, folder) gives the number squared, and the process."""
    what, number, folder = job
    pid = os.getpid()
    if what == "wait once":
        mark = Path(folder) / "begun"
        if not mark.exists():
            mark.with_suffix(".new").write_text(str(pid))
            mark.with_suffix(".new").rename(mark)
            time.sleep(SLOW)
    elif what == "die":
        os.kill(pid, signal.SIGKILL)
    elif what == "raise":
        raise KeyError("knee")
    elif what == "refuse":
        raise InputError("leg.xml: no such file. Check the path.")
    return number**2, pid
