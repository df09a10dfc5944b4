"""Notes that differ in joint and numbers alone are one, with their count."""

import numpy as np

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.report.folded import folded

JOINTS = ("hip", "knee", "ankle", "toe", "heel")


def log(name, *notes):
    columns = {f"{joint}/position": np.zeros(9) for joint in JOINTS}
    columns["hip/position_target"] = np.zeros(9)
    return Recording(name=name, time=np.arange(9) / 10, columns=columns, notes=notes)


def test_a_note_of_one_joint_is_as_it_was():
    assert [*folded([log("walk", "hip/position jumps by a turn 3 times", "it is in UTF-16")])] == [
        "walk: hip/position jumps by a turn 3 times",
        "walk: it is in UTF-16",
    ]


def test_notes_of_many_joints_and_recordings_are_one():
    notes = [f"{joint}/position jumps by a turn {k} times" for k, joint in enumerate(JOINTS, 1)]
    found = [*folded([log("walk", *notes), log("run", "joint 'toe' never moves", notes[0])])]
    assert found == [
        "walk: hip/position jumps by a turn 1 times (and 5 more like it, of knee, ankle, toe and 1 "
        "more and in run)",
        "run: joint 'toe' never moves",
    ]


def test_parts_of_a_recording_say_it_once():
    whole = log("walk", "its cells are separated by tabs")
    parts = [whole.between(0.0, 0.4), whole.between(0.4, 1.0)]
    assert [*folded(parts)] == ["walk: its cells are separated by tabs"]
