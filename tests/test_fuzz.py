"""Three hundred inputs of unlucky, careless and hostile users; `benchmarks/fuzz.py` has more."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.fuzz import CASES, broken_cases
from benchmarks.fuzzing.case import Case, outcome

COUNTS = {
    "recordings": 97,
    "manifests": 40,
    "weights": 30,
    "mjcf": 70,
    "actuators_json": 30,
    "command_lines": 20,
    "compared_logs": 10,
    "diagnosed_logs": 3,
}


@pytest.mark.parametrize("kind", CASES)
def test_every_case_ends_with_a_result_or_one_line_that_helps(tmp_path: Path, kind: str) -> None:
    broken = broken_cases(kind, COUNTS[kind], 1234, tmp_path)
    assert [wrong for _, wrong in broken] == []


def test_all_that_is_promised_is_tried() -> None:
    assert sum(COUNTS.values()) == 300
    assert sum(count for _, count in CASES.values()) == 10_000


def test_a_case_that_ends_otherwise_is_seen(tmp_path: Path) -> None:
    def fail(error: Exception) -> Case:
        def act(folder: Path) -> None:
            raise error

        return Case(files={"a.csv": b"1"}, act=act, refusals=(ValueError,), place="a.csv")

    for error, part in (
        (KeyError("knee"), "KeyError"),
        (ValueError("a.csv: wrong\nvery wrong. Mend it."), "more than one line"),
        (ValueError("the file: it is wrong. Mend it."), "does not name a.csv"),
        (ValueError("a.csv is wrong"), "does not say what to do"),
    ):
        assert part in str(outcome(fail(error), tmp_path))
    assert outcome(fail(ValueError("a.csv: it is empty. Write it again.")), tmp_path) is None
