"""Benchmarks: what the project claims, measured.

    python -m benchmarks                 # all of them
    python -m benchmarks --quick         # a small part of each
    python -m benchmarks demo_seeds      # by name

A benchmark is a module of this package with `run(*, quick: bool) -> list[Row]`; one that draws
takes `out: Path | None`, too, the folder for its figures. It prints a line for each thing it tries
as it goes; its rows go into the table at the end. What a benchmark needs more modules for has a
package of its own.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Row:
    """One line of the table.

    Attributes:
        what: what was measured.
        result: what came out, with its unit.
        reference: what to hold it against, measured in the same run or known; may be empty.
        required: what the result should reach; empty where it is only told.
    """

    what: str
    result: str
    reference: str = ""
    required: str = ""
