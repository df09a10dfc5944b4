"""What is said of several effects together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from walkerkit.gap.report.diagnosis import Diagnosis
from walkerkit.gap.report.named import many_at_once


@pytest.mark.parametrize(
    ("effects", "many"),
    [
        (("viscous_friction", "coulomb_friction", "armature", "backlash"), False),
        (("backlash", "command_delay"), False),
        (("backlash", "command_delay", "cogging"), True),
    ],
)
def test_what_every_model_has_a_little_wrong_does_not_make_it_many(
    leg: Callable[..., Diagnosis], effects: tuple[str, ...], many: bool
) -> None:
    (one,) = leg().effects
    assert many_at_once([replace(one, effect=name) for name in effects]) is many
