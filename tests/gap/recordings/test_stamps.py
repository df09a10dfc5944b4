"""Stamps that have lost their digits are told from rows that are there twice."""

import numpy as np
import pandas as pd
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording

TRUE = 1_764_150_000 + np.arange(400) / 200  # s since 1970


def written(path, time):
    frame = pd.DataFrame({"time": time, "knee/position": np.sin(np.arange(len(time)) / 50)})
    frame.assign(**{"knee/position_target": frame["knee/position"]}).to_csv(path, index=False)
    return path


@pytest.mark.parametrize(
    ("time", "told"),
    [
        (TRUE.astype(np.float32).astype(float), "went through single precision.*128 s"),
        ((TRUE - TRUE[0] + 2e5).astype(np.float32).astype(float), "single precision.*0.0156 s"),
        (np.round(TRUE, 2), "20[01] different stamps in 400 rows, 0.01 s apart: they were rounded"),
        (np.floor(TRUE), "2 different stamps in 400 rows, 1 s apart: they were rounded"),
        (np.full(400, 3.0), "one stamp in 400 rows, 3.0 s. Write the time"),
    ],
)
def test_the_cause_is_named(tmp_path, time, told):
    path = written(tmp_path / "log.csv", time)
    with pytest.raises(InputError, match=told) as refusal:
        Recording.load(path)
    assert "delete repeated" not in str(refusal.value)


@pytest.mark.parametrize("mended", [lambda n: n / 200, lambda n: (TRUE - TRUE[0])[n]])
def test_the_remedies_work(tmp_path, mended):
    recording = Recording.load(written(tmp_path / "log.csv", mended(np.arange(400))))
    assert recording.rate == pytest.approx(200, rel=1e-4)
    assert len(recording.time) == 400


def test_seconds_since_the_beginning_bear_single_precision(tmp_path):
    time = (TRUE - TRUE[0]).astype(np.float32).astype(float)
    assert len(Recording.load(written(tmp_path / "log.csv", time)).time) == 400


def test_rows_that_are_there_twice_are_another_matter(tmp_path):
    time = np.arange(400) / 200
    time[100] = time[99]
    with pytest.raises(InputError, match="repeats at row 101"):
        Recording.load(written(tmp_path / "log.csv", time))
