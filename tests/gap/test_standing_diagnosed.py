"""A quadruped on its feet, from logs to names: floating base, contacts, ground and trunk."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from walkerkit import gap
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.rehearsal.standing import RATE, standing_targets, write_standing

# Of what the ground and the trunk can have; the whole catalogue takes minutes.
FEW = ("ground_friction", "payload")
SECONDS = 1.2
LOAD = HiddenEffect(effect="payload", bodies=("trunk",), values={"mass": 1.5})


@pytest.fixture(scope="module")
def standing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_standing(tmp_path_factory.mktemp("standing"))


def logs(model: Path, *hidden: HiddenEffect) -> list[Recording]:
    targets = standing_targets(np.random.default_rng(4), seconds=SECONDS)
    names = ["sway", "steps"]
    recordings = run_hardware(
        model, [targets[name] for name in names], rate=RATE, hidden=hidden, seed=5, names=names
    )
    return list(recordings)


def test_what_the_trunk_carries_is_named_and_not_taken_for_weak_drives(standing: Path) -> None:
    ordinary = ("viscous_friction", "position_gain", "command_delay")
    found = gap.diagnose(standing, logs(standing, LOAD), effects=(*FEW, *ordinary)).diagnosis
    surest, *others = found.effects
    assert (surest.effect, surest.bodies) == ("payload", ("trunk",))
    assert not [one.effect for one in others if one.effect in (*FEW, "position_gain")]
    (mass,) = surest.parameters
    assert mass.std is not None
    assert mass.std < 0.15
    assert mass.value == pytest.approx(1.5, abs=min(0.15, 2 * mass.std))
    assert found.gap.position.after < 0.5 * found.gap.position.before
    # The legs move each other; nothing is out of step.
    assert not any("out of step" in note for note in found.notes)


def test_nothing_is_named_where_nothing_is_missing(standing: Path) -> None:
    found = gap.diagnose(standing, logs(standing), effects=FEW).diagnosis
    assert found.effects == ()
