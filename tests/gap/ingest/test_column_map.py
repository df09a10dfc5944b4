from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from walkerkit.gap import InputError
from walkerkit.gap.ingest.column_map import (
    OF_RANGE,
    TIME_UNITS,
    UNITS,
    ColumnMap,
    JointMap,
    SignalMap,
    TimeMap,
)
from walkerkit.gap.recordings.recording import SIGNALS

names = st.text(st.characters(codec="utf-8", exclude_categories=("Cc", "Cs")), min_size=1)
numbers = st.floats(-1e6, 1e6)
joints = st.builds(
    JointMap,
    log=names,
    sign=st.sampled_from([1, -1]),
    offset=numbers,
    unit=st.none() | st.sampled_from(OF_RANGE),
    range=st.none() | st.tuples(numbers, numbers),
)
times = st.builds(TimeMap, clock=names, unit=st.sampled_from([*TIME_UNITS])) | st.builds(
    TimeMap, clock=names, rate=st.floats(1e-3, 1e6)
)


def signals(kind: str) -> st.SearchStrategy[SignalMap]:
    units = st.sampled_from([*UNITS[kind.removesuffix("_target")]])
    return st.builds(
        SignalMap,
        pattern=names,
        unit=units | st.floats(1e-6, 1e6),
        order=st.none() | st.lists(names, min_size=1, unique=True).map(tuple),
        clock=st.none() | names,
    )


@settings(max_examples=8)
@given(
    st.builds(
        ColumnMap,
        time=times,
        signals=st.fixed_dictionaries({}, optional={kind: signals(kind) for kind in SIGNALS}),
        joints=st.dictionaries(names, joints),
        columns=st.dictionaries(names, names, min_size=1),
        episodes=st.none() | st.lists(st.integers(0, 99)).map(tuple),
    )
)
def test_a_map_that_is_written_is_read_again(
    tmp_path_factory: pytest.TempPathFactory, column_map: ColumnMap
) -> None:
    path = tmp_path_factory.mktemp("map") / "map.toml"
    path.write_text(column_map.to_toml(), encoding="utf-8")
    again = ColumnMap.load(path)
    assert again.to_toml() == column_map.to_toml()
    assert (again.time, again.joints) == (column_map.time, column_map.joints)
    assert dict(again.signals) == dict(column_map.signals)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[time]\nunit = 'sec'", ("'sec'", "s, ms, us, ns")),
        ("[time]\nrate = 0", ("rate is 0 Hz", "above 0")),
        ("[time]\nrate = 'fast'", ("rate = 'fast'", "a number")),
        ("[times]", ("'times'", "did you mean 'time'")),
        ("[signals.positon]", ("signals.positon", "did you mean 'position")),
        ("[signals.position]\nunit = 'degrees'", ("'degrees'", "did you mean 'deg'", "m100")),
        ("[signals.effort]\nunit = 'm100'", ("'m100'", "N·m")),
        ("[signals.position]\nform = 'x'", ("'form'", "did you mean 'from'")),
        ("[signals.position]\norder = ['a', 'a']", ("order", "each once")),
        ("[joints]\nhip = {log = 'x', sign = 2}", ("hip", "sign = 2", "1 or -1")),
        ("[joints]\nhip = {log = 'x', range = [1]}", ("range = [1]", "its two ends")),
        ("[joints]\nhip = 3", ("joints.hip = 3", "no table")),
        ("episodes = 'all'", ("'all'", "[0, 2]")),
        ("[columns]\n'base/position_x' = 1", ("base/position_x = 1", "text in quotes")),
        ("[time", ("not a TOML file",)),
    ],
)
def test_what_no_map_says_is_refused(tmp_path: Path, text: str, words: tuple[str, ...]) -> None:
    path = tmp_path / "map.toml"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError) as refused:
        ColumnMap.load(path)
    for word in (str(path), *words):
        assert word in str(refused.value)
    assert len(str(refused.value).splitlines()) == 1
