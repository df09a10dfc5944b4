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
    "test_examples.py",
    "walkers/test_dm_control_contracts.py",
    "gap/test_cli.py",
    "test_docs.py",
    "gap/fleet/test_fleet.py",
    "gap/report/test_output.py",
    "test_readme.py",
    "gap/search/test_naming.py",
    "gap/rehearsal/test_rehearse.py",
    "gap/fleet/test_engine.py",
    "gap/own_robot/test_excite_standing.py",
    "gap/test_faults.py",
    "tasks/test_vector.py",
    "test_example_project.py",
    "benchmarks/test_hidden_effects.py",
    "walkers/test_with_actuators.py",
    "gap/policy/test_policy_gap.py",
    "gap/rehearsal/test_any_drive.py",
    "benchmarks/test_policy.py",
    "gap/test_own_actuator.py",
    "gap/rehearsal/test_hardware.py",
    "gap/test_standing_diagnosed.py",
    "gap/simulation/test_mended.py",
    "benchmarks/test_native_rigs.py",
)
# What takes nearly two seconds or more, by folder: the inner loop goes without it as well.
LONG = {
    "actuators/networks": "convert_torch_lstm",
    "actuators": (
        "builtin builtin_dc_motor builtin_muscle delayed explicit learned randomization "
        "randomize scaled stability transmission wrapped"
    ),
    "benchmarks": "endurance long_log planted rivals",
    "gap/deliver": "export",
    "gap/effects": (
        "actuation ground law_friction laws_controller laws_drive measurement periodic play"
    ),
    "gap/ingest": "formats",
    "gap/recordings": "recording",
    "gap/rehearsal": "hidden_draw",
    "gap/report": "film hints page planner view",
    "gap/search": "buildable effort fit problem propose signatures",
    "gap/simulation": "base_estimate law_memory mend own_log workers",
    "gap/standing": "battery",
    "gap": "determinism driven_otherwise floating recorder steps walking wiring",
    "tasks": "gymnasium stand suite",
    "": "walker_examples",
    "walkers": "actuated gymnasium_robots mjcf_walker our_robots public_robots standing",
}
PLACE = {ROOT / "tests" / name: k for k, name in enumerate(LONGEST)}
LEFT_OUT = {
    *PLACE,
    *(
        ROOT / "tests" / folder / f"test_{name}.py"
        for folder, names in LONG.items()
        for name in names.split()
    ),
}


def pytest_addoption(parser: pytest.Parser) -> None:
    """Lets long files be left out."""
    parser.addoption("--fast", action="store_true", help="leave out files that take long")


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Leaves long files out before they are even imported."""
    left_out = config.getoption("--fast") and collection_path in LEFT_OUT
    return True if left_out else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts the longest files first."""
    items.sort(key=lambda item: PLACE.get(item.path, len(PLACE)))


def pytest_collection_finish() -> None:
    """Takes what lives as long as the tests do out of the search for garbage, which is a tenth."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(10_000, 20, 20)


@pytest.fixture(autouse=True)
def effects_end_with_their_test() -> Iterator[None]:
    """Takes effects that a test defines, as a user does, out of the catalogue again."""
    yield
    effect = sys.modules.get("walkerkit.gap.effects.effect")
    if effect is not None:
        effect._users.clear()


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
