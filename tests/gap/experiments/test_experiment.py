"""Manifests and the command line's two forms: what they load, and what they refuse."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.gap.refused import refused
from walkerkit.gap.experiments.experiment import Experiment, load_experiments, load_manifest
from walkerkit.gap.recordings.recording import Recording

DATA = Path(os.environ.get("WALKERKIT_DATA", Path(__file__).parents[4] / "shared" / "data"))


def recording(name: str) -> Recording:
    return Recording(
        name=name,
        time=np.linspace(0.0, 0.04, 5),
        columns={"knee/position": np.zeros(5), "knee/position_target": np.ones(5)},
    )


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """Two models, recordings a, b and c, and an a of another day."""
    for name in ("kp1.xml", "kp2.xml"):
        (tmp_path / name).write_text("<mujoco/>")
    for file in ("a.csv", "b.npz", "c.parquet", "monday/a.csv", "tuesday/a.csv"):
        path = tmp_path / "logs" / file
        path.parent.mkdir(parents=True, exist_ok=True)
        recording(path.stem).save(path)
    return tmp_path


def manifest(folder: Path, text: str) -> Path:
    path = folder / "experiments.toml"
    path.write_text(text)
    return path


def experiment(**values: Any) -> str:
    """An [[experiment]]; a string is written as it is."""
    good = {"model": '"kp1.xml"', "recordings": '["logs/a.csv"]'} | values
    return "[[experiment]]\n" + "".join(f"{k} = {v}\n" for k, v in good.items() if v)


def names(experiment: Experiment) -> list[str]:
    return [recording.name for recording in experiment.recordings]


# Manifests


def test_manifest_loads_in_order_with_paths_of_its_own_folder(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = manifest(
        folder,
        experiment(recordings='["logs/b.npz", "logs/a.csv"]', held_out='["logs/c.parquet"]')
        + experiment(model='"my.robots:leg"', recordings=f'["{folder}/logs/monday/a.csv"]'),
    )
    monkeypatch.chdir("/")
    first, second = load_manifest(path, allow_code=True)
    assert Path(first.model) == folder / "kp1.xml"
    assert names(first) == ["b", "logs/a", "c"]
    assert first.held_out == {"c"}
    assert second.model == "my.robots:leg"
    assert names(second) == ["monday/a"]
    assert second.held_out == frozenset()
    assert second.recordings[0].source == folder / "logs/monday/a.csv"
    assert load_experiments(path, allow_code=True)[1].model == second.model


def test_a_whole_experiment_may_be_held_out(folder: Path) -> None:
    text = experiment() + experiment(
        model='"kp2.xml"', recordings=None, held_out='["logs/b.npz", "logs/c.parquet"]'
    )
    _, held = load_manifest(manifest(folder, text))
    assert held.held_out == {"b", "c"}


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("", ("the file is empty",)),
        ("# nothing\n", ("no [[experiment]]", "two pairs of brackets")),
        ("experiment = []\n", ("no [[experiment]]",)),
        ("experiment = [1]\n", ("no [[experiment]]",)),
        (experiment().replace("[[experiment]]", "[experiment]"), ("no [[experiment]]",)),
        ("[[experiment]]\nmodel = \n", ("not a TOML file", "line 2")),
        (
            experiment().replace("experiment", "robot"),
            ("[[robot]] where [[experiment]]", "`walkerkit diagnose-fleet /"),
        ),
        (experiment().replace("experiment", "experiments"), ("'experiments'", "'experiment'")),
        (
            experiment() + experiment(heldout="[]"),
            ("experiment 2", "'heldout'", "did you mean 'held_out'", "model, recordings, held_out"),
        ),
        (experiment(model=None), ("experiment 1 has no model", 'model = "robot.xml"')),
        (experiment(model="3"), ("experiment 1 has the model 3", "package.module:callable")),
        (experiment(model='"os:abort"'), ("'os:abort'", "code to be run", "--allow-code")),
        (experiment(model='""'), ("experiment 1 has the model ''",)),
        (experiment(recordings=None), ("experiment 1 has no recordings", 'recordings = ["log')),
        (experiment(recordings='"a.csv"'), ("recordings = 'a.csv'", "list of file names")),
        (experiment(recordings="[]"), ("recordings = []", "list of file names")),
        (experiment(recordings='["a.csv", 1]'), ("recordings = ['a.csv', 1]",)),
        (experiment(held_out="[]"), ("held_out = []", "or leave it out")),
        (experiment(held_out="true"), ("held_out = True", "or leave it out")),
        (
            experiment(recordings=None, held_out='["logs/a.csv"]'),
            ("all recordings are held out", "Leave at least one to fit"),
        ),
    ],
)
def test_bad_manifests_are_refused(folder: Path, text: str, parts: tuple[str, ...]) -> None:
    path = manifest(folder, text)
    refused(lambda: load_manifest(path), str(path), *parts)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        (experiment(model='"kp3.xml"'), ("kp3.xml: no such file", "'kp1.xml'")),
        (experiment(model='"logs/a.csv"'), ("logs/a.csv: this is a recording", "Name the model")),
        (experiment(recordings='["logs/aa.csv"]'), ("logs/aa.csv: no such file", "'a.csv'")),
        (experiment(held_out='["logs/a.csv"]'), ("logs/a.csv: listed 2 times", "List it once")),
        (experiment(held_out='["logs/../logs/a.csv"]'), ("logs/a.csv: listed 2 times",)),
        (experiment() + experiment(model='"kp2.xml"'), ("logs/a.csv: listed 2 times",)),
        (experiment(recordings='["kp1.xml"]'), ("kp1.xml", "'.xml'", ".csv, .parquet, .npz")),
    ],
)
def test_bad_files_of_a_manifest_are_refused(
    folder: Path, text: str, parts: tuple[str, ...]
) -> None:
    refused(lambda: load_manifest(manifest(folder, text)), str(folder), *parts)


def test_manifests_that_are_no_text_or_not_there_are_refused(folder: Path) -> None:
    path = manifest(folder, experiment())
    refused(lambda: load_manifest(folder / "experiment.toml"), "no such file", "'experiments.toml'")
    refused(lambda: load_experiments(folder / "experiment.toml"), "no such file")
    refused(lambda: load_manifest(folder), str(folder), "folder")
    path.write_bytes(b"\xff\xfe[[")
    refused(lambda: load_manifest(path), str(path), "not a TOML file")


# A model and its recordings


def test_files_and_recordings_may_be_mixed(folder: Path) -> None:
    mine = recording("mine")
    (found,) = load_experiments(
        folder / "kp1.xml", [mine, folder / "logs/a.csv", str(folder / "logs/b.npz")]
    )
    assert found.model == str(folder / "kp1.xml")
    assert names(found) == ["mine", "a", "b"]
    assert found.recordings[0] is mine
    assert found.held_out == frozenset()


@pytest.mark.parametrize("by", ["name", "file", "other spelling", "recording"])
def test_held_out_says_which_recording(folder: Path, by: str) -> None:
    held = recording("c")
    files: list[Any] = [folder / "logs/a.csv", folder / "logs/b.npz", held]
    meant: dict[str, tuple[Any, str]] = {
        "name": ("b", "b"),
        "file": (folder / "logs/b.npz", "b"),
        "other spelling": (str(folder / "logs/../logs/b.npz"), "b"),
        "recording": (held, "c"),
    }
    item, name = meant[by]
    (found,) = load_experiments("my.robots:leg", files, [item])
    assert found.held_out == {name}
    assert sorted(names(found)) == ["a", "b", "c"]
    assert names(found)[-1] == name


def test_held_out_files_and_recordings_are_added(folder: Path) -> None:
    (found,) = load_experiments(
        "robots:leg", [folder / "logs/a.csv"], [folder / "logs/b.npz", recording("mine")]
    )
    assert names(found) == ["a", "b", "mine"]
    assert found.held_out == {"b", "mine"}


def test_shared_stems_get_as_many_folders_as_they_need(folder: Path) -> None:
    days = [folder / "logs" / day / "a.csv" for day in ("monday", "tuesday")]
    (found,) = load_experiments("robots:leg", [*days, folder / "logs/b.npz"], [days[0]])
    assert names(found) == ["tuesday/a", "b", "monday/a"]
    assert found.held_out == {"monday/a"}
    deep = [folder / site / "monday" / "a.csv" for site in ("lab", "field")]
    for path in deep:
        path.parent.mkdir(parents=True)
        recording("a").save(path)
    (found,) = load_experiments("robots:leg", deep)
    assert names(found) == ["lab/monday/a", "field/monday/a"]


def test_parts_of_one_file_are_told_apart(folder: Path) -> None:
    whole = Recording.load(folder / "logs/a.csv")
    parts = [whole.between(0.0, 0.02), whole.between(0.02, 0.05)]
    (found,) = load_experiments("robots:leg", parts, parts[1:])
    assert names(found) == ["a[0:0.02]", "a[0.02:0.05]"]
    assert found.held_out == {"a[0.02:0.05]"}


def test_names_that_cannot_be_made_unique_are_refused(folder: Path) -> None:
    refused(
        lambda: load_experiments("robots:leg", [recording("a"), recording("a")]),
        "a: another recording is called 'a' too",
        "Rename",
    )
    recording("a").save(folder / "logs/a.npz")
    files = [folder / "logs/a.csv", folder / "logs/a.npz"]
    refused(lambda: load_experiments("robots:leg", files), "logs/a.csv", "'a' too", "Rename")


def test_ambiguous_and_unknown_held_out_names_are_refused(folder: Path) -> None:
    days = [folder / "logs" / day / "a.csv" for day in ("monday", "tuesday")]
    refused(lambda: load_experiments("robots:leg", days, ["a"]), "a: to be held out", "2 of the")
    refused(
        lambda: load_experiments("robots:leg", [recording("walk")], ["wlak"]),
        "wlak: to be held out",
        "did you mean 'walk'",
        "Name the file",
    )
    refused(lambda: load_experiments("robots:leg", [recording("walk")], ["x.csv"]), "no such file")


def test_everything_held_out_is_refused(folder: Path) -> None:
    mine = recording("mine")
    refused(lambda: load_experiments("robots:leg", [mine], ["mine"]), "robots:leg", "held out")
    refused(lambda: load_experiments("robots:leg", [], [mine]), "all recordings are held out")


def test_mixed_up_arguments_are_refused(folder: Path) -> None:
    path = manifest(folder, experiment())
    log = folder / "logs/b.npz"
    refused(lambda: load_experiments(path, [log]), str(path), str(log), "Leave one")
    refused(lambda: load_experiments(path, held_out=[recording("x")]), str(path), "x is given")
    refused(lambda: load_experiments(folder / "kp1.xml"), "kp1.xml", "no recording is given")
    refused(lambda: load_experiments(log, [folder / "kp1.xml"]), str(log), "the model first")
    refused(lambda: load_experiments(folder / "kp3.xml", [log]), "no such file", "'kp1.xml'")
    refused(lambda: load_experiments(folder, [log]), str(folder), "folder")


# Experiment


def test_experiment_checks_its_names() -> None:
    walk, run = recording("walk"), recording("run")
    refused(lambda: Experiment(model="m.xml", recordings=()), "m.xml", "no recordings")
    twice = (walk, replace(run, name="walk"))
    refused(lambda: Experiment(model="m.xml", recordings=twice), "2 recordings", "'walk'", "Rename")
    refused(
        lambda: Experiment(model="m.xml", recordings=(walk, run), held_out=frozenset({"rum"})),
        "'rum'",
        "did you mean 'run'",
        "'walk', 'run'",
    )


# Logs of real hardware


@pytest.mark.skipif(not DATA.is_dir(), reason="the logs of real hardware are not here")
def test_real_logs_in_a_manifest(tmp_path: Path) -> None:
    servo = DATA.resolve() / "xl330"
    text = "".join(
        experiment(
            model=f'"{servo}/kp{gain}.xml"',
            recordings=f'["{servo}/kp{gain}_up_and_down.csv"]',
            held_out=f'["{servo}/kp{gain}_sin_sin.csv"]',
        )
        for gain in (100, 200, 400, 800)
    )
    found = load_manifest(manifest(tmp_path, text))
    assert [Path(each.model).name for each in found] == [
        f"kp{gain}.xml" for gain in (100, 200, 400, 800)
    ]
    assert found[2].held_out == {"kp400_sin_sin"}
    assert all(each.recordings[0].unused == ("servo/duty",) for each in found)
