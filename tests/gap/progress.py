"""The lines by which a search that nobody watches says how far it is."""

from __future__ import annotations

import re

_LINE = re.compile(
    r"\d+ s: [\w ]+|First answer after \d+ s: a plain fit of .* Looking for what else is missing\."
)


def without_progress(told: str) -> str:
    """What a program said on standard error beside that."""
    lines = told.splitlines(keepends=True)
    return "".join(line for line in lines if not _LINE.fullmatch(line.strip()))
