"""What all tests share."""

from __future__ import annotations

import gc
import importlib
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import settings

# Before anything imports dm_control, which would look for a display.
os.environ.setdefault("MUJOCO_GL", "disable")
# Before anything imports numpy: the tests run side by side, and so small matrices gain nothing.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
if "PYTEST_XDIST_WORKER" in os.environ:  # then nor do processes of a test's own
    os.environ.setdefault("LOKY_MAX_CPU_COUNT", "1")
# The same examples each time, however busy the machine is.
settings.register_profile("suite", max_examples=30, deadline=None, derandomize=True)
settings.load_profile("suite")

ROOT = Path(__file__).resolve().parent.parent
# The benchmarks are no part of the installation; they are imported from the checkout, behind
# everything else, so that no folder of it hides an installed package.
if str(ROOT) not in sys.path:
    sys.path.append(str(ROOT))


# A file of tests is run by one worker, so that the longest ones must not come last.
LONGEST = (
    "gap/test_workflow.py",
    "walkers/test_dm_control_contracts.py",
    "test_examples.py",
    "test_readme.py",
    "gap/test_standing_diagnosed.py",
    "gap/search/test_naming.py",
    "benchmarks/test_hidden_effects.py",
    "gap/simulation/test_mended.py",
    "walkers/test_with_actuators.py",
    "gap/fleet/test_fleet.py",
    "gap/report/test_output.py",
    "gap/rehearsal/test_rehearse.py",
    "benchmarks/test_native_rigs.py",
    "tasks/test_vector.py",
    "test_docs.py",
    "test_example_project.py",
)


def pytest_addoption(parser: pytest.Parser) -> None:
    """Lets the longest files be left out."""
    parser.addoption("--fast", action="store_true", help="leave out the files that take longest")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Puts the longest files first, or leaves them out."""
    place = {ROOT / "tests" / name: k for k, name in enumerate(LONGEST)}
    if config.getoption("--fast"):
        items[:] = [item for item in items if item.path not in place]
    items.sort(key=lambda item: place.get(item.path, len(place)))


def pytest_collection_finish() -> None:
    """Takes what lives as long as the tests do out of the search for garbage, which is a tenth."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)


@pytest.fixture(autouse=True)
def effects_end_with_their_test() -> Iterator[None]:
    """Takes effects that a test defines, as a user does, out of the catalogue again."""
    yield
    base = sys.modules.get("walkerkit.gap.effects.base")
    if base is not None:
        base._users.clear()


@pytest.fixture(scope="session")
def repository() -> Path:
    """The checkout."""
    return ROOT


@pytest.fixture
def example(repository: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], ModuleType]:
    """Imports an example by name, as a program finds what lies beside it."""
    monkeypatch.syspath_prepend(str(repository / "examples"))
    return importlib.import_module


@pytest.fixture(scope="session")
def real_logs() -> Path:
    """The public logs of real hardware; skips where they are absent."""
    path = Path(os.environ.get("WALKERKIT_DATA", ROOT.parent / "shared" / "data"))
    if not path.is_dir():
        pytest.skip(f"{path} is missing: set WALKERKIT_DATA to the public logs")
    return path
