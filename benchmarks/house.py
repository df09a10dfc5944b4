"""The house in figures: its lines, its largest functions, and which way its imports go.

    python -m benchmarks house

Imports for annotations alone (`if TYPE_CHECKING:`) are none; those within functions are.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

from benchmarks import Row

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("actuators", "walkers", "tasks", "gap")
DECIDES = ROOT / "gap" / "search"
LAYERS: tuple[tuple[str, ...], ...] = (
    ("actuators",),
    ("walkers",),
    ("tasks",),
    ("gap.errors", "gap.blas", "gap.failure", "gap.bar"),
    ("gap.recordings",),
    ("gap.simulation",),
    ("gap.units", "gap.too_large", "gap.velocities"),
    ("gap.ingest",),
    ("gap.experiments",),
    ("gap.wiring",),
    ("gap.effects",),
    ("gap.standing",),
    ("gap.search",),
    ("gap.stopgap",),
    ("gap.deliver",),
    ("gap.report",),
    ("gap.workflow",),
    ("gap.fitted", "gap.steps"),
    ("gap.recorder", "gap.robot_log", "gap.simulated_unit"),
    ("gap.rehearsal", "gap.own_robot", "gap.fleet", "gap.policy", "gap.ingest.import_cli"),
    ("gap", "gap.cli", "gap.__main__"),
)
"""From the ground up: what stands on a floor imports nothing from above it."""
_LONG, _SHORT = 60, 40


def modules() -> dict[str, Path]:
    """Name of every module of the library, without `walkerkit.`, to its file."""
    found = {}
    for folder in FOLDERS:
        for path in sorted((ROOT / folder).rglob("*.py")):
            parts = path.relative_to(ROOT).with_suffix("").parts
            found[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return found


def imports(files: Mapping[str, Path]) -> dict[str, set[str]]:
    """Module to those that it imports."""
    return {name: set(_imported(path, files)) - {name} for name, path in files.items()}


def _imported(path: Path, files: Mapping[str, Path]) -> Iterator[str]:
    for node in _run(ast.parse(path.read_text(encoding="utf-8"))):
        names: Iterable[str] = ()
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [f"{node.module}.{one.name}" for one in node.names]
        elif isinstance(node, ast.Import):
            names = [one.name for one in node.names]
        for name in names:
            own = name.removeprefix("walkerkit.")
            if own != name:
                yield own if own in files else own.rpartition(".")[0]


def _run(node: ast.AST) -> Iterator[ast.AST]:
    """All of a tree but what only type checkers read."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.If) and "TYPE_CHECKING" in ast.unparse(child.test):
            continue
        yield child
        yield from _run(child)


def circle(graph: Mapping[str, set[str]]) -> list[str]:
    """The modules of a circle of imports, or none."""
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return list(error.args[1])
    return []


def floor(module: str) -> int:
    """On which of the layers a module stands."""
    parts = module.split(".")
    for length in range(len(parts), 0, -1):
        name = ".".join(parts[:length])
        for k, layer in enumerate(LAYERS):
            # The package `gap` is its top, and not what is in it.
            if name in layer and (name != "gap" or module == "gap"):
                return k
    raise LookupError(f"{module} is on no layer; add it to benchmarks.house.LAYERS")


def upward(graph: Mapping[str, set[str]]) -> list[tuple[str, str]]:
    """Imports from a higher layer, by whom and of what."""
    return [
        (name, other)
        for name, others in graph.items()
        for other in sorted(others)
        if floor(other) > floor(name)
    ]


def namesakes(files: Mapping[str, Path]) -> list[str]:
    """Names that more than one module has."""
    names = Counter(path.stem for path in files.values() if path.stem != "__init__")
    return [name for name, count in names.items() if count > 1]


def run(*, quick: bool) -> list[Row]:
    """Counts, which takes a second in any case."""
    files = modules()
    graph = imports(files)
    sizes = {name: _lines(path) for name, path in files.items()}
    long = sorted((lines, name) for path in files.values() for name, lines in _functions(path))
    decides = sum(lines for name, lines in sizes.items() if DECIDES in files[name].parents)
    tests = sum(map(_lines, ROOT.glob("tests/**/*.py")))
    short = [
        n for n, k in sizes.items() if k < _SHORT and files[n].stem not in ("__init__", "__main__")
    ]
    return [
        Row(what="circles of imports", result=str(int(bool(circle(graph)))), required="0"),
        Row(what="imports from a layer above", result=str(len(upward(graph))), required="0"),
        Row(what="library", result=f"{sum(sizes.values()):,} lines", required="≤ 46,800"),
        Row(what="what proposes and decides", result=f"{decides:,} lines", required="< 3,500"),
        Row(what="tests", result=f"{tests:,} lines", required="< 38,000"),
        Row(
            what=f"functions over {_LONG} lines",
            result=f"{sum(k > _LONG for k, _ in long)}; {long[-1][1]} has {long[-1][0]}",
            required="0 but tables",
        ),
        Row(
            what=f"modules under {_SHORT} lines",
            result=f"{len(short)}: {', '.join(short)}",
            required="each with a reason",
        ),
        Row(
            what="names of several modules",
            result=", ".join(namesakes(files)) or "none",
            required="none",
        ),
    ]


def _lines(path: Path) -> int:
    return len(path.read_text(encoding="utf-8").splitlines())


def _functions(path: Path) -> Iterator[tuple[str, int]]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            lines = (node.end_lineno or node.lineno) - node.lineno + 1
            yield f"{path.relative_to(ROOT)}: {node.name}", lines
