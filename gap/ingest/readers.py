"""Which reader a path takes.

logs = read_logs(Path("run_1.mcap"))      # one log, or one for each episode of a data set
is_foreign(Path("walk.csv"))              # whether it is more than a file of ours
"""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet

from walkerkit.actuators.networks.npz import open_npz
from walkerkit.gap.errors import refusal
from walkerkit.gap.ingest import lerobot
from walkerkit.gap.ingest.arrays import read_arrays
from walkerkit.gap.ingest.bag import read_bag
from walkerkit.gap.ingest.log import Log
from walkerkit.gap.ingest.tables import read_table
from walkerkit.gap.recordings.dialect import Dialect
from walkerkit.gap.recordings.files import MOST_VALUES, is_recording
from walkerkit.gap.recordings.recording import SIGNALS

_BAGS = (".mcap", ".db3")
_TABLES = (".csv", ".tsv", ".txt", ".parquet", ".jsonl", ".ndjson", ".json")
_ARRAYS = (".npz", ".npy", ".pt", ".pth")


def read_logs(path: Path, calibration: Path | None = None) -> list[Log]:
    """Reads a log of any format that is known.

    Args:
        path: a file, a bag's folder, or the folder of a LeRobot data set.
        calibration: of a LeRobot data set, the robot's calibration.

    Raises:
        ImportError: a package that the format takes is not installed.
        InputError: it cannot be read.
    """
    if lerobot.is_dataset(path):
        return lerobot.read_dataset(path, calibration)
    suffix = path.suffix.lower()
    if suffix in _BAGS or (path / "metadata.yaml").is_file():
        return [read_bag(path)]
    if path.is_dir():
        raise refusal(
            f"{path}: this folder is neither a bag (it has no metadata.yaml) nor a LeRobot data "
            f"set (it has no {lerobot.INFO}). Name a file in it."
        )
    if suffix in _TABLES:
        return [read_table(path)]
    if suffix in _ARRAYS:
        return [read_arrays(path)]
    raise refusal(
        f"{path}: {suffix or 'no suffix'!r} is no format of logs. Known are "
        f"{', '.join((*_BAGS, *_TABLES, *_ARRAYS))}, bags and LeRobot data sets."
    )


def is_foreign(path: Path) -> bool:
    """Whether a path has to be imported first, because it is no recording of ours.

    What is neither, a file that is missing or broken, is none: whoever loads it says so.
    """
    if path.is_dir():
        return lerobot.is_dataset(path) or (path / "metadata.yaml").is_file()
    if not path.is_file() or not path.stat().st_size:
        return False
    if not is_recording(path):
        return path.suffix.lower() in (*_BAGS, *_TABLES, *_ARRAYS)
    try:
        names = _header(path)
    except Exception:  # it is broken in one of many ways, as whoever loads it will say
        return False
    # A name that begins with a slash is a topic's.
    return bool(names) and not any(
        name.rpartition("/")[2] in SIGNALS and not name.startswith("/") for name in names
    )


def _header(path: Path) -> list[str]:
    suffix = path.suffix.lower()
    if suffix == ".csv":
        return list(Dialect.of(path).header)
    if suffix == ".parquet":
        with pyarrow.parquet.ParquetFile(path) as file:
            return list(file.schema_arrow.names)
    with path.open("rb") as stream:
        return list(open_npz(stream, most_bytes=8 * MOST_VALUES).names)
