"""The effect: its law, and a diagnosis that names it where it is hidden."""

from dataclasses import fields
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from walkerkit import gap
from walkerkit.actuators import Step
from walkerkit.walkers.saved import saved_actuators

from hopper.bench import HIDDEN, logs, steps
from hopper.robot import DRIVES, on_stand
from hopper.saturation import IronSaturation

# What else slows large and fast motions; `walkerkit diagnose` tries the whole catalogue.
RIVALS = ("armature", "viscous_friction", "torque_constant", "effort_limit")


def test_at_its_zero_nothing_changes_bit_for_bit() -> None:
    nothing = IronSaturation(joint_names_expr=(".*",), bend=0.0)
    plain, neutral = (steps(on_stand(laws=laws), 0, 0.5) for laws in ((), (nothing,)))
    for name, values in plain.columns.items():
        np.testing.assert_array_equal(neutral.columns[name], values)


def test_seventy_one_percent_of_the_saturation_effort_are_left() -> None:
    given: dict[str, Any] = {item.name: np.zeros(3) for item in fields(Step) if item.init}
    step = Step(**given | {"effort": np.array([0.1, 10.0, -10.0])})
    IronSaturation.apply(step, {"bend": np.full(3, 0.1)}, {})
    assert step.effort + step.extra == pytest.approx([0.1, 7.0711, -7.0711], abs=1e-4)
    assert step.effort[1] == 10.0  # which the drive goes on to report


def test_the_diagnosis_names_it_and_the_mended_leg_moves_as_the_real_one(tmp_path: Path) -> None:
    result = gap.diagnose(
        "hopper.robot:on_stand", logs(range(3)), effects=[*RIVALS, HIDDEN.name], effort="quick"
    )
    assert result.verdict == "explained"
    (named,) = result.effects
    assert (named.effect, named.joints) == ("iron_saturation", ("knee",))
    assert named.confidence > 0.9
    (estimate,) = named.parameters
    assert estimate.name == "saturation_effort"
    assert estimate.value == pytest.approx(1 / 0.08, rel=0.02)
    assert result.gap.position.after < 0.2 * result.gap.position.before

    # Targets that no fit has seen, and no noise.
    real, mended, given = (
        steps(leg, seed=7).columns["knee/position"]
        for leg in (on_stand(laws=[HIDDEN]), result.walker(), on_stand())
    )
    assert np.abs(mended - real).max() < 0.1 * np.abs(given - real).max()

    result.save(tmp_path)
    saved = saved_actuators(tmp_path / "model.xml", in_python=[DRIVES])
    assert [law.name for law in saved.laws] == ["iron_saturation"]


@pytest.mark.parametrize("group", ["walkerkit.effects", "walkerkit.laws"])
def test_walkerkit_finds_the_module_by_itself(group: str) -> None:
    assert entry_points(group=group)["hopper"].load().__name__ == IronSaturation.__module__
