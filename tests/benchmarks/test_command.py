"""`python -m benchmarks` can run all that it lists."""

from __future__ import annotations

import ast
from pathlib import Path

import benchmarks


def test_what_stands_beside_the_benchmarks_is_one() -> None:
    for path in Path(benchmarks.__file__).parent.glob("*.py"):
        if path.stem.startswith("__"):
            continue
        (run,) = (
            node
            for node in ast.parse(path.read_text(encoding="utf-8")).body
            if isinstance(node, ast.FunctionDef) and node.name == "run"
        )
        assert "quick" in {argument.arg for argument in run.args.kwonlyargs}, path
