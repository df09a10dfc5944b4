"""How long the package takes to import, and the program to say what it can do.

Each run is a process of its own, in turns. Imports are compared by the processor time of the
process, which other work on the machine disturbs least.
"""

from __future__ import annotations

import os
import sys
import time

import numpy as np

from benchmarks import Row

_IMPORT = "import walkerkit.actuators"
_REFERENCE = "import dm_control.mjcf"
_HELP = "import sys; sys.argv[1:] = ['--help']; from walkerkit.gap.cli import main; main()"


def run(*, quick: bool) -> list[Row]:
    """Starts processes in turns."""
    programs = [_IMPORT, _REFERENCE, _HELP]
    for program in programs:
        _seconds(program)  # compiles what is not compiled yet
    rounds = 3 if quick else 15
    times = np.array([[_seconds(program) for program in programs] for _ in range(rounds)])
    processor, wall = times[..., 0], times[..., 1]
    ours, reference, _ = processor.min(axis=0)
    ratio = np.median(processor[:, 0] / processor[:, 1])
    print(f"  import: {ours / reference:.2f}x, --help: {np.median(wall[:, 2]):.2f} s")
    return [
        Row(
            what="import walkerkit.actuators",
            result=f"{ours:.2f} s, {ours / reference:.2f}x (median of rounds {ratio:.2f}x)",
            reference=f"import dm_control.mjcf: {reference:.2f} s",
            required="<= 1.3x",
        ),
        Row(
            what="walkerkit --help",
            result=f"{np.median(wall[:, 2]):.2f} s (least {wall[:, 2].min():.2f} s)",
            reference=f"{processor[:, 2].min():.2f} s of processor",
            required="<= 0.5 s",
        ),
    ]


def _seconds(program: str) -> tuple[float, float]:
    """Processor time and wall time of a process that runs a program [s]."""
    quiet = (os.POSIX_SPAWN_OPEN, 1, os.devnull, os.O_WRONLY, 0)
    start = time.perf_counter()
    process = os.posix_spawn(
        sys.executable, [sys.executable, "-c", program], os.environ, file_actions=[quiet]
    )
    _, status, usage = os.wait4(process, 0)
    if status:
        raise RuntimeError(f"{program!r} ended with {os.waitstatus_to_exitcode(status)}")
    return usage.ru_utime + usage.ru_stime, time.perf_counter() - start
