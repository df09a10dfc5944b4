"""Recording: what a file may hold, what is refused and how it is said."""

from __future__ import annotations

import copy
import os
import pickle
import re
from collections.abc import Callable
from dataclasses import FrozenInstanceError
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pyarrow
import pyarrow.parquet
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.fuzzing.files import bomb
from tests.gap.refused import refused
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings import files
from walkerkit.gap.recordings.recording import BASE, SIGNALS, TARGETS, Recording

FORMATS = (".csv", ".parquet", ".npz")
DATA = Path(os.environ.get("WALKERKIT_DATA", Path(__file__).parents[4] / "shared" / "data"))

HEADER = "time,knee/position_target,knee/position"
ROWS = "0,0.1,0.0\n0.01,0.1,0.05\n0.02,0.1,0.09\n"


def make(**changes: Any) -> Recording:
    arguments: dict[str, Any] = {
        "name": "walk",
        "time": np.arange(5) * 0.01,
        "columns": {
            "knee/position": np.linspace(0.0, 1.0, 5),
            "knee/position_target": np.ones(5),
        },
    }
    return Recording(**arguments | changes)


def columns(**changes: Any) -> dict[str, Any]:
    """Columns of a good file; `__` stands for the slash, None removes one."""
    good: dict[str, Any] = {
        "time": np.arange(5) * 0.01,
        "knee/position": np.linspace(0.0, 1.0, 5),
        "knee/position_target": np.ones(5),
    }
    good |= {name.replace("__", "/"): values for name, values in changes.items()}
    return {name: values for name, values in good.items() if values is not None}


def write_csv(path: Path, text: str) -> Path:
    path.write_text(text, encoding="utf-8")
    return path


def write_npz(path: Path, content: dict[str, Any]) -> Path:
    np.savez(path, **content)
    return path


def write_parquet(path: Path, content: dict[str, Any]) -> Path:
    pyarrow.parquet.write_table(pyarrow.table(content), path)
    return path


def refused_file(path: Path, *parts: str) -> str:
    return refused(lambda: Recording.load(path), str(path), *parts)


# Round trips

JOINTS = st.lists(
    st.text(st.characters(exclude_categories=("C", "Z")), min_size=1, max_size=6).map(
        lambda name: f"left {name}"
    ),
    min_size=1,
    max_size=3,
    unique=True,
)


@st.composite
def recordings(draw: st.DrawFn) -> Recording:
    size = draw(st.integers(2, 6))
    steps = draw(st.lists(st.floats(1e-4, 0.1), min_size=size - 1, max_size=size - 1))
    start = draw(st.floats(-1e3, 1e3))
    any_number = st.floats(-1e9, 1e9)
    near = st.floats(-50.0, 50.0)

    def samples(values: st.SearchStrategy[float]) -> list[float]:
        return draw(st.lists(values, min_size=size, max_size=size))

    found: dict[str, list[float]] = {}
    for index, joint in enumerate(draw(JOINTS)):
        signals = draw(st.permutations((*SIGNALS, "current")))
        chosen = {"position", *signals[: draw(st.integers(0, 6))]}
        if index == 0:
            chosen.add(draw(st.sampled_from(TARGETS)))
        for signal in signals:
            if signal in chosen:
                found[f"{joint}/{signal}"] = samples(near if "position" in signal else any_number)
    for name in draw(st.sets(st.sampled_from(("voltage", "base/position_z")))):
        found[name] = samples(any_number)
    return Recording(
        name="random",
        time=start + np.concatenate(([0.0], np.cumsum(steps))),
        columns={name: np.array(values) for name, values in found.items()},
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("recordings")


@pytest.mark.parametrize("suffix", FORMATS)
@settings(derandomize=True, deadline=None, max_examples=60)
@given(recording=recordings())
def test_files_keep_every_bit(folder: Path, suffix: str, recording: Recording) -> None:
    path = folder / f"random{suffix}"
    recording.save(path)
    again = Recording.load(path)
    assert again.name == "random"
    assert again.source == path
    assert again.joints == recording.joints
    assert list(again.columns) == list(recording.columns)
    assert again.time.tobytes() == recording.time.tobytes()
    for name, values in recording.columns.items():
        assert again.columns[name].tobytes() == values.tobytes(), name
    assert again.unused == ()


@settings(derandomize=True, deadline=None, max_examples=60)
@given(recording=recordings(), data=st.data())
def test_parts_make_up_the_whole(recording: Recording, data: st.DataObject) -> None:
    if recording.time.size < 4:
        return
    cut = float(recording.time[data.draw(st.integers(2, recording.time.size - 2))])
    before, after = recording.between(-np.inf, cut), recording.between(cut, np.inf)
    np.testing.assert_array_equal(np.concatenate((before.time, after.time)), recording.time)
    assert before.time[-1] < cut == after.time[0]
    for name, values in recording.columns.items():
        joined = np.concatenate((before.columns[name], after.columns[name]))
        np.testing.assert_array_equal(joined, values)
    assert len({recording.name, before.name, after.name}) == 3


# What a recording gives


def test_signals_joints_and_times() -> None:
    recording = make(
        time=[3.0, 3.01, 3.02, 3.03, 3.1],
        columns={
            "left/hip/effort_target": np.zeros(5),
            "knee/current": np.full(5, 2.0),
            "knee/position": np.arange(5),
            "left/hip/position": np.zeros(5),
            "voltage": np.full(5, 24),
            **{name: np.full(5, float(name.endswith("_w"))) for name in BASE},
        },
    )
    assert recording.joints == ("left/hip", "knee")
    assert recording.duration == pytest.approx(0.1)
    assert recording.rate == pytest.approx(100.0)
    np.testing.assert_array_equal(recording.signal("knee", "position"), np.arange(5.0))
    np.testing.assert_array_equal(recording.signal("knee", "current"), np.full(5, 2.0))
    assert recording.signal("knee", "velocity") is None
    assert recording.signal("ankle", "position") is None
    assert recording.columns["voltage"].dtype == np.float64
    assert "left/hip, knee" in repr(recording)


def test_unknown_signal_is_refused() -> None:
    refused(lambda: make().signal("knee", "positon"), "'walk'", "'positon'", "'position'")


def test_a_recording_keeps_read_only_copies() -> None:
    mine = np.linspace(0.0, 1.0, 5)
    recording = make(columns={"knee/position": mine, "knee/effort_target": mine})
    mine[:] = 9.0
    assert recording.columns["knee/position"].max() == 1.0
    for array in (recording.time, *recording.columns.values()):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1.0
    with pytest.raises(TypeError):
        recording.columns["knee/effort"] = mine  # type: ignore[index]
    with pytest.raises(FrozenInstanceError):
        recording.name = "run"  # type: ignore[misc]


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda r: pickle.loads(pickle.dumps(r))])
def test_a_recording_can_be_copied_and_pickled(copied: Callable[[Recording], Recording]) -> None:
    again = copied(make(unused=("a",), notes=("b",)))
    assert (again.name, again.unused, again.notes) == ("walk", ("a",), ("b",))
    assert not again.columns["knee/position"].flags.writeable
    np.testing.assert_array_equal(again.time, make().time)


def test_between_takes_the_start_and_leaves_the_stop() -> None:
    part = make().between(0.01, 0.04)
    np.testing.assert_array_equal(part.time, np.arange(5)[1:4] * 0.01)
    np.testing.assert_array_equal(part.columns["knee/position"], [0.25, 0.5, 0.75])


@pytest.mark.parametrize(("start", "stop", "count"), [(0.01, 0.02, 1), (1.0, 2.0, 0), (2, 1, 0)])
def test_an_empty_part_is_refused(start: float, stop: float, count: int) -> None:
    refused(
        lambda: make().between(start, stop),
        f"{count} samples",
        f"between {start:g} and {stop:g} s",
        "from 0 to 0.04 s",
    )


# Loading


def test_unused_columns_are_listed_whatever_they_hold(tmp_path: Path) -> None:
    path = write_csv(
        tmp_path / "log.csv",
        "time, knee/position , knee/position_target,knee/duty,state,battery/current,n\n"
        "0, 0.0 ,0.1,0.5,walking,3,\n0.01,0.05,0.1,0.5,,3,nan\n",
    )
    recording = Recording.load(path)
    assert recording.unused == ("knee/duty", "state", "battery/current", "n")
    assert tuple(recording.columns) == ("knee/position", "knee/position_target")
    recording = Recording.load(
        write_npz(
            tmp_path / "log.npz", columns(meta=np.array(["a"]), config=np.array({"a": 1}, object))
        )
    )
    assert recording.unused == ("meta", "config")


def test_what_was_not_logged_may_have_a_column(tmp_path: Path) -> None:
    empty = "knee/velocity,knee/effort,knee/current,voltage,knee/duty"
    text = f"{HEADER},{empty}\n0,0,0,,nan,,,\n0.01,0,0.1,,nan,,,\n"
    recording = Recording.load(write_csv(tmp_path / "log.csv", text))
    assert set(recording.unused) == {*empty.split(",")}
    assert set(recording.columns) == {"knee/position", "knee/position_target"}
    text = f"{HEADER},knee/velocity\n0,0,0,\n0.01,0,0.1,1\n"
    refused_file(
        write_csv(tmp_path / "log.csv", text), "'knee/velocity'", "1 of 2", "Interpolate it"
    )
    made = Recording(
        name="made",
        time=np.array([0.0, 0.01]),
        columns={
            "knee/position": np.zeros(2),
            "knee/position_target": np.zeros(2),
            "knee/velocity": np.full(2, np.nan),
        },
    )
    assert made.unused == ("knee/velocity",)
    assert made.between(0.0, 1.0).unused == made.unused


@pytest.mark.parametrize("text", ["\ufeff{}", "\n\n{}\n\n", "{},"])
def test_harmless_oddities_of_csv_files_load(tmp_path: Path, text: str) -> None:
    body = f"{HEADER},\n" + ROWS.replace("\n", ",\n") if text == "{}," else f"{HEADER}\n{ROWS}"
    recording = Recording.load(write_csv(tmp_path / "log.csv", text.rstrip(",").format(body)))
    assert recording.unused == ()
    np.testing.assert_array_equal(recording.columns["knee/position"], [0.0, 0.05, 0.09])


def test_windows_line_ends_and_capital_suffix_load(tmp_path: Path) -> None:
    path = tmp_path / "log.CSV"
    path.write_bytes(f"{HEADER}\n{ROWS}".replace("\n", "\r\n").encode())
    assert Recording.load(path).time.tolist() == [0.0, 0.01, 0.02]


@pytest.mark.parametrize(
    ("content", "note"),
    [
        (f"{HEADER}\n{ROWS}".replace(",", ";"), "separated by semicolons"),
        (f"{HEADER}\n{ROWS}".replace(",", "\t"), "separated by tabs"),
        (
            f"{HEADER}\n{ROWS}".replace(",", ";").replace(".", ","),
            "separated by semicolons and decimal commas",
        ),
        (
            f"{HEADER}\n" + re.sub(r"(\d)\.(\d+)", r'"\1,\2"', ROWS),
            "separated by commas and decimal commas",
        ),
        (f"{HEADER}\n{ROWS}".encode("utf-16"), "it is in UTF-16"),
        (f"{HEADER}\n{ROWS}".replace("\n", "\r"), ""),
    ],
    ids=["semicolons", "tabs", "german", "quoted", "utf-16", "carriage returns"],
)
def test_what_spreadsheets_write_is_read_and_told(
    tmp_path: Path, content: str | bytes, note: str
) -> None:
    path = tmp_path / "log.csv"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    recording = Recording.load(path)
    np.testing.assert_array_equal(recording.columns["knee/position"], [0.0, 0.05, 0.09])
    assert len(recording.notes) == bool(note)
    assert note in "".join(recording.notes)


def test_a_file_that_is_not_utf8_is_read_as_latin1_and_told(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = ROWS.replace("\n", ",20\n")
    path.write_bytes(f"{HEADER},motor [°C]\n{rows}".encode("latin-1"))
    recording = Recording.load(path)
    assert recording.unused == ("motor [°C]",)
    assert recording.notes == ("byte 0xb0 at line 1 is not UTF-8; the file was read as Latin-1",)
    path.write_bytes(f"{HEADER},motor [°C]\n".encode() + rows.replace("20", "20°").encode("cp1252"))
    refused_file(path, "byte 0xb0 at line 2 is not UTF-8, and what is above it is", "in UTF-8")


def test_a_clock_that_was_reset_is_told_from_rows_out_of_order(tmp_path: Path) -> None:
    rows = "".join(f"{t / 100},0,{t}e-3\n" for t in [*range(40), *range(40)])
    path = write_csv(tmp_path / "log.csv", f"{HEADER}\n{rows}")
    refused_file(path, "jumps back at row 41 (line 42)", "0.39 s, then 0.0 s", "Cut the file there")


def test_archives_that_declare_more_than_they_may_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    for size, part in ((2**30, "its header asks for 1073741824 bytes"), (2**62, "header asks")):
        path.write_bytes(bomb(size))
        refused_file(path, part)
    zeros = np.zeros(2**16)
    np.savez_compressed(path, time=zeros, **{"knee/position": zeros})
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(files, "MOST_VALUES", 1000)
        refused_file(path, "its arrays unpack to 1048", "more than the 8000 that are read")
        parquet = write_parquet(
            tmp_path / "log.parquet",
            columns(time=zeros, knee__position=zeros, knee__position_target=zeros),
        )
        refused_file(parquet, "65536 rows of 3 columns are more than 1000 numbers", "Cut it")


def test_integers_floats_and_text_in_one_column_across_many_blocks(tmp_path: Path) -> None:
    rows = "".join(f"{i / 1000},0,1\n" for i in range(150_000))
    path = write_csv(tmp_path / "log.csv", f"{HEADER}\n{rows}150,0.5,1\n")
    target = Recording.load(path).columns["knee/position_target"]
    assert (target[0], target[-1]) == (0.0, 0.5)
    write_csv(path, f"{HEADER}\n{rows}150,off,1\n")
    refused_file(path, "'knee/position_target'", "'off'", "row 150001 (line 150002)")


def test_float32_and_integer_arrays_load(tmp_path: Path) -> None:
    content = columns(
        knee__position=np.arange(5, dtype=np.int16), knee__velocity=np.ones(5, np.float32)
    )
    for path in (
        write_npz(tmp_path / "log.npz", content),
        write_parquet(tmp_path / "log.parquet", content),
    ):
        recording = Recording.load(path)
        assert {values.dtype for values in recording.columns.values()} == {np.dtype(np.float64)}


def test_notes(tmp_path: Path) -> None:
    time = np.array([0.0, 0.01, 0.02, 0.05, 0.06])
    path = write_npz(
        tmp_path / "log.npz", columns(time=time, toe__position=np.zeros(5), hip__position=time)
    )
    notes = Recording.load(path).notes
    assert "irregular sampling: steps of 10 to 30 ms, median 10 ms, longest at 0.02 s" in notes
    assert "joint 'toe' never moves" in notes
    assert len(notes) == 2
    assert Recording.load(write_npz(tmp_path / "clean.npz", columns())).notes == ()


def test_targets_that_no_position_goes_with_may_be_an_actuators(tmp_path: Path) -> None:
    content = columns(grip__position_target=np.zeros(5), grip__voltage_target=np.ones(5))
    recording = Recording.load(write_npz(tmp_path / "log.npz", content))
    assert recording.commanded == ("grip",)
    assert recording.joints == ("knee",)
    assert recording.unused == ()


# Saving


@pytest.mark.parametrize("suffix", FORMATS)
def test_a_failed_save_leaves_the_old_file_and_nothing_else(
    tmp_path: Path, suffix: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / f"log{suffix}"
    make().save(path)
    before = path.read_bytes()

    def fail(*_: Any) -> None:
        raise OSError("disk full")

    monkeypatch.setattr(Path, "replace", fail)
    with pytest.raises(OSError, match="disk full"):
        make(time=np.arange(5) * 0.02).save(path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_paths_that_cannot_be_saved_to_are_refused(tmp_path: Path) -> None:
    refused(lambda: make().save(tmp_path / "log.txt"), "log.txt", "'.txt'", ".csv, .parquet, .npz")
    refused(lambda: make().save(tmp_path / "no" / "log.csv"), "log.csv", "does not exist. Make it")
    (tmp_path / "dir.csv").mkdir()
    refused(lambda: make().save(tmp_path / "dir.csv"), "dir.csv", "folder")
    assert [path.name for path in tmp_path.iterdir()] == ["dir.csv"]


# Files that are refused


def test_missing_file_names_the_closest(tmp_path: Path) -> None:
    write_csv(tmp_path / "walk_fast.csv", HEADER)
    refused_file(tmp_path / "walk_fats.csv", "no such file", "'walk_fast.csv'", "Check the path")
    refused_file(tmp_path / "logs" / "a.csv", f"folder {tmp_path / 'logs'} does not exist")


def test_paths_that_are_no_files_are_refused(tmp_path: Path) -> None:
    refused_file(tmp_path, "folder", "Name a file")
    refused_file(write_csv(tmp_path / "log.csv", HEADER) / "a.csv", "Check the path")
    refused_file(tmp_path / ("a" * 300 + ".csv"), "Check the path")
    refused_file(write_csv(tmp_path / "log.xlsx", "x"), "'.xlsx'", ".csv, .parquet, .npz")
    refused_file(write_csv(tmp_path / "log", "x"), "'no suffix'", ".csv, .parquet, .npz")


@pytest.mark.parametrize("suffix", FORMATS)
def test_empty_and_broken_files_are_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log{suffix}"
    path.write_bytes(b"")
    refused_file(path, "the file is empty")
    path.write_bytes(b"\xff\xfe\x00\x01 garbage \x80\n\x00" * 9)
    # Two of the bytes say UTF-16, in which it is a header of one name.
    expected = "no column 'time'" if suffix == ".csv" else f"cannot be read as {suffix}"
    refused_file(path, expected)
    make().save(path)
    whole = path.read_bytes()
    if suffix != ".csv":
        for size in (len(whole) // 3, len(whole) - 30):
            path.write_bytes(whole[:size])
            refused_file(path, f"cannot be read as {suffix}")


@pytest.mark.parametrize("suffix", FORMATS)
def test_any_flipped_byte_loads_or_is_refused(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"log{suffix}"
    make().save(path)
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for position in rng.integers(0, len(whole), 150):
        broken = bytearray(whole)
        broken[position] ^= int(rng.integers(1, 256))
        path.write_bytes(broken)
        message = str(path)
        try:
            Recording.load(path)
        except InputError as error:
            message = str(error)
        assert str(path) in message
        assert len(message.splitlines()) == 1


def test_too_few_rows_are_refused(tmp_path: Path) -> None:
    refused_file(write_csv(tmp_path / "log.csv", f"{HEADER}\n"), "no rows of data")
    refused_file(write_csv(tmp_path / "log.csv", f"{HEADER}\n0,0,0"), "too few rows of data (1)")
    for size in (0, 1):
        content = {name: values[:size] for name, values in columns().items()}
        refused_file(write_npz(tmp_path / "log.npz", content), f"({size})", "At least two")
        refused_file(write_parquet(tmp_path / "log.parquet", content), f"({size})")


def test_ragged_rows_are_refused_with_their_line(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", f"{HEADER}\n\n{ROWS}0.03,0.1\n")
    refused_file(path, "row 4 (line 6) has 2 cells and the header has 3", "or delete it")
    write_csv(path, f"{HEADER}\n0,0.1,0.0,7\n{ROWS}")
    refused_file(path, "row 1 (line 2) has 4 cells and the header has 3")


def test_time_must_be_there(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", f"{HEADER}\n{ROWS}".replace("time", "Timestamp"))
    refused_file(path, "no column 'time'", "did you mean 'Timestamp'", "Name the column")
    write_csv(path, f"{HEADER}\n{ROWS}".replace("time", "x").replace(",", "/"))
    refused_file(path, "no column 'time'", "there are 'x/knee/position_target/knee/position'")


def test_duplicate_columns_are_refused(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "log.csv", "time,a/position,a/position\n0,1,1\n1,1,1\n")
    refused_file(path, "two columns are called 'a/position'", "Rename one")
    table = pyarrow.Table.from_arrays([pyarrow.array([0.0, 0.1])] * 2, ["time", "time"])
    pyarrow.parquet.write_table(table, tmp_path / "log.parquet")
    refused_file(tmp_path / "log.parquet", "two columns are called 'time'")


@pytest.mark.parametrize(
    ("rows", "parts"),
    [
        ("0,0,0\n0.02,0,0\n0.01,0,0", ("goes backwards", "row 3 (line 4)", "0.02 s, then 0.01 s")),
        ("0,0,0\n0.02,0,0\n0.02,0,0", ("repeats", "row 3 (line 4)", "0.02 s, then 0.02 s")),
        ("0,0,0\n\n0.02,0,0\n\n\n0.02,0,0", ("repeats", "row 3 (line 7)", "Sort the rows")),
        ("0,0,0\n,0,0", ("'time'", "1 of 2 rows", "row 2 (line 3)")),
        ("0,0,0\n0.01,0,", ("'knee/position'", "nan at row 2 (line 3)", "interpolate")),
        ("0,0,0\n0.01,inf,0", ("'knee/position_target'", "inf at row 2 (line 3)", "target holds")),
        ("0,0,0\n0.01,0,-inf", ("'knee/position'", "-inf at row 2 (line 3)", "empty or infinite")),
        ("0,0,0\n0.01,0,1e999", ("'knee/position'", "inf at row 2 (line 3)")),
        (
            "0,,0\n0.01,,0",
            ("'knee/position_target'", "2 of 2 rows", "row 1 (line 2)", "or delete the column"),
        ),
        ("0,0,0\n0.01,0,n.a.", ("'knee/position'", "'n.a.' at row 2 (line 3)", "plain numbers")),
        ("0,true,0\n0.01,true,0", ("'knee/position_target'", "'True' at row 1 (line 2)")),
        ("2024-01-01 00:00:00,0,0\n2024-01-01 00:00:01,0,0", ("'time'", "row 1", "in seconds")),
        ("0,0,0\n0.01,0,1e300", ("'knee/position'", "1e+300 at row 2 (line 3)", "over 1e+09")),
        ("0,0,0\n1,0,0\n2.1,0,0", ("median step of 1.05 s", "milliseconds", "Divide it by 1e3")),
        ("0,0,0\n5000,0,0", ("median step of 5000 s", "microseconds", "Divide it by 1e6")),
        ("0,0,0\n1000000,0,0", ("median step of 1e+06 s", "nanoseconds", "Divide it by 1e9")),
    ],
)
def test_bad_values_are_refused(tmp_path: Path, rows: str, parts: tuple[str, ...]) -> None:
    refused_file(write_csv(tmp_path / "log.csv", f"{HEADER}\n{rows}\n"), *parts)


def test_just_within_the_limits_loads(tmp_path: Path) -> None:
    rows = "0,50,-50\n0.19,0,0\n0.38,0,0\n9,0,0\n9.1,0,0\n"
    assert Recording.load(write_csv(tmp_path / "log.csv", f"{HEADER}\n{rows}")).duration == 9.1


@pytest.mark.parametrize("name", ["knee/position", "knee/position_target"])
def test_the_remedy_for_infinite_cells_works(tmp_path: Path, name: str) -> None:
    frame = pandas.DataFrame(columns())
    frame.loc[2, name] = np.inf
    frame.to_csv(path := tmp_path / "log.csv", index=False)
    told = re.search(r"\(pandas: (frame.*\))\)", refused_file(path, f"'{name}'", "inf at row 3"))
    assert told is not None
    frame[name] = eval(told[1], {"frame": frame})
    frame.to_csv(path, index=False)
    expected = {"knee/position": 0.5, "knee/position_target": 1.0}[name]
    assert Recording.load(path).columns[name][2] == pytest.approx(expected)


@pytest.mark.parametrize("suffix", FORMATS[1:])
def test_rows_of_binary_files_have_no_line(tmp_path: Path, suffix: str) -> None:
    write = {".npz": write_npz, ".parquet": write_parquet}[suffix]
    position = np.array([0.0, 1.0, np.nan, 2.0, np.inf])
    measured = columns(knee__position=position, knee__velocity=np.zeros(5))
    path = write(tmp_path / f"log{suffix}", measured)
    message = refused_file(path, "'knee/position'", "2 of 5 rows", "nan at row 3")
    assert "line" not in message


@pytest.mark.parametrize(
    ("content", "parts"),
    [
        ({"knee__position": None}, ("'knee'", "no position", "Add 'knee/position'")),
        ({"hip__effort": np.zeros(5)}, ("'hip'", "'hip/effort'", "Add 'hip/position'")),
        ({"knee__position_target": None}, ("no joint has a target", "'knee/position_target'")),
        (
            {"knee__position": None, "knee__position_target": None, "knee_position": np.zeros(5)},
            ("no joint", "'<joint>/position'", "there are 'knee_position'", "such as"),
        ),
        ({"base__quaternion_w": np.ones(5)}, ("lacks 'base/quaternion_x'", "all 4 columns")),
        (
            {f"base__quaternion_{axis}": np.ones(5) for axis in "wxyz"},
            ("quaternion", "norm 2 at row 1", "unit"),
        ),
    ],
)
def test_columns_that_do_not_fit_together_are_refused(
    tmp_path: Path, content: dict[str, Any], parts: tuple[str, ...]
) -> None:
    refused_file(write_npz(tmp_path / "log.npz", columns(**content)), *parts)


def test_arrays_that_are_no_columns_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    write_npz(path, columns(knee__position=np.zeros(4)))
    refused_file(path, "'knee/position' has 4 samples and 'time' has 5", "one clock")
    write_npz(path, columns(knee__position=np.zeros((5, 1))))
    refused_file(path, "'knee/position'", "shape (5, 1)", "one dimension")
    write_npz(path, columns(knee__position=np.array([0.0, None, 1.0, 2.0, 3.0])))
    refused_file(path, "'knee/position'", "allow_pickle=False", "array of float64")
    write_npz(path, columns(knee__position=np.ones(5, complex)))
    refused_file(path, "'knee/position'", "row 1", "plain numbers")
    with path.open("wb") as file:
        np.save(file, np.zeros(5))
    refused_file(path, "one bare array", "numpy.savez")


def test_in_memory_recordings_are_checked_and_named() -> None:
    refused(lambda: make(time=[0, 0.1, 0.1, 0.3, 0.4]), "recording 'walk'", "repeats at row 3:")
    refused(
        lambda: make(columns={"knee/position": np.zeros(5), "knee/duty": np.zeros(5)}),
        "'knee/duty'",
        "`unused`",
    )


@pytest.mark.parametrize("joint", ["", " knee", "kn\nee", "kn\x00ee"])
def test_names_that_no_file_would_keep_are_refused(joint: str) -> None:
    extra = {f"{joint}/position": np.zeros(5)}
    refused(lambda: make(columns=dict(make().columns) | extra), "nothing uses", "/position'")


def test_line_breaks_in_a_file_name_stay_out_of_the_message(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=re.escape("a b.csv: no such file")) as caught:
        Recording.load(tmp_path / "a\nb.csv")
    assert "\n" not in str(caught.value)


# Logs of real hardware


@pytest.mark.skipif(not DATA.is_dir(), reason="the logs of real hardware are not here")
@pytest.mark.parametrize(
    ("pattern", "count", "joints", "unused", "rate"),
    [
        ("xl330/*.csv", 16, ("servo",), ("servo/duty",), 188.0),
        ("emps/*.csv", 2, ("carriage",), (), 1000.0),
        ("double_pendulum/*.csv", 10, ("shoulder", "elbow"), (), 500.0),
    ],
)
def test_real_logs_load_and_round_trip(
    tmp_path: Path,
    pattern: str,
    count: int,
    joints: tuple[str, ...],
    unused: tuple[str, ...],
    rate: float,
) -> None:
    files = sorted(DATA.glob(pattern))
    assert len(files) == count
    for file in files:
        recording = Recording.load(file)
        assert recording.name == file.stem
        assert recording.joints == joints
        assert recording.unused == unused
        assert recording.rate == pytest.approx(rate, rel=0.02)
        assert 1.9 < recording.duration < 25.0
        raw = np.genfromtxt(file, delimiter=",", skip_header=1)
        np.testing.assert_array_equal(recording.time, raw[:, 0])
    recording.save(tmp_path / "again.csv")
    again = Recording.load(tmp_path / "again.csv")
    assert all((again.columns[name] == recording.columns[name]).all() for name in again.columns)
