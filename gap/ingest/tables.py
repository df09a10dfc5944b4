"""Tables as logs: CSV, Parquet, JSON and JSON lines, with lists in their cells or not.

    log = read_table(Path("plotjuggler.csv"))
    log.topics[""].clocks["__time"], log.columns["/joint_states/hip/position"]

A list in a cell becomes one column for each of its numbers, `<column>[0]` and so on; what is nested
becomes paths, `motorState[3].q`. Columns that tell the time become clocks.
"""

from __future__ import annotations

import decimal
import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.csv
import pyarrow.parquet
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError, one_line, refusal
from walkerkit.gap.ingest.gather import Gather, flat
from walkerkit.gap.ingest.log import Column, Log, Stamps, Topic
from walkerkit.gap.ingest.words import is_time
from walkerkit.gap.recordings.dialect import Dialect
from walkerkit.gap.recordings.files import MOST_VALUES, check_file

Array = NDArray[Any]

_EPOCH = 1e8  # s; a clock that shows more counts from 1970
_PAIRS = (
    ("sec", "nanosec", 1),
    ("secs", "nsecs", 1),
    ("tv_sec", "tv_nsec", 1),
    ("tv_sec", "tv_usec", 1000),
)
"""Ends of the names of two columns that tell one time, and the second's nanoseconds."""
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?|nan|NaN")
_TOPIC = ("topic", "channel")


def read_table(path: Path) -> Log:
    """Reads all numbers of a table.

    Raises:
        InputError: it cannot be read, or has no row or no number.
    """
    check_file(path)
    suffix = path.suffix.lower()
    try:
        if suffix in (".jsonl", ".ndjson", ".json"):
            return _read_json(path)
        return _read_csv(path) if suffix in (".csv", ".tsv", ".txt") else _read_parquet(path)
    except InputError:
        raise
    except Exception as error:  # parsers fail in many ways on a broken file; each is the file's
        raise refusal(
            f"{path}: it cannot be read as {suffix}: {one_line(error)}. Write the file again."
        ) from error


def log_of(path: Path, arrays: Mapping[str, Array], *, name: str | None = None, **more: Any) -> Log:
    """A log of columns that may be of several lengths, each length with clocks of its own.

    Args:
        path: where they are from.
        arrays: name to (T,) numbers.
        name: of the log; by default that of the file.
        more: other fields of the log.

    Raises:
        InputError: there is no number, or more than can be handled.
    """
    if sum(map(len, arrays.values())) > MOST_VALUES:
        raise refusal(f"{path}: it has more than {MOST_VALUES} numbers. Cut it into several logs.")
    lengths = {len(values) for values in arrays.values()} - {0, 1}
    if not lengths:
        raise refusal(f"{path}: it has no rows of numbers. Check what recorded it.")
    label = {size: "" if len(lengths) == 1 else f"{size} samples" for size in lengths}
    arrays = {n: values for n, values in arrays.items() if len(values) in lengths}
    clocks: dict[int, dict[str, Stamps]] = {size: {} for size in lengths}
    for column, stamps in _stamped(arrays).items():
        clocks[len(stamps)][column] = stamps
    known = {column for found in clocks.values() for column in found}
    return Log(
        path=path,
        name=name or path.stem,
        topics={label[size]: Topic(size=size, clocks=clocks[size]) for size in sorted(lengths)},
        columns={
            column: Column(
                topic=label[len(values)],
                values=values.astype(float),
                given=np.isfinite(values.astype(float)),
            )
            for column, values in arrays.items()
            if column not in known
        },
        **more,
    )


def _stamped(arrays: Mapping[str, Array]) -> dict[str, Stamps]:
    """The columns that tell the time, those in two parts put together."""
    found: dict[str, Stamps] = {}
    for column, values in arrays.items():
        for first, second, factor in _PAIRS:
            head = column.removesuffix(first)
            other = arrays.get(f"{head}{second}")
            if head == column or other is None or head[-1:].isalnum():
                continue
            whole = np.nan_to_num(values).astype(np.int64) * 10**9
            found[head.rstrip("./_") or "time"] = whole + other.astype(np.int64) * factor
    for column, values in arrays.items():
        if is_time(column) and not any(column.startswith(f"{pair}.") for pair in found):
            kept = values[np.isfinite(values)] if values.dtype.kind == "f" else values
            if len(kept) > 1 and np.all(np.diff(kept) >= 0):
                found[column] = values
    return found


def _read_csv(path: Path) -> Log:
    dialect = Dialect.of(path)
    twice = next((n for k, n in enumerate(dialect.header) if n and n in dialect.header[:k]), None)
    if twice is not None:
        raise refusal(f"{path}: two columns are called {twice!r}. Rename one.")
    table = _parsed(path, dialect, {})
    names = [name for name in table.column_names if name]
    columns: dict[str, Array] = {}
    for name in names:
        values = table.column(name)
        epoch = is_time(name) and pyarrow.types.is_floating(values.type)
        if epoch and np.nanmax(np.abs(values.to_numpy()), initial=0.0) > _EPOCH:
            # A float keeps a quarter of a microsecond of them, the text keeps all.
            text = _parsed(path, dialect, {name: pyarrow.string()}).column(name)
            exact = _nanoseconds(text.to_pylist())
            columns[name] = values.to_numpy() if exact is None else exact
        else:
            columns |= _numbers(name, values)
    return log_of(path, columns, notes=dialect.notes)


def _parsed(path: Path, dialect: Dialect, types: Mapping[str, Any]) -> Any:
    return pyarrow.csv.read_csv(
        path,
        read_options=pyarrow.csv.ReadOptions(encoding=dialect.encoding.removesuffix("-sig")),
        parse_options=pyarrow.csv.ParseOptions(delimiter=dialect.delimiter),
        convert_options=pyarrow.csv.ConvertOptions(
            decimal_point=dialect.decimal, column_types=dict(types), include_columns=[*types]
        ),
    )


def _nanoseconds(texts: Sequence[str]) -> NDArray[np.int64] | None:
    """Seconds as text in whole nanoseconds, None where one of them is no number."""
    try:
        whole = [int((decimal.Decimal(text) * 10**9).to_integral_value()) for text in texts]
    except (decimal.InvalidOperation, TypeError):
        return None
    return np.array(whole, np.int64)


def _numbers(name: str, values: Any) -> dict[str, Array]:
    """The numbers of one column of a table, several where its cells are lists."""
    kind = values.type
    types = pyarrow.types
    if types.is_timestamp(kind):
        return {name: values.cast(pyarrow.timestamp("ns")).cast(pyarrow.int64()).to_numpy()}
    if types.is_integer(kind) and not values.null_count:
        return {name: values.to_numpy().astype(np.int64)}
    if types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind):
        return {name: values.cast(pyarrow.float64(), safe=False).to_numpy().astype(float)}
    if types.is_null(kind):
        return {}
    if types.is_string(kind) or types.is_large_string(kind):
        return _listed(name, [_of_text(text) for text in values.to_pylist()])
    if types.is_nested(kind):
        return _listed(name, values.to_pylist())
    return {}


def _of_text(text: str | None) -> Any:
    """The list, mapping or nothing that the text of a cell says."""
    if not text or (text.strip()[:1] not in "[({" and "array" not in text):
        return None
    try:
        return json.loads(text)
    except ValueError:
        return [float(number) for number in _NUMBER.findall(text)]


def _listed(name: str, cells: Sequence[Any]) -> dict[str, Array]:
    samples = [{} if cell is None else flat(cell, name) for cell in cells]
    return {
        column: np.array([sample.get(column, np.nan) for sample in samples])
        for column in dict.fromkeys(column for sample in samples for column in sample)
    }


def _read_parquet(path: Path) -> Log:
    with pyarrow.parquet.ParquetFile(path) as file:
        table = file.read()
    return log_of(path, numbers_of(table))


def numbers_of(table: Any) -> dict[str, Array]:
    """All numbers of an Arrow table, by column."""
    columns: dict[str, Array] = {}
    for name in table.column_names:
        columns |= _numbers(name, table.column(name))
    return columns


def _read_json(path: Path) -> Log:
    with path.open(encoding="utf-8-sig") as file:
        if path.suffix.lower() == ".json":
            whole = json.load(file)
            if isinstance(whole, dict):
                whole = next((v for v in whole.values() if _is_rows(v)), whole)
            if isinstance(whole, dict):
                return log_of(path, _of_arrays(whole))
            rows = whole if _is_rows(whole) else []
        else:
            rows = list(_lines(path, file))
    if not rows:
        raise refusal(f"{path}: it has no rows of data. Check what recorded it, or leave it out.")
    key = next((k for k in _TOPIC if all(isinstance(row.get(k), str) for row in rows)), None)
    if key is None:
        samples = [flat(row) for row in rows]
        exact = {
            column: [sample.get(column, np.nan) for sample in samples]
            for column in dict.fromkeys(column for sample in samples for column in sample)
        }
        whole_numbers = _whole_numbers(rows)
        return log_of(path, {c: whole_numbers.get(c, np.array(v, float)) for c, v in exact.items()})
    gather = Gather()
    for row in rows:
        topic = row[key]
        sample = {f"{topic}/{p}": v for p, v in flat({**row, key: None}).items()}
        clocks = {c: sample[c] for c in sample if is_time(c.removeprefix(f"{topic}/"))}
        named = {c.removeprefix(f"{topic}/"): v for c, v in clocks.items()}
        gather.add(topic, "", named, {c: v for c, v in sample.items() if c not in clocks})
    topics, columns = gather.done()
    return Log(path=path, name=path.stem, topics=topics, columns=columns)


def _whole_numbers(rows: Sequence[Mapping[str, Any]]) -> dict[str, NDArray[np.int64]]:
    """Top-level columns of whole numbers: nanoseconds of the epoch are more than a float holds."""
    return {
        column: np.array([row[column] for row in rows], np.int64)
        for column in rows[0]
        if all(type(row.get(column)) is int for row in rows)
    }


def _is_rows(value: Any) -> bool:
    return isinstance(value, list) and bool(value) and all(isinstance(v, dict) for v in value)


def _lines(path: Path, file: Iterator[str]) -> Iterator[dict[str, Any]]:
    for number, line in enumerate(file, start=1):
        if not line.strip():
            continue
        try:
            row = json.loads(line)
        except ValueError as error:
            raise refusal(
                f"{path}: line {number} is no JSON: {one_line(error)}. Mend or delete the line."
            ) from None
        if not isinstance(row, dict):
            raise refusal(f"{path}: line {number} is no JSON object, as {{...}}. Write one a line.")
        yield row


def _of_arrays(whole: Mapping[str, Any], path: str = "") -> dict[str, Array]:
    """The columns of a JSON object that has an array for each signal."""
    columns: dict[str, Array] = {}
    for key, value in whole.items():
        name = f"{path}.{key}" if path else key
        if isinstance(value, dict):
            columns |= _of_arrays(value, name)
        elif isinstance(value, list) and value:
            nested = any(isinstance(entry, list | dict) for entry in itertools.islice(value, 5))
            if nested:
                columns |= _listed(name, value)
            elif all(isinstance(entry, int | float) or entry is None for entry in value):
                columns[name] = np.array(value, float)
    return columns
