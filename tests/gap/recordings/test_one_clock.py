"""Logs of two clocks are read as they are, and advice on others leads to a log that is read."""

import re

import numpy as np
import pandas as pd
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording

RATE = 100.0


def position(time):
    return 0.4 * np.sin(3 * time)


def target(time):
    return np.round(2 * time) / 2  # steps


def two_clocks(*, sent_every=0.05, late=0.0, rows=200):
    """Rows of the union of both clocks, as PlotJuggler writes them."""
    measured, sent = 0.003 + np.arange(rows) / RATE, np.arange(0, rows / RATE, sent_every) + late
    both = pd.DataFrame({"time": measured, "knee/position": position(measured)}).merge(
        pd.DataFrame({"time": sent, "knee/position_target": target(sent)}), on="time", how="outer"
    )
    return both.sort_values("time").reset_index(drop=True), measured, sent


@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_targets_are_held_and_the_rows_of_the_measurement_kept(tmp_path, suffix):
    frame, measured, sent = two_clocks()
    path = tmp_path / f"union.{suffix}"
    frame.to_csv(path, index=False) if suffix == "csv" else frame.to_parquet(path)
    recording = Recording.load(path)
    np.testing.assert_array_equal(recording.time, measured)
    np.testing.assert_array_equal(recording.columns["knee/position"], position(measured))
    # The nearest row is the first one that begins later than half a step before the target came.
    expected = [target(sent[sent - 0.005 <= t][-1]) for t in measured]
    np.testing.assert_array_equal(recording.columns["knee/position_target"], expected)
    (note,) = recording.notes
    assert note == (
        "'knee/position_target' has empty cells, which hold the last value; the 200 of 240 rows "
        "that measure something were kept, and a target that came between two of them acts from "
        "the nearer one, 5 ms off at most"
    )


def test_a_target_right_after_a_row_is_of_that_row(tmp_path):
    frame, measured, _ = two_clocks(late=0.0034)  # 0.4 ms after the rows
    frame.to_csv(tmp_path / "loop.csv", index=False)
    recording = Recording.load(tmp_path / "loop.csv")
    np.testing.assert_array_equal(
        recording.columns["knee/position_target"][::5], target(measured[::5])
    )


def test_rows_before_the_first_target_are_left_out_and_told(tmp_path):
    frame, *_ = two_clocks(late=0.5)
    frame.to_csv(tmp_path / "late.csv", index=False)
    recording = Recording.load(tmp_path / "late.csv")
    assert recording.time[0] == pytest.approx(0.503)
    assert "the first 50 rows, until 0.503 s, were left out" in recording.notes[1]
    # What is said of a row is said of that of the file.
    assert (
        recording.row(0) == f"row {frame.index[frame.time == recording.time[0]][0] + 1} (line 53)"
    )


def test_a_log_without_empty_cells_is_left_alone(tmp_path):
    _, measured, _ = two_clocks()
    plain = pd.DataFrame({"time": measured, "knee/position": position(measured)})
    plain["knee/position_target"] = target(measured)
    plain.to_csv(tmp_path / "plain.csv", index=False)
    recording = Recording.load(tmp_path / "plain.csv")
    assert recording.notes == ()
    assert recording.file_rows is None
    np.testing.assert_array_equal(recording.columns["knee/position_target"], target(measured))


def test_blocks_of_one_topic_after_the_other_are_put_in_order(tmp_path):
    frame, *_ = two_clocks()
    moved = frame["knee/position"].notna()
    pd.concat([frame[moved], frame[~moved]]).to_csv(tmp_path / "blocks.csv", index=False)
    frame.to_csv(tmp_path / "union.csv", index=False)
    one, other = (Recording.load(tmp_path / f"{name}.csv") for name in ("blocks", "union"))
    for column in one.columns:
        np.testing.assert_array_equal(one.columns[column], other.columns[column])


def test_advice_on_a_slower_velocity_works_to_the_letter(tmp_path):
    time = np.arange(400) / RATE
    frame = pd.DataFrame({"time": time, "knee/position": position(time)})
    frame["knee/position_target"] = target(time)
    frame["knee/velocity"] = np.where(np.arange(400) % 4 == 1, 1.2 * np.cos(3 * time), np.nan)
    path = tmp_path / "slow.csv"
    for remedy in ("Interpolate it", "Delete such rows"):
        frame.to_csv(path, index=False)
        with pytest.raises(InputError, match=remedy) as refused:
            Recording.load(path)
        if remedy == "Interpolate it":
            pandas = re.search(r"\(pandas: (frame.*\.to_numpy\(\))\)", str(refused.value))[1]
            frame["knee/velocity"] = eval(pandas, {"frame": frame})
    frame[frame["knee/velocity"].notna()].to_csv(path, index=False)
    recording = Recording.load(path)
    velocity = 1.2 * np.cos(3 * recording.time)
    assert np.abs(recording.columns["knee/velocity"] - velocity).max() < 0.1  # past its last row


def test_measurements_of_several_clocks_are_told_of_at_once(tmp_path):
    frame, *_ = two_clocks()
    other = pd.DataFrame({"time": 0.0031 + np.arange(200) / 100})
    for name in ("hip/position", "hip/velocity"):
        other[name] = np.sin(3 * other.time)
    frame = frame.merge(other, on="time", how="outer").sort_values("time").reset_index(drop=True)
    path = tmp_path / "three.csv"
    frame.to_csv(path, index=False)
    with pytest.raises(InputError, match="each came on a clock of its own") as refused:
        Recording.load(path)
    pandas = re.search(r"\(pandas: (.*\.to_numpy\(\))\)", str(refused.value))[1]
    exec(pandas, {"frame": frame})
    frame.to_csv(path, index=False)
    recording = Recording.load(path)
    assert set(recording.joints) == {"hip", "knee"}
    assert np.abs(recording.columns["hip/position"] - np.sin(3 * recording.time)).max() < 0.02
    assert np.abs(recording.columns["knee/position"] - position(recording.time)).max() < 0.02


def test_single_cells_of_a_measurement_can_be_spared(tmp_path):
    frame, *_ = two_clocks()
    frame["knee/effort"] = frame["knee/position"]
    at = frame.index[frame["knee/position"].notna()][10]
    frame.loc[at, "knee/effort"] = np.nan
    frame.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(InputError, match=r"'knee/effort' is empty.* in 1 of 200 rows.*Delete such"):
        Recording.load(tmp_path / "log.csv")


def test_a_column_that_was_not_logged_is_no_third_clock(tmp_path):
    frame, measured, _ = two_clocks()
    frame["knee/effort"] = None
    frame.to_csv(tmp_path / "union.csv", index=False)
    recording = Recording.load(tmp_path / "union.csv")
    np.testing.assert_array_equal(recording.time, measured)
    assert recording.unused == ("knee/effort",)
