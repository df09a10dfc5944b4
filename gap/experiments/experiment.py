"""Which recordings belong to which model: `experiments.toml`, or one model and its recordings.

experiments = load_manifest("experiments.toml")
experiments = load_experiments("leg.xml", ["walk.csv", "squat.csv"], held_out=["squat.csv"])

    [[experiment]]
    model = "kp400.xml"                     # or "package.module:callable", where that is allowed
    recordings = ["sin.csv", "step.csv"]    # or logs of any format that `walkerkit import` reads
    held_out = ["chirp.csv"]                # optional, and none of the files above
    skip = ["sin.csv=8.0:8.6"]              # optional, spans of time that are left out
    map = "map.toml"                        # optional: how logs of other formats are read

Files are relative to the manifest's folder. An experiment may be held out as a whole: it then has
`held_out` alone. Recordings get names that are unique over all experiments.
"""

from __future__ import annotations

import itertools
import tomllib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from walkerkit.gap.errors import closest, refusal
from walkerkit.gap.ingest.column_map import ColumnMap
from walkerkit.gap.ingest.importing import import_log
from walkerkit.gap.ingest.readers import is_foreign
from walkerkit.gap.recordings.files import check_file, is_recording
from walkerkit.gap.recordings.given import (
    Named,
    OneOrMore,
    check_keys,
    is_callable,
    listed,
    model_name,
    recording_of,
)
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.spans import Skip, check_skips, spans_of
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.robot import Robot

_KEYS = ("model", "recordings", "held_out", "skip", "map")
_COMMANDS = {"experiment": "diagnose", "robot": "diagnose-fleet"}  # by what a file lists


@dataclass(frozen=True, kw_only=True)
class Experiment:
    """One model and the recordings made of it.

    Attributes:
        model: path of an MJCF file, or `package.module:callable`.
        recordings: all recordings, with the held-out ones last; names are unique.
        held_out: names of the recordings held out; where no experiment has any, the workflow
            decides.

    Raises:
        InputError: there is no recording, two share a name, or `held_out` names none of them.
    """

    model: str
    recordings: tuple[Recording, ...]
    held_out: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        names = [recording.name for recording in self.recordings]
        if not names:
            raise refusal(f"{self.model}: it has no recordings. Give at least one.")
        for name, count in Counter(names).items():
            if count > 1:
                raise refusal(f"{self.model}: {count} recordings are called {name!r}. Rename one.")
        for name in sorted(self.held_out - set(names)):
            raise refusal(
                f"{self.model}: {name!r} is to be held out but is none of its recordings"
                f"{closest(name, names)}. Name one of {', '.join(map(repr, names))}."
            )


def load_manifest(
    path: str | Path, *, allow_code: bool = False, allow_outside: bool = False
) -> tuple[Experiment, ...]:
    """Loads the experiments that a manifest lists.

    Args:
        path: a TOML file, as in this module's docstring.
        allow_code: a model may be `package.module:callable`, which runs what is there.
        allow_outside: a model's meshes and included files may lie outside of its folder.

    Returns:
        The experiments, in the file's order.

    Raises:
        InputError: the manifest or one of its files cannot be used.
    """
    path = Path(path)
    tables = read_tables(path, "experiment")
    return _named(
        [
            _experiment(path, number, table, allow_code, allow_outside)
            for number, table in enumerate(tables, 1)
        ],
        path,
    )


def read_tables(path: Path, kind: str) -> list[dict[str, Any]]:
    """The tables `[[kind]]` of a TOML file that has nothing else.

    Raises:
        InputError: it is not such a file.
    """
    check_file(path)
    try:
        with path.open("rb") as file:
            content = tomllib.load(file)
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError, RecursionError) as error:
        raise refusal(f"{path}: not a TOML file: {error}. Mend it there.") from error
    for other, command in _COMMANDS.items():
        if other != kind and other in content:
            raise refusal(
                f"{path}: it has [[{other}]] where [[{kind}]] is wanted. Such a file is for "
                f"`walkerkit {command} {path}`."
            )
    check_keys(str(path), content, (kind,))
    tables = content.get(kind)
    if not isinstance(tables, list) or not tables or not all(isinstance(t, dict) for t in tables):
        raise refusal(
            f"{path}: it has no [[{kind}]]. Start each {kind} with that line, in two pairs of "
            "brackets."
        )
    return tables


def check_code(label: str, model: str, allow_code: bool) -> None:
    """Raises InputError, which begins with the label, for code that may not be run."""
    if is_callable(model) and not allow_code:
        raise refusal(
            f"{label} has the model {model!r}, which is code to be run. Pass --allow-code "
            "(allow_code=True) if you trust it, or give an MJCF file."
        )


def listed_files(label: str, table: Mapping[str, Any], key: str) -> list[str]:
    """The names of files under a key that may be missing.

    Raises:
        InputError: it is no list of names; begins with the label.
    """
    files: list[str] = table.get(key, [])
    proper = isinstance(files, list) and all(isinstance(f, str) and f for f in files)
    if not proper or (key in table and not files):
        raise refusal(
            f"{label} has {key} = {files!r}. Write a list of file names, such as "
            f'["log.csv"]{", or leave it out" if key == "held_out" else ""}.'
        )
    return files


def load_experiments(
    model_or_manifest: str | Path,
    recordings: OneOrMore = (),
    held_out: OneOrMore = (),
    *,
    skip: Sequence[str] = (),
    column_map: str | Path | None = None,
    allow_code: bool = False,
    allow_outside: bool = False,
) -> tuple[Experiment, ...]:
    """Loads what the command line names: a model and its recordings, or a manifest alone.

    Args:
        model_or_manifest: an MJCF file, `package.module:callable`, or a manifest (.toml).
        recordings: files or recordings, or one; none with a manifest.
        held_out: which of them are held out, by name, file or recording; files and recordings that
            are not among `recordings` are added.
        skip: spans that are left out, as `walkerkit.gap.recordings.spans` reads them.
        column_map: file of a column map (`walkerkit.gap.ingest`), by which all files are read;
            without one, logs of other formats are read as their names and the model say.
        allow_outside: as for `load_manifest`.
        allow_code: as for `load_manifest`; a callable that is named here itself is always allowed.

    Returns:
        The experiments; one where a model is given.

    Raises:
        InputError: the two forms are mixed, or something named cannot be used.
    """
    source = model_name(model_or_manifest)
    path = Path(source)
    recordings, held_out = listed(recordings), listed(held_out)
    if path.suffix.lower() == ".toml":
        _check_alone(path, [*recordings, *held_out], skip, column_map)
        return load_manifest(path, allow_code=allow_code, allow_outside=allow_outside)
    _check_model(source)
    if not recordings and not held_out:
        raise refusal(f"{source}: no recording is given. Name at least one after the model.")
    skips = [Skip.of(text) for text in ([skip] if isinstance(skip, str) else skip)]
    load = _Loader(source, column_map, allow_outside, skips)
    names = [_title(item) for item in recordings]
    added = [_title(item) for item in held_out if not _among(item, names)]
    check_skips(skips, [*names, *added])
    loaded = [(recording, item) for item in recordings for recording in load(item)]
    given, known = [one for one, _ in loaded], [item for _, item in loaded]
    held = []
    for item in held_out:
        found = _find(item, given, known)
        held += [found] if found is not None else load(item)
    return _named(
        [_Draft(model=source, fitted=[r for r in given if r not in held], held_out=held)], path
    )


def _check_alone(
    path: Path,
    given: Sequence[Named],
    skip: Sequence[str],
    column_map: str | Path | None,
) -> None:
    """Raises InputError where something is given beside a manifest."""
    if skip:
        raise refusal(
            f"{path}: a manifest says itself what is skipped, but {skip[0]!r} is given beside "
            f'it. Write skip = ["{skip[0]}"] below its recordings.'
        )
    if given:
        raise refusal(
            f"{path}: a manifest lists its recordings itself, but {_title(given[0])} is given "
            "beside it. Leave one of the two out."
        )
    if column_map is not None:
        raise refusal(
            f"{path}: a manifest names its maps itself. Write map = {str(column_map)!r} below "
            "the [[experiment]] instead."
        )


class _Loader:
    """Loads recordings of one model, and logs of other formats.

    Args:
        model: path or `package.module:callable`.
        column_map: by which files are read, or None.
        allow_outside: as for `load_manifest`.
        skips: spans that are left out.
    """

    def __init__(
        self,
        model: str,
        column_map: str | Path | None,
        allow_outside: bool,
        skips: Sequence[Skip] = (),
    ):
        self._model, self._allow_outside, self._skips = model, allow_outside, skips
        self._map = None if column_map is None else ColumnMap.load(column_map)
        self._robot: Robot | None = None

    def __call__(self, item: object) -> list[Recording]:
        file = isinstance(item, str | Path)
        if not file or not (self._map is not None or is_foreign(Path(str(item)))):
            return [recording_of(item, self._skips)]
        if self._robot is None:
            self._robot = load_robot(self._model, allow_outside=self._allow_outside)
        imported = import_log(Path(str(item)), self._robot, self._map).recordings
        spans = spans_of(str(item), self._skips)
        return [one.without(*spans) if spans else one for one in imported]


@dataclass(frozen=True, kw_only=True)
class _Draft:
    """An experiment whose recordings are not named yet."""

    model: str
    fitted: list[Recording]
    held_out: list[Recording]


def _experiment(
    path: Path, number: int, table: Mapping[str, Any], allow_code: bool, allow_outside: bool
) -> _Draft:
    label = f"{path}: experiment {number}"
    check_keys(label, table, _KEYS)
    model = table.get("model")
    if not isinstance(model, str) or not model:
        raise refusal(
            f"{label} has "
            f"{'no model' if model is None else f'the model {model!r}'}. Write "
            'model = "robot.xml" or "package.module:callable".'
        )
    if not table.keys() & {"recordings", "held_out"}:
        raise refusal(f'{label} has no recordings. Write recordings = ["log.csv"].')
    files = {key: listed_files(label, table, key) for key in ("recordings", "held_out")}
    skips = [Skip.of(text) for text in listed_files(label, table, "skip")]
    check_skips(skips, itertools.chain(*files.values()))
    check_code(label, model, allow_code)
    if not is_callable(model):
        model = str(path.parent / model)
    _check_model(model)
    column_map = table.get("map")
    if column_map is not None and not (isinstance(column_map, str) and column_map):
        raise refusal(f'{label} has map = {column_map!r}. Write map = "map.toml".')
    map_file = None if column_map is None else path.parent / column_map
    load = _Loader(model, map_file, allow_outside, skips)
    fitted, held_out = (
        [recording for file in files[key] for recording in load(path.parent / file)]
        for key in ("recordings", "held_out")
    )
    return _Draft(model=model, fitted=fitted, held_out=held_out)


def _named(drafts: Sequence[_Draft], source: Path) -> tuple[Experiment, ...]:
    """Gives the recordings unique names, and checks that something is left to fit."""
    if not any(draft.fitted for draft in drafts):
        raise refusal(f"{source}: all recordings are held out. Leave at least one to fit.")
    names = _unique_names([r for draft in drafts for r in (*draft.fitted, *draft.held_out)])

    def named(recordings: list[Recording]) -> tuple[Recording, ...]:
        return tuple(r if r.name == names[r] else replace(r, name=names[r]) for r in recordings)

    return tuple(
        Experiment(
            model=draft.model,
            recordings=named(draft.fitted) + named(draft.held_out),
            held_out=frozenset(names[recording] for recording in draft.held_out),
        )
        for draft in drafts
    )


def _unique_names(recordings: Sequence[Recording]) -> dict[Recording, str]:
    """Names with as many parent folders in front as it takes to tell them apart."""
    # Parts of one file share the file and differ in name; a file listed twice shares both.
    for (file, _), count in Counter(
        (r.source.resolve(), r.name) for r in recordings if r.source is not None
    ).items():
        if count > 1:
            raise refusal(
                f"{file}: listed {count} times. List it once, to be fitted or to be held out."
            )
    names = [recording.name for recording in recordings]
    depth = 0
    while shared := {name for name, count in Counter(names).items() if count > 1}:
        depth += 1
        for index, recording in enumerate(recordings):
            if names[index] in shared:
                folders = () if recording.source is None else recording.source.resolve().parts[1:-1]
                if depth > len(folders):
                    raise refusal(
                        f"{_title(recording)}: another recording is called {recording.name!r} "
                        "too. Rename one of them."
                    )
                names[index] = "/".join((*folders[-depth:], recording.name))
    return dict(zip(recordings, names, strict=True))


def _among(item: str | Path | Recording, names: Sequence[str]) -> bool:
    """Whether a held-out item is one of some recordings, by its file or its name."""
    title = Path(_title(item))
    return any(
        title in (Path(name), Path(Path(name).stem)) or title.resolve() == Path(name).resolve()
        for name in names
    )


def _find(
    item: str | Path | Recording, recordings: Sequence[Recording], known: Sequence[object]
) -> Recording | None:
    """The one of `recordings` that a held-out item means; None where it is a file to be added.

    Args:
        item: a file, a name or a recording.
        recordings: as they are used.
        known: the same as they were given, before spans of them were left out.
    """
    if not isinstance(item, str | Path):
        return next((r for r, own in zip(recordings, known, strict=True) if own is item), None)
    file = Path(item).resolve()
    for recording in recordings:
        if recording.source is not None and recording.source.resolve() == file:
            return recording
    called = [recording for recording in recordings if recording.name == str(item)]
    if len(called) == 1:
        return called[0]
    if called or not is_recording(file):
        names = [recording.name for recording in recordings]
        raise refusal(
            f"{item}: to be held out, but {len(called) or 'none'} of the recordings are called so"
            f"{'' if called else closest(str(item), names)}. Name the file of one of them."
        )
    return None


def _title(item: str | Path | Recording) -> str:
    return str((item.source or item.name) if isinstance(item, Recording) else item)


def _check_model(model: str) -> None:
    if is_callable(model):
        return
    if is_recording(Path(model)):
        raise refusal(f"{model}: this is a recording. Name the model, and the model first.")
    check_file(Path(model))
