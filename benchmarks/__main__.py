"""Runs benchmarks and prints one table; see the package."""

from __future__ import annotations

import argparse
import contextlib
import importlib
import inspect
import os
import pkgutil
import platform
import sys
from datetime import date
from pathlib import Path

from rich.console import Console
from rich.table import Table

_WIDTH = 160  # where the output goes to a file


def main() -> None:
    """Runs the benchmarks that the command line names, or all."""
    folder = Path(__file__).parent
    names = sorted(
        module.name
        for module in pkgutil.iter_modules([str(folder)])
        if module.name != "__main__" and not module.ispkg
    )
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("names", nargs="*", metavar="name", help=f"of {', '.join(names)}")
    parser.add_argument("--quick", action="store_true", help="a small part of each")
    parser.add_argument("--out", type=Path, help="folder for figures, of benchmarks that draw some")
    chosen = parser.parse_args()
    for name in chosen.names:
        if name not in names:
            parser.error(f"no benchmark is called {name!r}; there are {', '.join(names)}")
    table = Table(
        *("benchmark", "what", "measured", "reference", "required"),
        title=f"{date.today()}, {_machine()}",
        title_justify="left",
    )
    for name in chosen.names or names:
        module = importlib.import_module(f"benchmarks.{name}")
        draws = "out" in inspect.signature(module.run).parameters
        given = {"out": chosen.out} if draws else {}
        for row in module.run(quick=chosen.quick, **given):
            table.add_row(name, row.what, row.result, row.reference, row.required)
    Console(width=None if sys.stdout.isatty() else _WIDTH).print(table)


def _machine() -> str:
    """The processor, its cores that may be used, and what runs on it."""
    lines = [platform.machine()]
    with contextlib.suppress(OSError):
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
        lines = [line.partition(": ")[2] for line in text.splitlines() if "model name" in line]
    cores = len(os.sched_getaffinity(0))
    return f"{next(iter(lines), 'unknown')}, {cores} cores, Python {platform.python_version()}"


if __name__ == "__main__":
    main()
