"""Recordings, manifests and weights: files of numbers, by people and by machines."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet
from hypothesis import strategies as st

from benchmarks.fuzzing.case import Case
from walkerkit.actuators.networks import Lstm, Mlp
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.tidy import tidied

COLUMNS = (
    *("time", "knee/position", "knee/position_target", "knee/velocity", "knee/effort"),
    *("hip/position", "hip/effort_target", "knee/current", "voltage", "base/quaternion_w"),
)
ODD_COLUMNS = (
    *(
        "Time",
        "time ",
        "",
        "/position",
        "knee/position",
        "a/b/position",
        "knee",
        "°C",
        "knie\u0301",
    ),
    *("=cmd|' /C calc'!A0", "<script>alert(1)</script>/position", "\x1b[31m/position", "t" * 300),
    *("../../x/position", "knee/\n/position", '"', "base/position_x", "knee/position_target,"),
)
ODD_CELLS = (
    *(
        "nan",
        "NaN",
        "inf",
        "-inf",
        "",
        " ",
        "1e999",
        "1e-999",
        "0x10",
        "1_000",
        "1,5",
        "1.2.3",
        "²",
    ),
    *("true", "null", "12:30", "2024-01-01T00:00:00", "1 rad", "\x00", "9" * 400, "'1", '"', "−1"),
)
_NUMBERS = ("0", "1", "-1", "1e300", "-1e300", "5e-324", "49.9", "50.1", "180")


def _changed(content: bytes) -> st.SearchStrategy[bytes]:
    """The same, or with bytes changed, cut off, put in or doubled."""

    def change(edits: list[tuple[float, int, int]]) -> bytes:
        changed = bytearray(content)
        for place, how, byte in edits:
            at = int(place * len(changed))
            if how == 0 and at < len(changed):
                changed[at] = byte
            elif how == 1:
                del changed[at:]
            elif how == 2:
                changed[at:at] = bytes([byte]) * 3
            elif how == 3:
                changed[at:at] = changed[at // 2 : at]
        return bytes(changed)

    edit = st.tuples(st.floats(0, 1, exclude_max=True), st.integers(0, 3), st.integers(0, 255))
    return st.one_of(st.just(content), st.lists(edit, min_size=1, max_size=3).map(change))


@st.composite
def _csv(draw: st.DrawFn) -> bytes:
    names = list(draw(st.permutations(COLUMNS[:5]))[: draw(st.integers(1, 5))])
    if draw(st.booleans()):
        names[:1] = ["time", *names[:1]] if names[0] != "time" else names[:1]
    if draw(st.integers(0, 3)) == 0:
        names.append(draw(st.sampled_from((*ODD_COLUMNS, *COLUMNS))))
    step = draw(st.sampled_from((0.002, 0.01, 2.0, 2000.0, 2e6, 0.0, -0.01, 1e-9)))
    start = draw(st.sampled_from((0.0, 1.7e9, -5.0, 1e18)))
    # Numbers are not worth the bookkeeping of a draw each.
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    rows = [
        [repr(start + row * step) if n == "time" else f"{rng.normal():.4f}" for n in names]
        for row in range(draw(st.integers(0, 30)))
    ]
    for _ in range(draw(st.integers(0, 2)) if rows else 0):
        cells = rows[rng.integers(len(rows))]
        cells[rng.integers(len(cells))] = draw(st.sampled_from((*ODD_CELLS, *_NUMBERS)))
    if rows and draw(st.integers(0, 9)) == 0:
        rows[rng.integers(len(rows))].append("1")
    comma = draw(st.sampled_from((",", ",", ",", ";", "\t", "|", " ")))
    end = draw(st.sampled_from(("\n", "\n", "\r\n", "\r", "\n\n")))
    text = end.join(comma.join(cells) for cells in (names, *rows))
    if comma != "," and draw(st.booleans()):
        text = text.replace(".", ",")
    text = draw(st.sampled_from(("", "", "\ufeff", "# log\n", end))) + text + end
    encoding = draw(st.sampled_from(("utf-8", "utf-8", "latin-1", "utf-16", "utf-32", "cp437")))
    return draw(_changed(text.encode(encoding, "replace")))


_DTYPES = ("f8", "f4", "i4", "u1", "?", "c16", "U3", "S2", "M8[s]", "O", "f2")


@st.composite
def _arrays(draw: st.DrawFn) -> dict[str, Any]:
    names = draw(st.lists(st.sampled_from(COLUMNS), min_size=1, max_size=5, unique=True))
    names = list(dict.fromkeys(("time", *names, "knee/position", "knee/position_target")))
    length = draw(st.integers(0, 12))
    columns: dict[str, Any] = {name: np.linspace(0, 0.1, length) for name in names}
    if draw(st.booleans()):
        name = draw(st.sampled_from(names))
        shape = draw(st.sampled_from(((length,), (), (length, 2), (length + 1,), (0,))))
        columns[name] = np.ones(shape).astype(draw(st.sampled_from(_DTYPES)))
    return columns


def _npz(columns: dict[str, Any]) -> bytes:
    file = io.BytesIO()
    np.savez_compressed(file, **columns)
    return file.getvalue()


def _parquet(columns: dict[str, Any]) -> bytes:
    file = io.BytesIO()
    try:
        table = pyarrow.table({name: pyarrow.array(values) for name, values in columns.items()})
    except (pyarrow.ArrowException, ValueError, TypeError):
        table = pyarrow.table({"time": [0.0, 0.1]})
    pyarrow.parquet.write_table(table, file)
    return file.getvalue()


def bomb(declared: int) -> bytes:
    """A small archive whose directory says that it unpacks to that many bytes."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        header = io.BytesIO()
        np.lib.format.write_array_header_1_0(
            header, {"descr": "<f8", "fortran_order": False, "shape": (declared // 8,)}
        )
        archive.writestr("time.npy", header.getvalue() + bytes(1000))
    return file.getvalue()


def _load(path: str) -> Callable[[Path], object]:
    return lambda folder: tidied(Recording.load(path))


RECORDINGS: st.SearchStrategy[Case] = st.one_of(
    _csv().map(lambda content: Case(files={"log.csv": content}, act=_load("log.csv"))),
    _csv().map(lambda content: Case(files={"log.csv": content}, act=_load("log.csv"))),
    _arrays()
    .map(_npz)
    .flatmap(_changed)
    .map(lambda content: Case(files={"log.npz": content}, act=_load("log.npz"))),
    _arrays()
    .map(_parquet)
    .flatmap(_changed)
    .map(lambda content: Case(files={"log.parquet": content}, act=_load("log.parquet"))),
    st.integers(10, 60).map(
        lambda size: Case(files={"log.npz": bomb(2**size)}, act=_load("log.npz"))
    ),
)

_GOOD = b"time,knee/position,knee/position_target\n0,0,0\n0.01,0.1,0.1\n0.02,0.2,0.2\n"
_VALUES = st.one_of(
    st.sampled_from(("leg.xml", "a.csv", "b.csv", "nowhere.xml", "os:abort", "../a.csv", "/", "")),
    st.sampled_from(("a.csv\x00", "x" * 5000, "a\nb.csv", "*.csv", "C:\\a.csv", "~", "leg.xml:a")),
    st.integers(-3, 3),
    st.booleans(),
    st.floats(),
)
_LISTS = st.one_of(_VALUES, st.lists(_VALUES, max_size=3), st.just(["a.csv"]), st.just(["b.csv"]))
_KEYS = ("model", "recordings", "held_out", "heldout", "experiment", "é", "")


@st.composite
def _manifest(draw: st.DrawFn) -> bytes:
    lines = []
    for _ in range(draw(st.integers(0, 3))):
        lines.append(draw(st.sampled_from(("[[experiment]]",) * 4 + ("[experiment]", "[[x]]"))))
        table = {"model": "leg.xml", "recordings": ["a.csv"]}
        for key in draw(st.lists(st.sampled_from(_KEYS), max_size=2)):
            table[key] = draw(_LISTS)
        lines += [f"{json.dumps(key)} = {_toml(value)}" for key, value in table.items()]
    return draw(_changed("\n".join(lines).encode()))


def _toml(value: Any) -> str:
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value).replace("Infinity", "inf").replace("NaN", "nan")


MANIFESTS: st.SearchStrategy[Case] = st.one_of(
    _manifest(), st.integers(1, 5000).map(lambda depth: b"a = " + b"[" * depth)
).map(
    lambda content: Case(
        files={
            "experiments.toml": content,
            "a.csv": _GOOD,
            "b.csv": _GOOD,
            "leg.xml": b"<mujoco/>",
        },
        act=lambda folder: load_experiments("experiments.toml"),
    )
)

_NETWORK = {
    "format": np.array("walkerkit.mlp"),
    "version": np.array(1),
    "activations": np.array(["elu", "identity"]),
    "weight_0": np.full((4, 3), 0.5),
    "bias_0": np.zeros(4),
    "weight_1": np.ones((1, 4)),
    "bias_1": np.zeros(1),
}


@st.composite
def _network(draw: st.DrawFn) -> bytes:
    arrays: dict[str, Any] = dict(_NETWORK)
    for name in draw(st.lists(st.sampled_from(sorted(arrays)), max_size=2)):
        how = draw(st.integers(0, 4))
        if how == 0:
            arrays.pop(name, None)
        elif how == 1:
            arrays[name] = np.ones(draw(st.sampled_from(((), (3,), (4, 4), (0, 3), (1, 1, 1)))))
        elif how == 2:
            arrays[name] = np.ones((4, 3)).astype(draw(st.sampled_from(_DTYPES)))
        elif how == 3:
            arrays[name] = np.full((4, 3), draw(st.sampled_from((np.nan, np.inf, 1e308))))
        else:
            arrays[draw(st.text(max_size=5))] = np.ones(2)
    return draw(_changed(_npz({name: v for name, v in arrays.items() if name})))


def _use(network: Callable[[str], Any]) -> Callable[[Path], object]:
    return lambda folder: network("net.npz")


WEIGHTS: st.SearchStrategy[Case] = st.tuples(
    st.one_of(_network(), st.integers(10, 60).map(lambda size: bomb(2**size))),
    st.sampled_from((Mlp.load, Lstm.load)),
).map(
    lambda given: Case(
        files={"net.npz": given[0]},
        act=_use(given[1]),
        refusals=(ValueError, FileNotFoundError),
        place="net.npz",
    )
)
