"""fleet.toml: what it gives, and one line for each thing that can be wrong with it."""

from __future__ import annotations

from pathlib import Path

import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.fleet.manifest import load_fleet

ONE = '[[robot]]\nname = "a"\nmodel = "leg.xml"\nrecordings = ["x.csv"]\n'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("leg.xml", "x.csv", "y.csv", "experiments.toml"):
        (tmp_path / name).write_text("something")
    return tmp_path


def load(folder: Path, text: str, *, allow_code: bool = True):
    (folder / "fleet.toml").write_text(text)
    return load_fleet(folder / "fleet.toml", allow_code=allow_code)


def test_files_are_relative_to_the_manifest(folder: Path) -> None:
    one, other, made = load(
        folder,
        ONE
        + 'held_out = ["y.csv"]\n[[robot]]\nname = "b"\nexperiments = "experiments.toml"\n'
        + '[[robot]]\nname = "c d"\nmodel = "robots:leg"\nrecordings = ["x.csv"]',
    )
    assert (one.name, one.model) == ("a", str(folder / "leg.xml"))
    assert (one.recordings, one.held_out) == ((str(folder / "x.csv"),), (str(folder / "y.csv"),))
    assert (other.name, other.model) == ("b", str(folder / "experiments.toml"))
    assert other.recordings == ()
    assert (made.name, made.model) == ("c d", "robots:leg")


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ("the file is empty",)),
        ("[[robot]", ("not a TOML file", "line 1")),
        ("[robot]", ("no [[robot]]", "two pairs of brackets")),
        ("[[experiment]]", ("[[experiment]] where [[robot]]", "`walkerkit diagnose /")),
        ("[[robots]]", ("unknown key 'robots'", "did you mean 'robot'?")),
        (ONE.replace('name = "a"\n', ""), ("robot 1 has no name", 'name = "unit-1"')),
        (ONE.replace('"a"', "3"), ("robot 1 has name = 3",)),
        (ONE.replace('"a"', '"../a"'), ("'../a'", "cannot be the name of its folder")),
        (ONE.replace('"a"', '".a"'), ("'.a'", "not beginning with a dot")),
        (ONE.replace('"a"', f'"{"a" * 201}"'), ("Choose a short one",)),
        (ONE.replace('"a"', '"fleet.json"'), ("'fleet.json'", "Choose another")),
        (ONE + ONE, ("robot 'a' is listed twice",)),
        (ONE + "log = 1", ("robot 'a'", "unknown key 'log'")),
        (ONE + 'experiments = "experiments.toml"', ("'a' has experiments and model too",)),
        (ONE.replace('model = "leg.xml"\n', ""), ("robot 'a' has no model",)),
        (ONE.replace('"leg.xml"', '"log.xml"'), ("'a': model:", "log.xml", "mean 'leg.xml'")),
        (ONE.replace('"leg.xml"', '"experiments.toml"'), ("'a'", "Write experiments = ")),
        (ONE.replace('recordings = ["x.csv"]', ""), ("'a' has no recordings",)),
        (ONE.replace('["x.csv"]', '"x.csv"'), ("'a' has recordings = 'x.csv'", "Write a list")),
        (ONE.replace("x.csv", "z.csv"), ("'a': recordings:", "z.csv: no such file", "Check")),
        (ONE + 'held_out = ["z.csv"]', ("'a': held_out:", "z.csv: no such file")),
        ('[[robot]]\nname = "a"\nexperiments = "x.csv"', ("'a'", "is no .toml")),
        ('[[robot]]\nname = "a"\nexperiments = 1', ("'a' has experiments = 1",)),
    ],
)
def test_what_is_wrong_is_named_in_one_line(
    folder: Path, text: str, parts: tuple[str, ...]
) -> None:
    with pytest.raises(InputError) as refused:
        load(folder, text)
    message = str(refused.value)
    assert message.startswith(str(folder / "fleet.toml"))
    assert len(message.splitlines()) == 1
    for part in parts:
        assert part in message


def test_code_is_run_only_where_that_is_allowed(folder: Path) -> None:
    code = ONE.replace('"leg.xml"', '"robots:leg"')
    assert load(folder, code)[0].model == "robots:leg"
    with pytest.raises(InputError, match=r"'a' has the model 'robots:leg'.* --allow-code"):
        load(folder, code, allow_code=False)
