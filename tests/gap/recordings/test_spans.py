"""Spans of a recording that are left out: how they are written, and that nothing crosses them."""

import numpy as np
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.experiments.experiment import Experiment, load_experiments, load_manifest
from walkerkit.gap.experiments.split import split_in_time
from walkerkit.gap.recordings.checks import check_recordings
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.spans import Skip

TIME = np.arange(0, 12, 0.01)


def log(name="walk", **changed):
    columns = {"knee/position": np.sin(TIME), "knee/position_target": np.sin(TIME + 0.1)}
    return Recording(name=name, time=TIME, columns={**columns, **changed})


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "leg.xml").write_text("<mujoco/>", encoding="utf-8")
    for name in ("walk", "run", "hop"):
        log().save(tmp_path / f"{name}.csv")
    return tmp_path


@pytest.mark.parametrize(
    ("text", "file", "start", "stop"),
    [
        ("8.0:8.6", None, 8.0, 8.6),
        ("walk.csv=8:8.6", "walk.csv", 8.0, 8.6),
        ("a=b.csv=1e1:11", "a=b.csv", 10.0, 11.0),
        ("walk=:0.5", "walk", -np.inf, 0.5),
        ("11:", None, 11.0, np.inf),
        ("-1:2", None, -1.0, 2.0),
    ],
)
def test_a_span_is_read_as_it_is_written(text, file, start, stop):
    assert Skip.of(text) == Skip(file=file, start=start, stop=stop)


@pytest.mark.parametrize("text", ["8.6:8.0", "8", ":", "a:b", "walk.csv", "1:1", "", 8.0, "nan:1"])
def test_what_is_no_span_is_refused(text):
    with pytest.raises(InputError, match=r"is no span to skip. Write it as 8.0:8.6"):
        Skip.of(text)


def test_rows_of_a_span_are_left_out_and_nothing_goes_on_across_it():
    cut = log().without((8.0, 8.6), (2.0, 2.02))
    assert not ((cut.time >= 8.0) & (cut.time < 8.6)).any()
    assert cut.time.size == TIME.size - 62
    check_recordings([cut])  # a pause that was asked for is none
    fitted, held = split_in_time([Experiment(model="leg.xml", recordings=(cut,))])
    parts = [*fitted[0], *held[0]]
    for part in parts:
        for edge in (2.01, 8.3):
            assert not part.time[0] < edge < part.time[-1]
    # The brief span, too, which no one would take for a hole.
    assert sum(part.time.size for part in parts) > 0.9 * cut.time.size
    assert all("was skipped, as asked" in " ".join(part.notes) for part in parts)
    assert not any("hole" in note for part in parts for note in part.notes)


def test_what_is_wrong_within_a_span_is_no_longer(folder):
    bad = np.array(np.sin(TIME))
    bad[805:830] = np.nan
    rows = np.stack([TIME, bad, np.sin(TIME + 0.1)], axis=1)
    text = "time,knee/position,knee/position_target\n" + "\n".join(
        ",".join("" if np.isnan(x) else repr(float(x)) for x in row) for row in rows
    )
    (folder / "fall.csv").write_text(text, encoding="utf-8")
    cut = Recording.load("fall.csv", skip=((8.0, 8.6),))
    assert cut.time.size == TIME.size - 60
    assert cut.row(cut.time.size - 1).startswith(f"row {TIME.size} ")


def test_the_remedy_of_a_pause_can_be_a_span():
    paused = Recording(
        name="walk",
        time=np.where(TIME < 6, TIME, TIME + 3),
        columns={"knee/position": np.sin(TIME), "knee/position_target": np.cos(TIME)},
    )
    with pytest.raises(InputError, match=r"pause of 3.01 s"):
        check_recordings([paused])
    check_recordings([paused.without((5.95, 9.05))])


@pytest.mark.parametrize("name", ["walk.csv", "walk", "./walk.csv"])
def test_a_span_is_of_the_file_that_it_names(folder, name):
    (experiment,) = load_experiments(
        "leg.xml", ["walk.csv", "run.csv"], held_out=["hop.csv"], skip=[f"{name}=8:8.6", "hop=:1"]
    )
    walk, run, hop = experiment.recordings
    assert (walk.skipped, run.skipped, hop.skipped) == (((8.0, 8.6),), (), ((-np.inf, 1.0),))
    assert hop.time[0] == 1.0


def test_recordings_and_held_out_ones_are_cut_as_files_are(folder):
    one, other = log("one"), log("other")
    (experiment,) = load_experiments(
        "leg.xml", [one, other], held_out=[other], skip=["one=8:8.6", "other=1:2"]
    )
    assert [len(r.skipped) for r in experiment.recordings] == [1, 1]
    assert experiment.held_out == {"other"}


def test_the_only_recording_needs_no_name(folder):
    (experiment,) = load_experiments("leg.xml", "walk.csv", skip=["8:8.6", "11:"])
    assert experiment.recordings[0].time[-1] == pytest.approx(10.99)


@pytest.mark.parametrize(
    ("skip", "told"),
    [
        ("8:9", "there are 2 recordings. Say of which, as in walk.csv=8:9"),
        ("wlk.csv=8:9", r"no recording is called 'wlk.csv' \(did you mean 'walk.csv'"),
        ("walk.csv=20:21", "no row lies between 20 and 21 s.* Its time goes from 0 to 11.99 s"),
        ("walk.csv=0:11.99", "all of it is to be skipped"),
    ],
)
def test_spans_that_are_nowhere_are_refused(folder, skip, told):
    with pytest.raises(InputError, match=told):
        load_experiments("leg.xml", ["walk.csv", "run.csv"], skip=[skip])


def test_a_manifest_says_what_is_skipped(folder):
    manifest = folder / "experiments.toml"
    manifest.write_text(
        '[[experiment]]\nmodel = "leg.xml"\nrecordings = ["walk.csv", "run.csv"]\n'
        'skip = ["walk.csv=8.0:8.6"]\n',
        encoding="utf-8",
    )
    (experiment,) = load_manifest(manifest)
    assert [r.skipped for r in experiment.recordings] == [((8.0, 8.6),), ()]
    with pytest.raises(InputError, match=r'Write skip = \["walk.csv=1:2"\] below'):
        load_experiments(manifest, skip=["walk.csv=1:2"])
