"""Few numbers decide, and they are in one file with their meaning."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

from walkerkit.gap.search import book, compare, decision, lookalikes, reduce, score, unknown

MOST = 10
# What is drawn, iterated and looked at, of which more can only make the same answer more exact.
NUMERICS = {
    "_DRAWS",
    "_LEAST_TOLD",
    "_LONGEST",
    "_MOST_BY_THEMSELVES",
    "_MOST_IN_THE_RUNNING",
    "_ORDER",
    "_OUT_OF_REACH",
    "_SEED",
    "_SINGULAR",
    "_SIZES",
    "_STEPS",
    "_SWEEPS",
}


def constants(module: object) -> set[str]:
    """Names in capitals that a module gives a value."""
    tree = ast.parse(Path(str(module.__file__)).read_text(encoding="utf-8"))  # type: ignore[attr-defined]
    found = set()
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else ()
        if isinstance(node, ast.AnnAssign):
            targets = (node.target,)
        for target in targets:
            names = target.elts if isinstance(target, ast.Tuple) else [target]
            found |= {one.id for one in names if isinstance(one, ast.Name) and one.id.isupper()}
    return found


def test_few_numbers_decide() -> None:
    assert 0 < len(constants(decision)) <= MOST


def test_each_says_what_it_means_and_is_on_the_page() -> None:
    page = Path(__file__).parents[3].joinpath("docs/decision.md").read_text(encoding="utf-8")
    body = ast.parse(Path(str(decision.__file__)).read_text(encoding="utf-8")).body
    for name in constants(decision):
        assert name in page, name
    numbers = [node for node in body if isinstance(node, ast.AnnAssign)]
    for number in numbers:
        after = body[body.index(number) + 1]
        assert isinstance(after, ast.Expr)
        assert isinstance(after.value, ast.Constant)


@pytest.mark.parametrize("module", [book, compare, lookalikes, reduce, score, unknown])
def test_no_other_number_decides(module: object) -> None:
    assert constants(module) <= NUMERICS
