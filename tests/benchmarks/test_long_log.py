"""A slice of the benchmark of long logs: a few seconds, read in a process of its own."""

import numpy as np
import pytest

from benchmarks import long_log
from walkerkit import gap


@pytest.mark.parametrize("suffix", [".parquet", ".csv"])
def test_a_log_goes_on_from_piece_to_piece(tmp_path, suffix, monkeypatch):
    monkeypatch.setattr(long_log, "_PIECE", 1.0)
    log = gap.Recording.load(long_log.write_log(tmp_path / f"leg{suffix}", 2.5))
    assert len(log.time) == round(2.5 * long_log.RATE)
    assert np.allclose(np.diff(log.time), 1 / long_log.RATE)
    for joint in log.joints:
        # The next piece's targets may jump, the joint may not.
        assert np.abs(np.diff(log.columns[f"{joint}/position"])).max() < 0.1


def test_tells_the_most_memory_of_a_step(tmp_path):
    log = long_log.write_log(tmp_path / "leg.parquet", 1.0)
    peak, seconds, _ = long_log.peak_of("imports alone", log)
    assert 0.03 < peak < long_log.BOUND
    assert seconds > 0
