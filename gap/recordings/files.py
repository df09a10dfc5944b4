"""Reading and writing columns of numbers as CSV, Parquet or NPZ; what they mean is not known here.

columns, notes = read(Path("walk.csv"), lambda names: names)   # name to (T,) array
write(Path("walk.parquet"), columns)                    # under its name only once complete

Numbers survive each format bit for bit. Whatever makes a file unreadable raises InputError.
"""

from __future__ import annotations

import csv
import io
import itertools
import re
import uuid
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
import numpy.typing as npt
import pyarrow
import pyarrow.csv
import pyarrow.parquet

from walkerkit.actuators.networks.npz import open_npz
from walkerkit.gap.errors import InputError, closest, one_line, refusal
from walkerkit.gap.recordings.dialect import Dialect, numbered_lines, text_encoding

Values = npt.NDArray[Any]
Columns = Mapping[str, npt.NDArray[np.float64]]
Choose = Callable[[list[str]], list[str]]
Read = tuple[dict[str, Values], tuple[str, ...]]
Reader = Callable[[Path, Choose], Read]
Writer = Callable[[BinaryIO, Columns], None]

MOST_VALUES = 2**28
"""Numbers in the columns of one file that are read: two gigabytes of them."""


def read(path: Path, choose: Choose) -> Read:
    """Reads columns of a file.

    Args:
        path: a .csv, .parquet or .npz file.
        choose: given the names of all columns, returns those to read; may raise InputError.

    Returns:
        Name to values, of whatever type the file has; and what is out of the ordinary about it.

    Raises:
        InputError: the file is missing, empty, of another format or broken.
    """
    check_file(path)
    reader, _ = _format(path)
    try:
        return reader(path, choose)
    except InputError:
        raise
    except Exception as error:  # parsers fail in many ways on a broken file; each is the file's
        raise refusal(
            f"{path}: it cannot be read as {path.suffix}: {one_line(error)}. Write the file again."
        ) from error


def write(path: Path, columns: Columns) -> None:
    """Writes columns of one length; an existing file is replaced in one step, when all is written.

    Args:
        path: a .csv, .parquet or .npz file.
        columns: name to (T,) values.

    Raises:
        InputError: the format is unknown, or the path cannot be a file.
    """
    _, writer = _format(path)
    if not path.parent.is_dir():
        raise refusal(f"{path}: the folder {path.parent} does not exist. Make it.")
    if path.is_dir():
        raise refusal(f"{path}: this is a folder. Name a file.")
    temporary = path.with_name(f".{uuid.uuid4().hex}.tmp")
    try:
        with temporary.open("xb") as file:
            writer(file, columns)
        temporary.replace(path)
    finally:
        temporary.unlink(missing_ok=True)


def check_file(path: Path) -> None:
    """Raises InputError unless `path` is a file with something in it; names the closest files."""
    try:
        size = path.stat().st_size
    except FileNotFoundError:
        folder = path.parent
        problem = (
            f"no such file{closest(path.name, _files(folder))}"
            if folder.is_dir()
            else f"the folder {folder} does not exist"
        )
        raise refusal(f"{path}: {problem}. Check the path.") from None
    except (OSError, ValueError) as error:
        raise refusal(f"{path}: cannot be opened: {error}. Check the path.") from error
    if path.is_dir():
        raise refusal(f"{path}: this is a folder. Name a file in it.")
    if not size:
        raise refusal(f"{path}: the file is empty. Write it again.")


def describe_row(source: Path | None, row: int) -> str:
    """Says where row `row` (counted from 0) of the data is: its number, and the line of a CSV."""
    text = f"row {row + 1}"
    if source is None or source.suffix.lower() != ".csv" or not source.is_file():
        return text
    with source.open(encoding=text_encoding(source)) as file:
        number, _ = next(itertools.islice(numbered_lines(file), row + 1, None), (None, ""))
    return text if number is None else f"{text} (line {number})"


def is_recording(path: Path) -> bool:
    """Whether the suffix is one that `read` knows."""
    return path.suffix.lower() in _FORMATS


def _files(folder: Path) -> list[str]:
    try:
        return [file.name for file in folder.iterdir() if file.is_file()]
    except OSError:
        return []  # only the hint is lost


def _read_csv(path: Path, choose: Choose) -> Read:
    dialect = Dialect.of(path)
    names = list(dialect.header)
    chosen = choose(names)
    _check_size(path, path.stat().st_size // 2, 1)  # a digit and a comma each, at least

    # pyarrow is exact in all versions; pandas deprecates the option that makes it so. Only a single
    # thread numbers the rows in its messages.
    try:
        table = pyarrow.csv.read_csv(
            path,
            read_options=pyarrow.csv.ReadOptions(
                use_threads=False, encoding=dialect.encoding.removesuffix("-sig")
            ),
            parse_options=pyarrow.csv.ParseOptions(delimiter=dialect.delimiter),
            convert_options=pyarrow.csv.ConvertOptions(decimal_point=dialect.decimal),
        )
    except pyarrow.ArrowInvalid as error:
        ragged = re.search(r"Row #(\d+): Expected (\d+) columns, got (\d+)", str(error))
        if ragged is None:
            raise
        number, expected, actual = map(int, ragged.groups())
        commas = actual > expected and dialect.delimiter == ","
        raise refusal(
            f"{path}: {describe_row(path, number - 2)} has {actual} cells and the header has "
            f"{expected}. Complete the row or delete it"
            + ("; if its decimals have commas, separate the cells by ';'." if commas else ".")
        ) from error
    columns = {name: table.column(names.index(name)).to_numpy() for name in chosen}
    del table
    pyarrow.default_memory_pool().release_unused()  # of an hour's log some hundred MB
    return columns, dialect.notes


def _read_parquet(path: Path, choose: Choose) -> Read:
    with pyarrow.parquet.ParquetFile(path) as file:
        chosen = choose(list(file.schema_arrow.names))
        _check_size(path, file.metadata.num_rows, len(chosen))
        table = file.read(columns=chosen)
    return {name: table.column(name).to_numpy() for name in chosen}, ()


def _read_npz(path: Path, choose: Choose) -> Read:
    with path.open("rb") as file:  # np.load leaves a broken file open
        archive = open_npz(file, most_bytes=8 * MOST_VALUES)
        columns = {}
        for name in choose(list(archive.names)):
            try:
                columns[name] = archive[name]
            except ValueError as error:
                raise refusal(
                    f"{path}: column {name!r}: {one_line(error)}. Save it as an array of float64."
                ) from error
    return columns, ()


def _check_size(path: Path, rows: int, columns: int) -> None:
    if rows * columns > MOST_VALUES:
        raise refusal(
            f"{path}: {rows} rows of {columns} columns are more than {MOST_VALUES} numbers. Cut it "
            "into several recordings."
        )


def _write_csv(file: BinaryIO, columns: Columns) -> None:
    text = io.TextIOWrapper(file, encoding="utf-8", newline="")
    writer = csv.writer(text, lineterminator="\n")  # writes repr of a float, which is exact
    writer.writerow(columns)
    writer.writerows(zip(*(values.tolist() for values in columns.values()), strict=True))
    text.flush()
    text.detach()


def _write_parquet(file: BinaryIO, columns: Columns) -> None:
    pyarrow.parquet.write_table(pyarrow.table(dict(columns)), file)


def _write_npz(file: BinaryIO, columns: Columns) -> None:
    arrays: dict[str, Any] = dict(columns)
    np.savez(file, **arrays)


_FORMATS: dict[str, tuple[Reader, Writer]] = {
    ".csv": (_read_csv, _write_csv),
    ".parquet": (_read_parquet, _write_parquet),
    ".npz": (_read_npz, _write_npz),
}


def _format(path: Path) -> tuple[Reader, Writer]:
    try:
        return _FORMATS[path.suffix.lower()]
    except KeyError:
        raise refusal(
            f"{path}: {path.suffix or 'no suffix'!r} is no format of recordings. "
            f"Save it as one of {', '.join(_FORMATS)}."
        ) from None
