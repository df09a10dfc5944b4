"""A seed of the benchmark of policies: what was hidden to break one is blamed, from its logs on."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from dm_control import composer

from benchmarks.policy import Balance, balancing, trial
from walkerkit import gap


def test_the_hidden_breaker_is_blamed() -> None:
    told = trial(balancing(), 0, broken=True)
    assert told.blamed == ("command_delay",)
    assert set(told.named) - set(told.blamed)


def test_without_it_nothing_is() -> None:
    told = trial(balancing(), 0, broken=False)
    assert told.named
    assert told.blamed == ()


@pytest.fixture(scope="module")
def result(tmp_path_factory: pytest.TempPathFactory) -> gap.Result:
    folder, case = tmp_path_factory.mktemp("rod"), balancing()
    (folder / "bench.xml").write_text(case.bench().to_xml())
    spec = case.bench()
    case.hide(spec, np.random.default_rng(0))
    (folder / "real.xml").write_text(spec.to_xml())
    logs = case.log(folder / "real.xml", 0)
    return gap.diagnose(folder / "bench.xml", logs, effects="command_delay", effort="quick")


def test_without_a_model_it_is_the_diagnosed_one(result: gap.Result, tmp_path: Path) -> None:
    """A result and its folder tell the same."""

    def hold(timestep: object) -> list[float]:
        return [0.1]

    def make(robot: gap.PolicyRobot) -> composer.Environment:
        return composer.Environment(Balance(robot.walker()), time_limit=0.5)

    assert [one.effect for one in result.effects] == ["command_delay"]
    live = gap.policy_gap(make, hold, result, episodes=3)
    assert live.blamed == ()
    folder = result.save(tmp_path / "out")
    (bench,) = result.problem.robots
    saved = gap.policy_gap(make, hold, folder, model=bench.source, episodes=3)
    for one, other in zip(live.outcomes, saved.outcomes, strict=True):
        assert [e.total for e in one.episodes] == pytest.approx([e.total for e in other.episodes])
