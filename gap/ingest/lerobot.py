"""Data sets of LeRobot as logs, one for each episode.

    logs = read_dataset(Path("so101_pick"), calibration=Path("my_arm.json"))
    logs[0].columns["observation.state[shoulder_pan.pos]"]

Versions 2 and 3 are read: `meta/info.json` names the numbers of `observation.state` and `action`
and has the rate; rows are in Parquet files under `data/`. Positions are in whatever unit the robot
was recorded in, which the data set does not say: degrees, per cent of the calibrated range
(-100 to 100, a gripper 0 to 100) or radians. `lerobot-calibrate` leaves a JSON file for each robot
with `range_min` and `range_max`, in counts of an encoder with 4096 a turn, of which LeRobot makes
angles with 360/4095 degrees a count.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.compute
import pyarrow.parquet

from walkerkit.gap.errors import one_line, refusal
from walkerkit.gap.ingest.log import Log
from walkerkit.gap.ingest.tables import log_of

INFO = Path("meta") / "info.json"
_COUNT = 2 * math.pi / 4095  # rad
_VECTORS = ("observation.state", "action")
_ALSO = ("observation.velocity", "observation.effort", "observation.current")


def is_dataset(path: Path) -> bool:
    """Whether a folder is a data set of LeRobot."""
    return (path / INFO).is_file()


def read_dataset(path: Path, calibration: Path | None = None) -> list[Log]:
    """Reads all episodes.

    Args:
        path: the data set's folder.
        calibration: the robot's file of `lerobot-calibrate`; by default `calibration.json` in the
            folder or in `meta`, if there is one.

    Raises:
        InputError: it is no data set, or one of its files is broken.
    """
    info = _json(path / INFO)
    rate, features = info.get("fps"), info.get("features", {})
    if not isinstance(rate, int | float) or not rate > 0:
        raise refusal(f"{path / INFO}: fps is {rate!r}. Write the frames a second.")
    files = sorted((path / "data").rglob("*.parquet"))
    if not files:
        raise refusal(f"{path}: it has no Parquet file under data/. Download the whole data set.")
    vectors = [name for name in (*_VECTORS, *_ALSO) if name in features]
    wanted = [*vectors, "frame_index", "episode_index"]
    try:
        table = pyarrow.concat_tables(
            [pyarrow.parquet.read_table(f, columns=wanted) for f in files]
        )
    except (pyarrow.ArrowException, OSError) as error:
        raise refusal(f"{path}: its data cannot be read: {one_line(error)}.") from error
    names = {vector: _names(features[vector]) for vector in vectors}
    ranges = _calibrated(path, calibration)
    episodes = table.column("episode_index").to_numpy()
    return [
        log_of(
            path,
            _columns(table.filter(pyarrow.array(episodes == episode)), names),
            name=f"{path.name}_episode_{int(episode):03d}",
            rate=float(rate),
            calibrated=ranges,
            convention="lerobot",
        )
        for episode in np.unique(episodes)
    ]


def _columns(table: Any, names: Mapping[str, list[str]]) -> dict[str, Any]:
    order = np.argsort(table.column("frame_index").to_numpy(), kind="stable")
    columns = {"frame_index time": table.column("frame_index").to_numpy()[order]}
    for vector, labels in names.items():
        values = np.stack(table.column(vector).to_numpy()).astype(float)[order]
        values = values.reshape(len(order), -1)
        known = labels if len(labels) == values.shape[1] else range(values.shape[1])
        columns |= {f"{vector}[{label}]": values[:, k] for k, label in enumerate(known)}
    return columns


def _names(feature: Mapping[str, Any]) -> list[str]:
    """The names of a vector's numbers; older data sets have them one level down."""
    names = feature.get("names")
    if isinstance(names, Mapping):
        names = next((value for value in names.values() if isinstance(value, list)), None)
    return [str(name) for name in names] if isinstance(names, list) else []


def _calibrated(path: Path, given: Path | None) -> dict[str, float]:
    """Joint to the width of its calibrated range [rad]."""
    places = [given] if given else [path / "calibration.json", path / "meta" / "calibration.json"]
    file = next((place for place in places if given or place.is_file()), None)
    if file is None:
        return {}
    found = {}
    for motor, entry in _json(file).items():
        try:
            found[motor] = _COUNT * (float(entry["range_max"]) - float(entry["range_min"]))
        except (TypeError, KeyError, ValueError):
            raise refusal(
                f"{file}: motor {motor!r} has no range_min and range_max. Give the file that "
                "lerobot-calibrate has written."
            ) from None
    return found


def _json(file: Path) -> dict[str, Any]:
    try:
        with file.open(encoding="utf-8") as stream:
            content = json.load(stream)
    except (OSError, ValueError) as error:
        raise refusal(f"{file}: cannot be read: {one_line(error)}.") from None
    if not isinstance(content, dict):
        raise refusal(f"{file}: it is no JSON object. Give the file as it was written.")
    return content
