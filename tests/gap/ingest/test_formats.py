"""One log in every format: the same recording to the last bit, and so the same comparison."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gap.ingest.writers import JOINTS, WRITERS, Format
from walkerkit import gap
from walkerkit.gap import Recording
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.ingest.column_map import ColumnMap
from walkerkit.gap.ingest.importing import import_log
from walkerkit.gap.ingest.readers import is_foreign
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.walkers.leg import LEG_XML

PERCENT = """
[signals.position]
unit = "m100"
"""


def given_map(name: str, folder: Path) -> Path | None:
    """What a user has to say of a format, if anything."""
    if name != "lerobot_percent":
        return None
    path = folder / "unit.toml"
    path.write_text(PERCENT)
    return path


def check_same(found: Recording, log: Recording, form: Format) -> None:
    expected = form.expected(log)
    np.testing.assert_array_equal(found.time, log.time)
    assert set(found.columns) == set(expected)
    for column, values in expected.items():
        np.testing.assert_array_equal(found.columns[column], values, err_msg=column)


@pytest.mark.parametrize("name", WRITERS)
def test_a_log_in_any_format_is_the_same_recording(
    tmp_path: Path, log: Recording, name: str
) -> None:
    form = WRITERS[name]
    path = form.write(log, tmp_path)
    said = given_map(name, tmp_path)
    robot = load_robot(LEG_XML)
    imported = import_log(path, robot, None if said is None else ColumnMap.load(said))
    (recording,) = imported.recordings
    check_same(recording, log, form)
    for signal in ("position", "position_target"):  # and near what it was, in spite of float32
        for joint in JOINTS:
            was = log.columns[f"{joint}/{signal}"]
            np.testing.assert_allclose(recording.columns[f"{joint}/{signal}"], was, atol=1e-6)

    # `compare` and `diagnose` read it on the way, by the map that was written.
    assert is_foreign(path)
    kept = tmp_path / "map.toml"
    kept.write_text(imported.map.to_toml(), encoding="utf-8")
    (experiment,) = load_experiments(str(LEG_XML), [path], column_map=kept)
    check_same(experiment.recordings[0], log, form)
    assert ColumnMap.load(kept).to_toml() == imported.map.to_toml()


def test_the_comparison_is_the_same_to_the_last_digit(tmp_path: Path, log: Recording) -> None:
    log.save(tmp_path / "chirp.csv")
    ours = gap.compare(LEG_XML, tmp_path / "chirp.csv", n_threads=1)
    path = WRITERS["bag_mcap_joint_states"].write(log, tmp_path)
    theirs = gap.compare(LEG_XML, path, n_threads=1)
    same = replace(theirs, recordings=ours.recordings, notes=ours.notes, seconds=ours.seconds)
    assert same.to_json() == ours.to_json().replace("chirp[", "run[")


def test_a_manifest_has_logs_of_other_formats(tmp_path: Path, log: Recording) -> None:
    WRITERS["lerobot_percent"].write(log, tmp_path)
    WRITERS["pace_npz"].write(log, tmp_path)
    given_map("lerobot_percent", tmp_path)
    (tmp_path / "experiments.toml").write_text(
        f"""
        [[experiment]]
        model = "{LEG_XML}"
        recordings = ["leg_data"]
        map = "unit.toml"

        [[experiment]]
        model = "{LEG_XML}"
        recordings = ["chirp_data.npz"]
        """
    )
    first, second = load_experiments(tmp_path / "experiments.toml")
    check_same(first.recordings[0], log, WRITERS["lerobot_percent"])
    check_same(second.recordings[0], log, WRITERS["pace_npz"])
    assert first.recordings[0].name == "leg_data_episode_000"


def test_our_own_files_are_read_as_ever(tmp_path: Path, log: Recording) -> None:
    for suffix in (".csv", ".parquet", ".npz"):
        log.save(tmp_path / f"own{suffix}")
        assert not is_foreign(tmp_path / f"own{suffix}")
    (tmp_path / "broken.parquet").write_text("no parquet")
    assert not is_foreign(tmp_path / "broken.parquet")
    assert not is_foreign(tmp_path / "missing.csv")
