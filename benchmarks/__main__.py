"""Runs benchmarks and prints one table; see the package."""

from __future__ import annotations

import argparse
import importlib
import pkgutil
from pathlib import Path

from rich.console import Console
from rich.table import Table


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
    chosen = parser.parse_args()
    for name in chosen.names:
        if name not in names:
            parser.error(f"no benchmark is called {name!r}; there are {', '.join(names)}")
    table = Table("benchmark", "what", "result", "reference", "required")
    for name in chosen.names or names:
        for row in importlib.import_module(f"benchmarks.{name}").run(quick=chosen.quick):
            table.add_row(name, row.what, row.result, row.reference, row.required)
    Console().print(table)


if __name__ == "__main__":
    main()
