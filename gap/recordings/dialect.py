"""How a CSV was written: its encoding, what separates cells, and the mark of its decimals.

    found = Dialect.of(path)            # looked at, never asked for
    found.delimiter, found.decimal      # ";" and "," where a spreadsheet is set to German
    found.notes                         # what is out of the ordinary, for the report

UTF-8 with or without a byte order mark and UTF-16 with one are read as they are. A file that is
neither is read as Latin-1, in which every byte is a character; one whose header is UTF-8 and whose
rows are not is refused, since no reading of it is right.
"""

from __future__ import annotations

import codecs
import csv
import itertools
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TextIO

from walkerkit.gap.errors import refusal

_MARKS = {codecs.BOM_UTF16_LE: "utf-16", codecs.BOM_UTF16_BE: "utf-16"}
_DELIMITERS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "bars"}
_LOOKED_AT = 50  # rows
_WITH_POINT = re.compile(r"\s*[-+]?\d*\.\d+(?:[eE][-+]?\d+)?\s*")
_WITH_COMMA = re.compile(r"\s*[-+]?\d*,\d+(?:[eE][-+]?\d+)?\s*")


@dataclass(frozen=True, kw_only=True)
class Dialect:
    """How to read a CSV.

    Attributes:
        encoding: as Python and Arrow call it.
        delimiter: between cells.
        decimal: "." or ",".
        header: names of the columns.
        notes: what a reader of the report should know of it.
    """

    encoding: str
    delimiter: str
    decimal: str
    header: tuple[str, ...]
    notes: tuple[str, ...] = ()

    @classmethod
    def of(cls, path: Path) -> Dialect:
        """Looks at a file.

        Raises:
            InputError: it has no rows, or is in two encodings at once.
        """
        encoding, notes = _encoding(path)
        with path.open(encoding=encoding) as file:
            lines = list(itertools.islice(numbered_lines(file), _LOOKED_AT + 1))
        if len(lines) < 2:
            raise refusal(
                f"{path}: it has no rows of data. Check what recorded it, or leave it out."
            )
        header, *rows = (line for _, line in lines)
        # Logs of others call their time otherwise.
        most = max(_DELIMITERS, key=lambda d: len(_cells(header, d)))
        delimiter = next((d for d in _DELIMITERS if "time" in _cells(header, d)), most)
        cells = [cell for row in rows for cell in _cells(row, delimiter)]
        commas = any(_WITH_COMMA.fullmatch(cell) for cell in cells)
        points = any(_WITH_POINT.fullmatch(cell) for cell in cells)
        decimal = "," if commas and not points else "."
        if delimiter != "," or decimal != ".":
            marks = " and decimal commas" if decimal == "," else ""
            notes = (*notes, f"its cells are separated by {_DELIMITERS[delimiter]}{marks}")
        return cls(
            encoding=encoding,
            delimiter=delimiter,
            decimal=decimal,
            header=tuple(_cells(header, delimiter)),
            notes=notes,
        )


def text_encoding(path: Path) -> str:
    """The encoding of a text file, for whoever shows a line of it."""
    return _encoding(path)[0]


def numbered_lines(file: TextIO) -> Iterator[tuple[int, str]]:
    """The lines that are not empty, numbered from 1; the first is the header."""
    return ((number, line) for number, line in enumerate(file, start=1) if line.rstrip("\n"))


def _cells(line: str, delimiter: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter), [])]


def _encoding(path: Path) -> tuple[str, tuple[str, ...]]:
    """The encoding, and what to say of it."""
    with path.open("rb") as file:
        mark = file.read(2)
        if mark in _MARKS:
            return _MARKS[mark], (f"it is in {_MARKS[mark].upper()}",)
        file.seek(0)
        said_in_utf8 = False
        for number, line in enumerate(file, start=1):
            try:
                text = line.decode()
            except UnicodeDecodeError as error:
                byte = f"byte 0x{line[error.start]:02x} at line {number}"
                if said_in_utf8:
                    raise refusal(
                        f"{path}: {byte} is not UTF-8, and what is above it is. Save the file in "
                        "one encoding, best in UTF-8."
                    ) from None
                return "latin-1", (f"{byte} is not UTF-8; the file was read as Latin-1",)
            said_in_utf8 = said_in_utf8 or not text.removeprefix("\ufeff").isascii()
    return "utf-8-sig", ()
