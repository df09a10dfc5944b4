"""What is kept of residuals: only so much of it, and by whom and at what values it was found."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from walkerkit.gap.search import recent
from walkerkit.gap.search.recent import Recent
from walkerkit.gap.search.structure import Case, Structure

ROWS = 5


def case(name: str, values: list[float], **start_errors: np.ndarray) -> Case:
    structure = cast(Structure, SimpleNamespace(key=((name, ("hip",), False),)))
    return Case(structure=structure, values=np.array(values)[:, None], start_errors=start_errors)


def simulated(owner: str, cases: list[Case]) -> np.ndarray:
    """Something that depends on everything that a residual does."""
    size = {"fit": 1.0, "held": 2.0, "armature": 3.0, "damping": 5.0}
    rows = [
        size[owner] * size[one.structure.key[0][0]] * (float(row[0]) + np.arange(ROWS))
        for one in cases
        for row in one.values
    ]
    return np.array(rows)


NAMES = st.sampled_from(["armature", "damping"])
CASES = st.tuples(NAMES, st.lists(st.sampled_from([0.0, 0.5, 1.0, 2.0]), min_size=1, max_size=4))
ASKED = st.tuples(st.sampled_from(["fit", "held"]), st.lists(CASES, min_size=1, max_size=3))


@given(st.lists(ASKED, max_size=6), st.integers(0, 12))
def test_answers_are_those_of_simulating_everything(asked: list[Any], room: int) -> None:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(recent, "_MOST", 8 * ROWS * room)
        kept = Recent()
        for owner, parts in asked:
            cases = [case(*part) for part in parts]
            wanted = kept.wanted(owner, cases)
            found = wanted.filled(simulated(owner, wanted.unknown) if wanted.unknown else None)
            np.testing.assert_array_equal(found, simulated(owner, cases))


class TestRecent:
    @pytest.fixture(autouse=True)
    def _room_for_three(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(recent, "_MOST", 8 * ROWS * 3)

    def left(self, kept: Recent, *values: float) -> list[float]:
        """Which of some values are asked for, which they are."""
        wanted = kept.wanted("fit", [case("armature", list(values))])
        unknown = wanted.unknown
        wanted.filled(simulated("fit", unknown) if unknown else None)
        return [float(row[0]) for one in unknown for row in one.values]

    def test_asks_once(self) -> None:
        kept = Recent()
        assert self.left(kept, 1.0, 2.0) == [1.0, 2.0]
        assert self.left(kept, 2.0, 3.0, 1.0) == [3.0]
        assert self.left(kept, 1.0, 2.0, 3.0) == []

    def test_gives_up_what_was_asked_for_longest_ago(self) -> None:
        kept = Recent()
        self.left(kept, 1.0, 2.0, 3.0)
        self.left(kept, 1.0)
        self.left(kept, 4.0)
        assert self.left(kept, 1.0, 3.0, 4.0) == []
        assert self.left(kept, 2.0) == [2.0]

    def test_keeps_what_it_was_given_whatever_becomes_of_that(self) -> None:
        kept, cases = Recent(), [case("armature", [1.0])]
        kept.wanted("fit", cases).filled(found := simulated("fit", cases))
        found[...] = 0.0
        again = kept.wanted("fit", cases).filled(None)
        np.testing.assert_array_equal(again, simulated("fit", cases))
        again[...] = 0.0
        np.testing.assert_array_equal(
            kept.wanted("fit", cases).filled(None), simulated("fit", cases)
        )

    def test_asks_for_starts_with_errors_each_time(self) -> None:
        kept, cases = Recent(), [case("armature", [1.0], hip=np.ones((1, 2)))]
        for _ in range(2):
            wanted = kept.wanted("fit", cases)
            assert wanted.unknown == cases
            wanted.filled(simulated("fit", cases))
        assert self.left(kept, 1.0) == [1.0]
