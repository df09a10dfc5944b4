"""Any log → recordings, with the map by which they were read.

    imported = import_log("run_1.mcap", load_robot("leg.xml"))
    imported.recordings, imported.map.to_toml(), imported.notes

The steps, each of which can be used alone: `read_logs` (columns), `complete` (the map) and
`recording_of` (rows).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from walkerkit.gap.errors import refusal
from walkerkit.gap.ingest.column_map import ColumnMap
from walkerkit.gap.ingest.guess import complete
from walkerkit.gap.ingest.log import Column, Log, Topic
from walkerkit.gap.ingest.model import Model
from walkerkit.gap.ingest.readers import read_logs
from walkerkit.gap.ingest.rows import recording_of
from walkerkit.gap.recordings.recording import Recording, remarks
from walkerkit.gap.simulation.robot import Robot


@dataclass(frozen=True, kw_only=True)
class Imported:
    """What became of a log.

    Attributes:
        recordings: one, or one for each episode of a data set.
        map: by which they were read; it gives the same again.
        notes: what was assumed in the map.
    """

    recordings: tuple[Recording, ...]
    map: ColumnMap
    notes: tuple[str, ...]


def import_log(
    path: str | Path,
    robot: Robot,
    column_map: ColumnMap | None = None,
    *,
    calibration: str | Path | None = None,
) -> Imported:
    """Reads a log of any format that is known.

    Args:
        path: a file, a bag's folder, or the folder of a LeRobot data set.
        robot: the model that it is of.
        column_map: what is known of its columns; the rest is guessed.
        calibration: of a LeRobot data set, the robot's file of `lerobot-calibrate`.

    Raises:
        ImportError: a package that the format takes is not installed.
        InputError: it cannot be read, or it is in doubt what it means.
    """
    path, given = Path(path), column_map or ColumnMap()
    logs = read_logs(path, None if calibration is None else Path(calibration))
    if given.episodes is not None:
        logs = _chosen(path, logs, given.episodes)
    mapping, notes = complete(_together(logs), Model.of(robot), given)
    recordings = [recording_of(log, mapping) for log in logs]
    return Imported(
        recordings=tuple(
            replace(r, notes=tuple(dict.fromkeys((*r.notes, *notes, *remarks(r)))))
            for r in recordings
        ),
        map=mapping,
        notes=notes,
    )


def _chosen(path: Path, logs: list[Log], episodes: tuple[int, ...]) -> list[Log]:
    known = {int(log.name.rpartition("_")[2]): log for log in logs if "_episode_" in log.name}
    for episode in episodes:
        if episode not in known:
            raise refusal(
                f"{path}: it has no episode {episode}, which the map names. It has "
                f"{f'{min(known)} to {max(known)}' if known else 'none'}."
            )
    return [known[episode] for episode in episodes]


def _together(logs: list[Log]) -> Log:
    """All episodes of a data set as one log, which shows most of what its numbers can be."""
    first = logs[0]
    if len(logs) == 1:
        return first
    topics = {
        name: Topic(
            kind=topic.kind,
            size=sum(log.topics[name].size for log in logs),
            clocks={
                clock: np.concatenate([log.topics[name].clocks[clock] for log in logs])
                for clock in topic.clocks
            },
        )
        for name, topic in first.topics.items()
    }
    columns = {
        name: Column(
            topic=column.topic, values=np.concatenate([log.columns[name].values for log in logs])
        )
        for name, column in first.columns.items()
    }
    return replace(first, topics=topics, columns=columns)
