"""What is refused before any simulation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import ArrayLike

from walkerkit.gap.errors import InputError
from walkerkit.gap.experiments.experiment import Experiment
from walkerkit.gap.recordings.checks import (
    check_recordings,
    check_window,
    lopsided,
    source,
    without_echoes,
    without_placeholders,
)
from walkerkit.gap.recordings.recording import Recording


def log(name: str = "log", samples: int = 40, **columns: ArrayLike) -> Recording:
    """A recording at 100 Hz; `knee__effort=...` is the column `knee/effort`."""
    time = columns.pop("time", np.arange(samples) / 100)
    swing = np.sin(np.arange(samples) / 10)
    given: dict[str, Any] = {
        "knee__position": swing,
        "knee__position_target": 1.1 * swing,
    } | columns
    return Recording(
        name=name,
        time=np.asarray(time),
        columns={
            column.replace("__", "/"): np.broadcast_to(values, samples).astype(float)
            for column, values in given.items()
        },
    )


def test_ordinary_recordings_pass() -> None:
    still = log("still", knee__position=0.1)
    check_recordings([log(), still])  # it is enough that a joint moves in one of them
    check_recordings([log(samples=20)])
    check_recordings([log(time=np.arange(40) / 100 + 0.4 * (np.arange(40) > 20))])


def test_too_few_samples_are_refused() -> None:
    with pytest.raises(InputError, match=r"^short: it has 19 samples, .* at least 20"):
        check_recordings([log(), log("short", samples=19)])


def test_a_pause_is_refused_with_its_time() -> None:
    paused = log("paused", time=1e9 + np.arange(40) / 100 + 0.6 * (np.arange(40) > 20))
    with pytest.raises(
        InputError, match=r"^paused: column 'time' has a pause of 0\.61 s after 1000000000 s"
    ):
        check_recordings([log(), paused])


def test_recordings_without_motion_are_refused() -> None:
    with pytest.raises(InputError, match=r"^log: no joint moves, here or in any other recording"):
        check_recordings([log(knee__position=0.1), log("other", knee__position=0.2)])


def test_windows_need_some_samples() -> None:
    check_window(0.08, [log()])
    check_window(float("inf"), [log()])
    with pytest.raises(InputError, match=r"^window is 0\.07 s, .* log at 100 Hz; .* 0\.08 s"):
        check_window(0.07, [log()])


def test_a_column_of_one_half_is_found() -> None:
    plain, effort = log(), log(knee__effort=np.arange(40))
    hip = log(hip__position=0.0)
    assert lopsided([plain], [plain]) is None
    assert lopsided([plain, effort], [effort]) is None
    assert lopsided([plain], [effort]) == "knee/effort"
    assert lopsided([effort], [plain]) == "knee/effort"
    assert lopsided([plain, hip], [plain]) == "hip/position"
    # A half in which the drive rests has its effort all the same.
    assert lopsided([effort], [log(knee__effort=0.0)]) is None
    # Velocity is not compared, and targets need not be there.
    assert lopsided([plain], [log(knee__velocity=1.0, knee__effort_target=1.0)]) is None


def test_efforts_that_are_never_measured_are_dropped() -> None:
    swing = np.arange(40)
    one = log("one", knee__effort=0.0, knee__velocity=swing, hip__position=0.0, hip__effort=0.0)
    other = log("other", knee__effort=0.0, knee__velocity=0.0)
    moving = log("moving", hip__position=0.0, hip__effort=swing)
    experiments = [
        Experiment(model="a.xml", recordings=(one, other), held_out=frozenset({"other"})),
        Experiment(model="b.xml", recordings=(moving,)),
    ]
    first, second = without_placeholders(experiments)
    assert first.held_out == {"other"}
    # Zero everywhere: the knee's effort. The hip's is measured in another recording.
    assert set(one.columns) - set(first.recordings[0].columns) == {"knee/effort"}
    assert first.recordings[0].unused == ("knee/effort",)
    assert set(other.columns) - set(first.recordings[1].columns) == {"knee/effort"}
    assert second.recordings[0] is moving


def test_what_nothing_reads_is_listed_as_unused() -> None:
    current = log("other", knee__current=np.arange(40), voltage=24.0)
    (found,) = without_placeholders([Experiment(model="a.xml", recordings=(log(), current))])
    assert found.recordings[0].unused == ()
    assert found.recordings[1].unused == ("knee/current",)
    # The supply's voltage is read.
    assert list(found.recordings[1].columns) == [*log().columns, "voltage"]


@pytest.mark.parametrize(
    ("factor", "words"), [(1.0, "effort_target again"), (-0.5, "effort_target times -0.5")]
)
def test_efforts_that_repeat_their_commands_are_dropped_and_told(factor: float, words: str) -> None:
    sent = np.cos(np.arange(40) / 7)
    echo = log(knee__effort=np.round(factor * sent, 6), knee__effort_target=sent)
    found = without_echoes(echo, ["knee"])
    assert set(echo.columns) - set(found.columns) == {"knee/effort"}
    assert found.unused == ("knee/effort",)
    (note,) = found.notes
    assert words in note
    assert "not compared. Log what the drive measures" in note
    # A servo makes more than the effort that it is told.
    assert without_echoes(echo, []) is echo


def test_efforts_that_are_measured_are_kept() -> None:
    sent = np.cos(np.arange(40) / 7)
    noise = np.random.default_rng(0).normal(0, 1e-3, 40)
    for effort in (sent + noise, np.clip(sent, -0.99, 0.99), np.roll(sent, 1), sent + 0.01):
        measured = log(knee__effort=effort, knee__effort_target=sent)
        assert without_echoes(measured, ["knee"]) is measured
    # Of what never changes nobody knows.
    held = log(knee__effort=1.0, knee__effort_target=1.0)
    assert without_echoes(held, ["knee"]) is held
    assert without_echoes(log(), ["knee"]).unused == ()


def test_a_recording_is_known_by_its_file_or_its_name(tmp_path: Path) -> None:
    recording = log()
    assert source(recording) == "log"
    recording.save(tmp_path / "walk.csv")
    assert source(Recording.load(tmp_path / "walk.csv")) == str(tmp_path / "walk.csv")
