"""What is fitted and what is held out."""

import numpy as np
import pytest

from walkerkit.gap.experiments.experiment import Experiment
from walkerkit.gap.experiments.split import is_in_time, split, split_in_time
from walkerkit.gap.recordings.beginning import LONGEST_DELAY
from walkerkit.gap.recordings.recording import Recording


def recording(name, time=None):
    time = 3.0 + np.arange(0, 6, 0.01) if time is None else time
    late = time - time[0]  # it begins at rest
    columns = {"knee/position": np.cos(late), "knee/position_target": np.sin(late)}
    return Recording(name=name, time=time, columns=columns)


def experiment(*names, held_out=(), model="leg.xml"):
    return Experiment(
        model=model,
        recordings=tuple(recording(name) for name in names),
        held_out=frozenset(held_out),
    )


def names(groups):
    return [[r.name for r in group] for group in groups]


def test_what_was_declared_is_held_out_and_nothing_else():
    fitted, held = split([experiment("a", "b", "c", "d", held_out=["b"])])
    assert names(fitted) == [["a", "c", "d"]]
    assert names(held) == [["b"]]


def test_what_one_experiment_declares_counts_for_all():
    fitted, held = split([experiment("a", "b", "c"), experiment("d", "e", held_out=["d", "e"])])
    assert names(fitted) == [["a", "b", "c"], []]
    assert names(held) == [[], ["d", "e"]]


@pytest.mark.parametrize(
    ("given", "fitted", "held"),
    [
        (["abc"], ["ab"], ["c"]),
        (["abcdefg"], ["abdeg"], ["cf"]),
        (["ab", "c"], ["ab", ""], ["", "c"]),
        (["a", "bcd", "ef"], ["a", "bd", "e"], ["", "c", "f"]),
    ],
)
def test_every_third_of_three_or_more_is_held_out_over_all_experiments(given, fitted, held):
    found = split([experiment(*letters) for letters in given])
    assert [["".join(group) for group in names(half)] for half in found] == [fitted, held]


@pytest.mark.parametrize("given", [["a"], ["ab"], ["a", "b"]])
def test_one_or_two_recordings_are_split_in_time(given):
    experiments = [experiment(*letters) for letters in given]
    fitted, held = split(experiments)
    assert (names(fitted), names(held)) == tuple(map(names, split_in_time(experiments)))
    for one, mine, others in zip(experiments, fitted, held, strict=True):
        for whole in one.recordings:
            parts = [r for r in (*mine, *others) if r.name.startswith(f"{whole.name}[")]
            parts.sort(key=lambda part: part.time[0])
            # Every sample is in exactly one block.
            for name in whole.columns:
                together = np.concatenate([part.columns[name] for part in parts])
                np.testing.assert_array_equal(together, whole.columns[name])
            late = [part for part in parts if part in others]
            assert sum(len(part.time) for part in late) == pytest.approx(200, abs=2)
            # Both halves see the recording early and late.
            assert late[0].time[-1] < 3 + 3.1
            assert late[-1].time[-1] == whole.time[-1]
    everything = [r.name for half in (fitted, held) for group in half for r in group]
    assert len(set(everything)) == len(everything)


@pytest.mark.parametrize(
    ("time", "blocks"),
    [
        (np.arange(0, 1.2, 0.01), 3),
        (np.arange(0, 2.2, 0.01), 4),
        (np.arange(0, 100, 0.1), 6),
        (0.01 * np.arange(6), 3),
        (np.r_[np.arange(0, 1, 0.01), np.arange(90, 91, 0.01)], 6),
    ],
    ids=["short", "a little longer", "long", "tiny", "with a gap"],
)
def test_blocks_are_neither_too_short_nor_empty(time, blocks):
    one = Experiment(model="leg.xml", recordings=(recording("a", time),))
    (fitted,), (held,) = split_in_time([one])
    assert len(fitted) + len(held) == blocks
    assert held
    assert min(len(part.time) for part in (*fitted, *held)) >= 2
    assert sum(len(part.time) for part in (*fitted, *held)) == len(time)


def test_splitting_twice_is_the_same():
    first, second = (split([experiment("a")]) for _ in range(2))
    assert tuple(map(names, first)) == tuple(map(names, second))


def test_blocks_of_an_hour_are_short_and_cover_it():
    long = recording("long", np.arange(0, 3600, 0.1))
    whole = Experiment(model="leg.xml", recordings=(long,), held_out=frozenset())
    fitted, held = split_in_time([whole])
    blocks = [*fitted[0], *held[0]]
    assert max(block.duration for block in blocks) <= 120
    assert len(held[0]) == 10
    assert sum(len(block.time) for block in blocks) == len(long.time)


def test_a_long_gap_in_a_log_makes_no_more_blocks():
    time = np.arange(0, 3, 0.01)
    parted = recording("parted", np.concatenate([time, 30_000 + time]))
    whole = Experiment(model="leg.xml", recordings=(parted,), held_out=frozenset())
    fitted, held = split_in_time([whole])
    assert (len(fitted[0]), len(held[0])) == (4, 2)


def test_a_log_is_cut_at_its_holes():
    time = np.delete(0.002 * np.arange(3000), slice(1000, 1100))
    time = np.delete(time, slice(1500, 1510))  # a few samples are no hole
    time = np.delete(time, slice(2700, 2800))  # after which too little is left
    broken = Experiment(
        model="leg.xml",
        recordings=(recording("a"), recording("b", time), recording("c")),
        held_out=frozenset(),
    )
    fitted, held = split([broken])
    assert names(fitted) == [["a", "b[0:1.998]", "b[2.2:5.618]"]]
    assert names(held) == [["c"]]
    assert not is_in_time(fitted, held)
    first, second = fitted[0][1:]
    assert first.time[-1] == pytest.approx(1.998)
    # It moves after the hole, by what nobody knows.
    assert second.time[0] == pytest.approx(2.2 + LONGEST_DELAY)
    (note,) = (one for one in first.notes if "hole" in one)
    assert note.startswith("2 holes, from 1.998 to 2.2 s, from 5.618 to 5.8")
    assert not second.notes
    assert is_in_time(*split_in_time([broken]))


def test_what_begins_in_motion_is_replayed_from_where_its_commands_are_known():
    time = np.arange(0, 6, 0.01)
    columns = {"knee/position": np.sin(time), "knee/position_target": np.sin(time + 0.1)}
    moving = Recording(name="moving", time=time, columns=columns)
    rested = recording("rested", time)
    last = recording("last", time)
    both = Experiment(model="leg.xml", recordings=(moving, rested, last), held_out={"last"})
    ((part, other),), _ = split([both])
    assert (part.name, other) == ("moving", rested)
    assert part.time[0] == pytest.approx(LONGEST_DELAY)
    assert part.whole is moving  # whose commands it knows
    # Where replays restart again and again its beginning says little.
    ((again, _),), _ = split([both], restarts=True)
    assert again is moving
    # Only its first block begins in what nobody knows.
    blocks = sorted((b for half in split_in_time([both]) for b in half[0]), key=lambda b: b.time[0])
    of_it = [block for block in blocks if block.whole is moving]
    assert sum(len(block.time) for block in of_it) == len(time) - round(LONGEST_DELAY / 0.01)
