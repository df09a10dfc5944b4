"""Our tasks as Gymnasium environments; needs the extra `gymnasium`."""

from __future__ import annotations

from collections.abc import Callable
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import shimmy
from gymnasium.utils.env_checker import check_env

from walkerkit.actuators import IdealPdActuatorCfg
from walkerkit.tasks import suite

Example = Callable[[str], ModuleType]

KNEES = IdealPdActuatorCfg(
    joint_names_expr=(".*_knee",), stiffness=20.0, damping=1.0, effort_limit=30.0
)

# Accelerometers and joint speeds have no bounds, which the checker finds strange.
pytestmark = [
    pytest.mark.filterwarnings("ignore:.*A Box observation space m[a-z]+ value is -?infinity"),
    pytest.mark.filterwarnings("ignore:.*is different from the unwrapped version"),
]


def test_gymnasium_s_own_check_passes_the_example(example: Example) -> None:
    environment = example("gymnasium_env").make()
    check_env(environment, skip_render_check=True)
    assert environment.observation_space.shape == (51,)
    np.testing.assert_array_equal(environment.action_space.low, -np.ones(12))
    np.testing.assert_array_equal(environment.action_space.high, np.ones(12))
    assert environment.metadata["render_fps"] == 50


@pytest.mark.parametrize(
    ("domain", "task", "actuators"),
    [
        ("walkerkit_quadruped", "stand", None),
        ("walkerkit_biped", "walk", None),
        ("walker", "walk", KNEES),
        ("cheetah", "run", None),
    ],
)
def test_gymnasium_s_own_check_passes_suite_environments(
    domain: str, task: str, actuators: Any
) -> None:
    check_env(
        shimmy.DmControlCompatibilityV0(suite.load(domain, task, actuators)), skip_render_check=True
    )


def test_falls_are_terminated_and_time_limits_truncated(example: Example) -> None:
    environment = example("gymnasium_env").make(time_limit=0.1)
    environment.reset(seed=0)
    hold = environment.unwrapped.task.walker.action_for()
    for step in range(5):
        _, reward, terminated, truncated, _ = environment.step(hold)
        assert 0 <= reward <= 1
        assert (terminated, truncated) == (False, step == 4)
    long = example("gymnasium_env").make(time_limit=5.0)
    long.reset(seed=0)
    walker = long.unwrapped.task.walker
    walker.set_pose(long.unwrapped.physics, quaternion=[0.0, 1.0, 0.0, 0.0])
    _, _, terminated, truncated, _ = long.step(hold)
    assert (terminated, truncated) == (True, False)


@pytest.mark.parametrize("name", ["walkerkit_quadruped", "walker"])
def test_seeds_are_reproducible(name: str) -> None:
    actuators = KNEES if name == "walker" else None

    def first(seed: int) -> dict[str, np.ndarray]:
        environment = shimmy.DmControlCompatibilityV0(suite.load(name, "walk", actuators))
        observation, _ = environment.reset(seed=seed)
        return dict(observation)

    one, same, other = first(0), first(0), first(1)
    for key, value in one.items():
        np.testing.assert_array_equal(value, same[key])
    assert any(not np.array_equal(value, other[key]) for key, value in one.items())


def test_the_example_runs(example: Example, capsys: pytest.CaptureFixture[str]) -> None:
    returns = example("gymnasium_env").main(2)
    assert len(returns) == 2
    assert all(total > 0 for total in returns)
    assert capsys.readouterr().out.count("episode") == 2
