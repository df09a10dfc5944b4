"""Which stretches stand for all."""

import numpy as np
import pytest

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import Segment, stretches
from walkerkit.gap.search.excerpt import Gaps, representative, spread

RATE, SECONDS, LONG = 100, 20, 1.0


@pytest.fixture
def recording() -> Recording:
    time = np.arange(RATE * SECONDS + 1) / RATE
    still = np.zeros(len(time))
    columns = {"hip/position": still, "hip/position_target": still}
    return Recording(name="log", time=time, columns=columns)


@pytest.fixture
def segments(recording: Recording) -> tuple[Segment, ...]:
    return stretches(recording, LONG)


def gaps(recording: Recording, *channels: dict[int, float]) -> Gaps:
    """Of each channel 1 everywhere, but another square in some seconds."""
    squares = np.ones((len(recording.time), len(channels)))
    for c, seconds in enumerate(channels):
        for second, square in seconds.items():
            squares[second * RATE : (second + 1) * RATE, c] = square
    return Gaps(rows={id(recording): (recording.time, squares)})


def test_spread_evenly() -> None:
    assert spread(20, share=0.2, phase=0.5, fewest=1) == [2, 7, 12, 17]
    assert spread(20, share=0.01, phase=0.5, fewest=2) == [5, 15]
    assert spread(3, share=1.0, phase=0.5, fewest=5) == [0, 1, 2]


def test_an_even_gap_moves_nothing(recording, segments) -> None:
    chosen = [2, 7, 12, 17]
    assert representative(segments, chosen, gaps(recording, {}, {7: 20.0})) == chosen


def test_what_shows_in_one_second_is_in(recording, segments) -> None:
    found = representative(segments, [2, 7, 12, 17], gaps(recording, {9: 500.0}, {}))
    assert 9 in found
    assert len(found) == 4
    assert len({2, 7, 12, 17} & set(found)) == 3


def test_each_channel_has_its_part(recording, segments) -> None:
    rare = gaps(recording, {9: 500.0}, {4: 900.0}, {12: 300.0})
    assert representative(segments, [2, 7, 12, 17], rare) == [2, 4, 9, 12]


def test_half_of_what_is_even_stays(recording, segments) -> None:
    rare = gaps(recording, *({second: 500.0} for second in (0, 3, 5, 9, 11)))
    found = representative(segments, [2, 7, 12, 17], rare)
    assert len(found) == 4
    assert len({2, 7, 12, 17} & set(found)) == 2
    assert representative(segments, [10], rare) == [10]


def test_of_a_recording_that_was_not_simulated_nothing_is_known(recording, segments) -> None:
    assert representative(segments, [2, 7], Gaps(rows={})) == [2, 7]
