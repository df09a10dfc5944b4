"""`walkerkit servo`, `walkerkit hang` and `walkerkit excite`."""

from __future__ import annotations

import typer

app = typer.Typer()
