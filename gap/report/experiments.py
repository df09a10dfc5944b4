"""The experiments.toml that a diagnosis leaves, or proposes: models and recordings to go on with.

    mended_experiments(problem, ["model_a.xml", "model_b.xml"])    # for `walkerkit compare`
    next_experiments(problem, "next_experiment.xml")               # for `walkerkit diagnose`

The user's files are named by their whole paths, so that it does not matter where it lies.
"""

from __future__ import annotations

import json
from collections.abc import Sequence

from walkerkit.gap.recordings.files import is_recording
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.simulation.robot import Robot


def mended_experiments(problem: Problem, models: Sequence[str]) -> str:
    """The recordings with the mended models.

    Args:
        problem: what was explained.
        models: files of the mended models, one for each of its robots.
    """
    return _experiments(problem, models)


def next_experiments(problem: Problem, model: str) -> str:
    """The recordings with the models as they were given, and one that is still to be made.

    Args:
        problem: what was explained.
        model: file of the model with the next experiment's set-up.
    """
    told = [f"# next_experiments.toml, beside {model}"]
    if any(robot.path is None for robot in problem.robots):
        told.append("# diagnose it with --allow-code, as a model is a callable")
    if any(_file(recording) is None for recording in problem.recordings):
        told.append("# save first what came from no file: recording.save(...)")
    return "\n".join(
        [
            *told,
            _experiments(problem, [_source(robot) for robot in problem.robots]),
            "[[experiment]]",
            f"model = {_text(model)}",
            'recordings = ["RECORDED.csv"]  # what you have recorded of it',
        ]
    )


def _experiments(problem: Problem, models: Sequence[str]) -> str:
    parts = []
    groups = zip(models, problem.fit.recordings, problem.held.recordings, strict=True)
    for model, fitted, held in groups:
        parts.append("[[experiment]]")
        parts.append(f"model = {_text(model)}")
        listed = _files(fitted)
        # Blocks of one recording in both halves: whoever reads this cuts it in the same way.
        others = [file for file in _files(held) if file not in listed]
        for key, files in (("recordings", listed), ("held_out", others)):
            if files:
                parts.append(f"{key} = [{', '.join(map(_text, files))}]")
        parts.append("")
    return "\n".join(parts)


def _files(recordings: Sequence[Recording]) -> list[str]:
    """The files that recordings, or parts of them, come from or may be saved as; each once."""
    return list(dict.fromkeys(_file(r) or f"{r.whole.name}.csv" for r in recordings))


def _file(recording: Recording) -> str | None:
    """What can be read again; nothing of what was imported, or was never a file."""
    source = recording.source
    if source is None or recording.imported or not is_recording(source):
        return None
    return str(source.resolve())


def _source(robot: Robot) -> str:
    return robot.source if robot.path is None else str(robot.path.resolve())


def _text(value: str) -> str:
    return json.dumps(value, ensure_ascii=False)
