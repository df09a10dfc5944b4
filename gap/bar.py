"""How far a command is: a progress bar on standard error, where that is a terminal.

    with progress_bar() as progress:
        progress("comparing", 0.3)

Where it is none, a command that takes long may say the stages in lines instead.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

Progress = Callable[[str, float], None]


@contextmanager
def bar_on_stderr() -> Iterator[Any]:
    """A progress bar on standard error, where that is a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    with Bar(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        yield bar


def stages(bar: Any, *, lines: bool = False) -> Progress:
    """Has a bar show what is being done and how far it is; where there is none, maybe lines."""
    task, start, told = bar.add_task("starting", total=1.0), time.monotonic(), set[str]()

    def show(stage: str, done: float) -> None:
        bar.update(task, description=stage, completed=done)
        if lines and bar.disable and stage not in told:
            told.add(stage)
            say(bar, f"{time.monotonic() - start:.0f} s: {stage}")

    return show


def say(bar: Any, line: str) -> None:
    """A line above the bar, on standard error."""
    bar.console.print(line, markup=False, highlight=False, soft_wrap=not bar.console.is_terminal)


@contextmanager
def progress_bar(*, lines: bool = False) -> Iterator[Progress]:
    """The bar for one piece of work."""
    with bar_on_stderr() as bar:
        yield stages(bar, lines=lines)
