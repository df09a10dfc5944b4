"""diagnosis.json, key by key: what docs/report.md says of it is all that there is."""

from __future__ import annotations

import ast
import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from walkerkit.gap.recordings.wiring_errors import WiringError
from walkerkit.gap.report import diagnosis as module
from walkerkit.gap.report.diagnosis import Change, Diagnosis, Hint, Rival
from walkerkit.gap.report.gaps import GapSize
from walkerkit.gap.report.regimes import EVERYWHERE, REGIMES

ROW = re.compile(r"^\| `([^`]+)` \| ([^|]+) \| ([^|]+) \| (.+) \|$", re.MULTILINE)
# Objects whose keys are names, and what stands for one of them.
NAMED = {"gap.joints": "<joint>", "gap.signals": "<signal>", "effects[].reasons": "<effect>"}
TYPES = {
    "boolean": bool,
    "integer": int,
    "number": float,
    "string": str,
    "null": type(None),
    "object": dict,
    "list": list,
    "list of strings": list,
}


@pytest.fixture
def everything(confused: Diagnosis) -> Diagnosis:
    """A diagnosis that has all that one can have."""
    assert confused.next_experiment is not None
    friction, delay, payload = confused.effects
    of_models = tuple(
        Change(model=model, place="calf", was=was, now=was + 0.01)
        for model, was in (("kp100", 0.0), ("kp200", 0.004))
    )
    first = replace(delay.parameters[0], field="actuator/delay", changes=of_models)
    delay = replace(delay, parameters=(first, *delay.parameters[1:]))
    n = len(friction.parameters) + len(delay.parameters) + len(payload.parameters)
    friction, delay, payload = (
        replace(
            one,
            parameters=tuple(replace(of, correlation=(0.5,) * n) for of in one.parameters),
        )
        for one in (friction, delay, payload)
    )
    known = replace(delay, equivalent=(("sensor_delay", "They shift the same curves."),))
    swapped = WiringError(
        kind="joint_swap",
        joints=("hip", "calf"),
        columns=("hip/position", "calf/position"),
        gap_before=0.3,
        gap_after=0.02,
        unit="rad",
        recordings=("walk",),
        or_else=("hip/position_target", "calf/position_target"),
    )
    hint = Hint(
        kind="learned",
        joint="calf",
        title="A learned drive at calf",
        statement="a network",
        signal="position",
        size=GapSize(unit="rad", before=0.0022, after=0.0012, noise_floor=0.001),
        file="stopgap_calf.npz",
    )
    changed = replace(
        confused.next_experiment,
        set_up="known_payload",
        instruction="Put 0.5 kg on body shin.",
        model="next_experiment.xml",
    )
    return replace(
        confused,
        effects=(friction, known, payload),
        wiring=(swapped,),
        rivals=(Rival(effect="payload", in_place_of="command_delay", effects=(payload,)),),
        hints=(hint,),
        next_experiment=changed,
        recordings=("walk", "steps"),
        held_out=("steps",),
        only=("coulomb_friction", "command_delay", "payload"),
    )


@pytest.fixture
def table(repository: Path) -> dict[str, tuple[str, str, str]]:
    """Key to type, unit and meaning."""
    text = (repository / "docs/report.md").read_text(encoding="utf-8")
    rows = ROW.findall(text.partition("## diagnosis.json")[2])
    assert len({key for key, *_ in rows}) == len(rows)
    return {key: (kind, unit, meaning) for key, kind, unit, meaning in rows}


def written(found: Diagnosis) -> dict[str, Any]:
    return json.loads(found.to_json())  # type: ignore[no-any-return]


def keys(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Every key with its values, as the table writes it but for the asterisks."""
    if isinstance(value, dict):
        for name, item in value.items():
            own = f"{path}.{NAMED.get(path, name)}".lstrip(".")
            if path not in ("gap.joints", "gap.signals"):
                yield own, item
            yield from keys(item, own)
    elif path == "rivals[].effects":
        return  # as `effects`, which has them all
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        for item in value:
            yield from keys(item, f"{path}[]")


def test_the_table_has_every_key_and_no_other(
    everything: Diagnosis, table: dict[str, tuple[str, str, str]]
) -> None:
    assert {key for key, _ in keys(written(everything))} == {key.replace("*", "") for key in table}


def test_there_is_no_key_that_this_diagnosis_lacks(everything: Diagnosis) -> None:
    """What else the module could write would be missing from the table unseen."""
    tree = ast.parse(Path(module.__file__).read_text(encoding="utf-8"))
    literals = {
        key.value
        for node in ast.walk(tree)
        if isinstance(node, ast.Dict)
        for key in node.keys
        if isinstance(key, ast.Constant)
    }
    # `joint` or `body`, whichever it is.
    made = {key.rpartition(".")[2] for key, _ in keys(written(everything))} - {"<effect>"}
    assert made - {"body"} == literals | {"joint"}


def test_what_may_be_absent_has_an_asterisk(
    everything: Diagnosis, leg: Any, table: dict[str, tuple[str, str, str]]
) -> None:
    plain = replace(
        leg(), next_experiment=replace(everything.next_experiment, instruction="", model=None)
    )
    always = {key for key, _ in keys(written(plain))} - {"effects[].parameters[].joint"}
    assert always == {key for key in table if "*" not in key}


def test_the_types_are_those_of_the_table(
    everything: Diagnosis, table: dict[str, tuple[str, str, str]]
) -> None:
    said = {key.replace("*", ""): kinds for key, (kinds, *_) in table.items()}
    for key, value in keys(written(everything)):
        kinds = tuple(TYPES[kind] for kind in said[key].split(" or "))
        assert isinstance(value, kinds), key
        assert type(value) in kinds, key
        if said[key] == "list of strings":
            assert all(isinstance(item, str) for item in value), key


def test_every_number_has_a_unit_and_every_key_a_meaning(
    table: dict[str, tuple[str, str, str]],
) -> None:
    for key, (kinds, unit, meaning) in table.items():
        assert (unit != "–") == kinds.startswith("number"), key
        assert meaning.strip(), key


def test_the_words_are_those_that_are_written(table: dict[str, tuple[str, str, str]]) -> None:
    assert re.findall(r"`(\w+)`", table["locations[].regime"][2]) == [*REGIMES, EVERYWHERE]
