"""What is said of several effects together."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import pytest

from walkerkit.gap.report.diagnosis import Diagnosis
from walkerkit.gap.report.named import stand_ins


@pytest.mark.parametrize(
    ("effects", "groups"),
    [
        (("viscous_friction", "coulomb_friction", "armature", "backlash"), []),
        (("backlash", "command_delay"), []),
        (("backlash", "command_delay", "cogging"), [("backlash", "command_delay", "cogging")]),
        (
            ("backlash", "command_delay", "cogging", "armature"),
            [("backlash", "command_delay", "cogging", "armature")],
        ),
        # One delay of another kind is fitted by these two, and one gain by those.
        (("setpoint_filter", "loop_delay"), [("setpoint_filter", "loop_delay")]),
        (
            ("armature", "velocity_gain", "torque_constant"),
            [("velocity_gain", "torque_constant")],
        ),
        # Friction of several kinds is what robots have.
        (("coulomb_friction", "stribeck_friction"), []),
    ],
)
def test_what_may_together_stand_in_for_one_unknown_effect(
    leg: Callable[..., Diagnosis], effects: tuple[str, ...], groups: list[tuple[str, ...]]
) -> None:
    (one,) = leg().effects
    found = stand_ins([replace(one, effect=name) for name in effects])
    assert [tuple(each.effect for each in group) for group in found] == groups


@pytest.mark.parametrize(
    ("first", "second", "alike"),
    [
        (("hip",), ("knee",), False),
        (("hip", "knee"), ("knee",), True),
        (("*",), ("knee",), True),
    ],
)
def test_effects_of_different_joints_are_apart(
    leg: Callable[..., Diagnosis], first: tuple[str, ...], second: tuple[str, ...], alike: bool
) -> None:
    (one,) = leg().effects
    pair = (
        replace(one, effect="velocity_gain", joints=first),
        replace(one, effect="torque_constant", joints=second),
    )
    assert bool(stand_ins(pair)) is alike
