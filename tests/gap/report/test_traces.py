"""Signals in the files of other viewers, read again by these viewers' own readers."""

import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.report.traces import write_traces


@pytest.fixture
def traces(leg):
    first, *others = leg(samples=50).traces
    diverged = first.before.copy()
    diverged[-1] = np.nan
    return (replace(first, before=diverged, target=None), *others)


def test_parquet_has_all(traces, tmp_path):
    frame = pd.read_parquet(write_traces(traces, tmp_path / "new" / "t.parquet"))
    assert len(frame) == sum(len(trace.time) for trace in traces)
    one = frame.groupby(["recording", "joint", "signal"]).get_group(
        (traces[1].recording, traces[1].joint, traces[1].signal)
    )
    np.testing.assert_array_equal(one["after"], traces[1].after)
    assert frame["target"].isna().sum() == 50


def test_mcap_has_all(traces, tmp_path):
    reader = pytest.importorskip("mcap.reader")
    path = write_traces(traces, tmp_path / "t.mcap")
    found = {}
    with path.open("rb") as file:
        for _, channel, message in reader.make_reader(file).iter_messages():
            found.setdefault(channel.topic, []).append(
                (message.log_time * 1e-9, json.loads(message.data))
            )
    assert len(found) == len(traces)
    for trace in traces:
        rows = found[f"/{trace.recording}/{trace.joint}/{trace.signal}"]
        np.testing.assert_allclose([time for time, _ in rows], trace.time, atol=1e-9)
        np.testing.assert_array_equal([row["measured"] for _, row in rows], trace.measured)
    assert "before" not in found[f"/{traces[0].recording}/{traces[0].joint}/position"][-1][1]


def test_rrd_has_all(traces, tmp_path):
    pytest.importorskip("rerun")
    path = write_traces(traces, tmp_path / "t.rrd")
    assert path.read_bytes()[:3] == b"RRF"
    assert path.stat().st_size > 50 * 8 * len(traces)


def test_another_ending_is_refused(traces, tmp_path):
    with pytest.raises(InputError, match=r"ends in \.parquet, \.mcap, \.rrd"):
        write_traces(traces, tmp_path / "t.bag")
