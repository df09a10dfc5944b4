"""Logs that begin while joints move, by commands that are not in them."""

from __future__ import annotations

import numpy as np
import pytest

from walkerkit.gap.recordings.beginning import LONGEST_DELAY, from_known, moving
from walkerkit.gap.recordings.recording import Recording

TIME = 2.0 + np.arange(1000) * 0.002


def log(noise: float = 0.0, **positions: np.ndarray) -> Recording:
    rng = np.random.default_rng(0)
    columns = {}
    for joint, position in positions.items():
        columns[f"{joint}/position"] = position + rng.normal(0, noise, len(position))
        columns[f"{joint}/position_target"] = position
    return Recording(name="log", time=TIME, columns=columns)


@pytest.mark.parametrize("noise", [0.0, 1e-4])
def test_what_moves_at_the_first_row_is_told_from_what_sets_out_there(noise: float) -> None:
    late = TIME - TIME[0]
    swings, sets_out = np.sin(3 * late), 1 - np.cos(3 * late)
    stands, slow = np.zeros_like(late), np.sin(3 * late + 1.5)
    everything = log(noise, hip=swings, knee=sets_out, ankle=stands, toe=slow)
    assert moving(everything) == ("hip",)
    assert moving(log(noise, knee=sets_out, ankle=stands)) == ()


def test_noise_alone_is_no_motion() -> None:
    for seed in range(20):
        noise = np.random.default_rng(seed).normal(0, 1e-3, len(TIME))
        assert moving(log(hip=noise)) == ()


@pytest.mark.parametrize("unit", [1e-3, 1.0, 50.0])
def test_motions_of_every_size_are_seen(unit: float) -> None:
    assert moving(log(hip=unit * np.sin(3 * (TIME - TIME[0])))) == ("hip",)


def test_the_part_whose_commands_are_known_keeps_its_name_and_knows_the_rest() -> None:
    swing = log(hip=np.sin(3 * (TIME - TIME[0])))
    part = from_known(swing)
    assert (part.name, part.whole) == ("log", swing)
    assert part.time[0] == pytest.approx(TIME[0] + LONGEST_DELAY)
    assert part.time[-1] == TIME[-1]


def test_a_short_log_and_one_that_begins_at_rest_stay_whole() -> None:
    swing = log(hip=np.sin(3 * (TIME - TIME[0]))).between(2.0, 2.4)
    rest = log(hip=1 - np.cos(3 * (TIME - TIME[0])))
    assert (from_known(swing), from_known(rest)) == (swing, rest)
