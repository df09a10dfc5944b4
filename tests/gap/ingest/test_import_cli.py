from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from tests.gap.ingest.writers import WRITERS
from walkerkit.gap import Recording, cli
from walkerkit.walkers.leg import LEG_XML


def run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], *arguments: object
) -> tuple[int, str, str]:
    """Runs the program in this process: its exit status, what it printed, and the errors."""
    monkeypatch.setattr(sys, "argv", ["walkerkit", *map(str, arguments)])
    capsys.readouterr()
    with pytest.raises(SystemExit) as ended:
        cli.main()
    captured = capsys.readouterr()
    return int(ended.value.code or 0), captured.out, captured.err


def test_import_writes_recordings_and_a_map_that_gives_the_same_bytes(
    tmp_path: Path,
    log: Recording,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = WRITERS["plotjuggler"].write(log, tmp_path)
    out, again = tmp_path / "recordings", tmp_path / "again"
    status, printed, errors = run(
        monkeypatch, capsys, "import", path, "--model", LEG_XML, "--out", out
    )
    assert (status, errors) == (0, "")
    made = Recording.load(out / "plotjuggler.parquet")
    np.testing.assert_array_equal(made.columns["calf/effort"], log.columns["calf/effort"])
    assert "plotjuggler.parquet: 3 joints, 0.998 s at 500 Hz" in printed
    assert (out / "map.toml").read_text(encoding="utf-8") in printed
    options = ("--map", out / "map.toml", "--out", again)
    assert run(monkeypatch, capsys, "import", path, "--model", LEG_XML, *options)[0] == 0
    for name in ("plotjuggler.parquet", "map.toml"):
        assert (again / name).read_bytes() == (out / name).read_bytes()

    status, _, errors = run(monkeypatch, capsys, "import", path, "--model", LEG_XML, *options)
    assert status == 0  # what an import has left, another may replace
    (again / "map.toml").write_text("mine")
    (again / ".walkerkit-run.json").unlink()
    status, _, errors = run(monkeypatch, capsys, "import", path, "--model", LEG_XML, *options)
    assert status == 2
    assert "--overwrite" in errors


def test_two_logs_of_one_name_and_a_folder_that_is_none(
    tmp_path: Path,
    log: Recording,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    path = WRITERS["pace_npz"].write(log, tmp_path)
    options = ("--model", LEG_XML, "--out", tmp_path / "out")
    status, _, errors = run(monkeypatch, capsys, "import", path, path, *options)
    assert status == 2
    assert "another log becomes chirp_data.parquet too" in errors
    status, _, errors = run(monkeypatch, capsys, "import", tmp_path, *options)
    assert status == 2
    assert "neither a bag (it has no metadata.yaml) nor a LeRobot data set" in errors
    (tmp_path / "notes.docx").write_text("text")
    status, _, errors = run(monkeypatch, capsys, "import", tmp_path / "notes.docx", *options)
    assert status == 2
    assert "'.docx' is no format of logs. Known are .mcap" in errors
    assert not (tmp_path / "out").exists()
