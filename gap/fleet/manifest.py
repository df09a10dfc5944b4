"""Which robots make up a fleet: `fleet.toml`.

members = load_fleet("fleet.toml")

    [[robot]]
    name = "unit-7"                         # the name of its folder in the output
    model = "leg.xml"                       # or "package.module:callable"
    recordings = ["unit-7/chirp.csv", "unit-7/steps.csv"]
    held_out = ["unit-7/walk.csv"]          # optional, and none of the files above

    [[robot]]
    name = "unit-8"
    experiments = "unit-8/experiments.toml" # instead of the three

Files are relative to the folder of fleet.toml.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn

from walkerkit.gap.errors import InputError, refusal
from walkerkit.gap.experiments.experiment import check_code, listed_files, read_tables
from walkerkit.gap.recordings.files import check_file
from walkerkit.gap.recordings.given import check_keys, is_callable

FLEET_FILES = ("fleet.json", "fleet.html")
_ONE_MODEL = ("model", "recordings", "held_out")
_KEYS = ("name", *_ONE_MODEL, "experiments")
_LONGEST = 200  # bytes of a folder's name; file systems take 255


@dataclass(frozen=True, kw_only=True)
class Member:
    """One robot, as `diagnose` takes it.

    Attributes:
        name: unique in the fleet, and the name of its folder.
        model: path of an MJCF file or of an experiments.toml, or `package.module:callable`.
        recordings, held_out: paths; none with an experiments.toml.
    """

    name: str
    model: str
    recordings: tuple[str, ...] = ()
    held_out: tuple[str, ...] = ()


def load_fleet(path: str | Path, *, allow_code: bool = False) -> tuple[Member, ...]:
    """Reads which robots there are, and checks that their files exist.

    Args:
        path: a TOML file, as in this module's docstring.
        allow_code: it may name `package.module:callable` as a model.

    Returns:
        The robots in the file's order, with absolute paths.

    Raises:
        InputError: the file cannot be used; names the robot and the field.
    """
    path = Path(path)
    members: dict[str, Member] = {}
    for number, table in enumerate(read_tables(path, "robot"), start=1):
        name = _name(f"{path}: robot {number}", table)
        label = f"{path}: robot {name!r}"
        if name in members:
            raise refusal(f"{label} is listed twice. Give each robot a name of its own.")
        members[name] = _member(path.absolute().parent, label, name, table, allow_code)
    return tuple(members.values())


def _name(label: str, table: Mapping[str, Any]) -> str:
    name = table.get("name")
    if not isinstance(name, str) or not name:
        raise refusal(
            f"{label} has {'no name' if name is None else f'name = {name!r}'}. "
            'Write name = "unit-1".'
        )
    bad = [char for char in name if char in "/\\" or not char.isprintable()]
    if bad or name.startswith(".") or name != name.strip() or len(name.encode()) > _LONGEST:
        raise refusal(
            f"{label} has name = {name!r}, which cannot be the name of its folder. "
            "Choose a short one without slashes, not beginning with a dot."
        )
    if name in FLEET_FILES:
        raise refusal(
            f"{label} has name = {name!r}, which the fleet's own file has. Choose another."
        )
    return name


def _member(
    folder: Path, label: str, name: str, table: Mapping[str, Any], allow_code: bool
) -> Member:
    check_keys(label, table, _KEYS)
    given = [key for key in _ONE_MODEL if key in table]
    if "experiments" in table:
        if given:
            raise refusal(f"{label} has experiments and {given[0]} too. Leave one of the two out.")
        experiments = _text(label, table, "experiments", "experiments.toml")
        if Path(experiments).suffix.lower() != ".toml":
            raise refusal(f"{label}: experiments = {experiments!r} is no .toml. Name a manifest.")
        return Member(name=name, model=_file(folder, label, "experiments", experiments))
    if "model" not in table:
        raise refusal(
            f'{label} has no model. Write model = "robot.xml" and recordings = ["log.csv"], or '
            'experiments = "experiments.toml".'
        )
    model = _text(label, table, "model", "robot.xml")
    if Path(model).suffix.lower() == ".toml":
        raise refusal(f"{label}: model = {model!r} is a manifest. Write experiments = {model!r}.")
    check_code(label, model, allow_code)
    if not is_callable(model):
        model = _file(folder, label, "model", model)
    files = {
        key: tuple(_file(folder, label, key, file) for file in listed_files(label, table, key))
        for key in ("recordings", "held_out")
    }
    if not files["recordings"]:
        raise refusal(f'{label} has no recordings. Write recordings = ["log.csv"].')
    return Member(name=name, model=model, **files)


def _text(label: str, table: Mapping[str, Any], key: str, example: str) -> str:
    value = table[key]
    if not isinstance(value, str) or not value:
        raise refusal(f'{label} has {key} = {value!r}. Write {key} = "{example}".')
    return value


def _file(folder: Path, label: str, key: str, file: str) -> str:
    path = folder / file
    try:
        check_file(path)
    except InputError as error:
        _within(label, key, error)
    return str(path)


def _within(label: str, key: str, error: InputError) -> NoReturn:
    raise refusal(f"{label}: {key}: {error}") from error
