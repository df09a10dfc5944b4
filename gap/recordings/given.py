"""What a user gives in Python: a model and recordings, by name or as objects.

model = model_name("leg.xml")                 # refuses objects, and says what to do with them
recordings = listed("walk.csv")               # one is a list of one
recording = recording_of(recordings[0])       # a file is loaded
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import FunctionType
from typing import Any

from walkerkit.gap.errors import closest, refusal
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.spans import Skip, spans_of

Named = str | Path | Recording
"""A recording, or the file of one."""
OneOrMore = Named | Sequence[Named]

_A_MODEL = (
    'A model is the path of an MJCF file, "package.module:callable", '
    'or a manifest "experiments.toml"'
)
_A_FUNCTION = (
    "Write a function without arguments that returns it and give its name, as in "
    '"my_robot:make" for make() in my_robot.py'
)


def model_name(model: str | Path) -> str:
    """The name of a model: a path, or `package.module:callable`.

    Raises:
        InputError: it is an object, or MJCF text, with how to go on from there.
    """
    if isinstance(model, str) and model.lstrip().startswith("<"):
        raise refusal(f"the model is MJCF text. Save it to a file. {_A_MODEL}.")
    if isinstance(model, str | os.PathLike):
        return str(model)
    raise refusal(f"the model is {_kind(model)}. {_remedy(model)}. {_A_MODEL}.")


def is_callable(source: str) -> bool:
    """Whether a model is named by `package.module:callable`, not by a file."""
    head, separator, tail = source.rpartition(":")
    return bool(separator) and tail.isidentifier() and "/" not in head and "\\" not in head


def listed(items: OneOrMore) -> list[Named]:
    """Several items as a list, and a single one as a list of one."""
    given: Any = items
    # A data frame or a mapping is one recording that was meant, not a series of names.
    one = isinstance(given, str | os.PathLike | Recording | Mapping) or _is_frame(given)
    return [given] if one or not isinstance(given, Iterable) else list(given)


def recording_of(item: object, skips: Sequence[Skip] = ()) -> Recording:
    """A recording as it is, or loaded from its file, without what is to be skipped.

    Raises:
        InputError: it is neither, or the file cannot be used.
    """
    if isinstance(item, Recording):
        spans = spans_of(str(item.source or item.name), skips)
        return item.without(*spans) if spans else item
    if isinstance(item, str | os.PathLike):
        return Recording.load(Path(item), skip=spans_of(str(item), skips))
    if _is_frame(item):
        raise refusal(
            f"a recording is {_kind(item)}. Save it with "
            'frame.to_csv("log.csv", index=False) and give "log.csv", or give '
            'gap.Recording(name="log", time=frame["time"], columns={"knee/position": '
            'frame["knee/position"], ...}).'
        )
    raise refusal(
        f"a recording is {_kind(item)}. Give the path of a .csv, .parquet or .npz file, or "
        'gap.Recording(name="log", time=..., columns={"knee/position": ..., '
        '"knee/position_target": ...}).'
    )


def check_keys(label: str, table: Iterable[str], valid: Sequence[str]) -> None:
    """Raises InputError, which begins with the label, where a table has another key."""
    for key in table:
        if key not in valid:
            raise refusal(
                f"{label}: unknown key {key!r}{closest(key, valid)}. "
                f"The keys are {', '.join(valid)}."
            )


def _is_frame(item: object) -> bool:
    """Whether it is a table of pandas or the like; pandas itself may not be loaded yet."""
    return type(item).__name__ == "DataFrame"


def _kind(item: object) -> str:
    kind = type(item)
    of = "" if kind.__module__ == "builtins" else f" of {kind.__module__.partition('.')[0]}"
    return f"an object of type {kind.__name__}{of}"


def _remedy(model: Any) -> str:
    """How to go on from an object to what a model may be."""
    import mujoco

    if isinstance(model, mujoco.MjModel):
        return "Give the file that it was compiled from"
    if isinstance(model, mujoco.MjSpec):
        return (
            "Compile it, save it with "
            'pathlib.Path("robot.xml").write_text(spec.to_xml()) and give that file'
        )
    if isinstance(model, FunctionType | type):
        return f'Give its name, as in "{model.__module__}:{model.__name__}"'
    if hasattr(model, "mjcf_model") or hasattr(model, "to_xml_string"):  # a walker, or PyMJCF
        return _A_FUNCTION
    return "Give its file"
