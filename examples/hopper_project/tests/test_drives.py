"""The law by hand, and on the robot."""

from dataclasses import replace

import numpy as np
import pytest
from walkerkit.actuators import IdealPdActuatorCfg

from hopper.bench import steps
from hopper.drives import CascadeLaw
from hopper.robot import DRIVES, HOPPER_XML, Hopper


def test_each_loop_has_its_limit() -> None:
    numbers = {"stiffness": 60.0, "damping": 2.0, "velocity_limit": 3.0, "effort_limit": 5.0}
    law = CascadeLaw({name: np.full(2, value) for name, value in numbers.items()})
    # Rows: within all limits; the speed clipped; the effort clipped; braking from above the speed.
    target = np.array([[0.01, -0.02], [0.5, -0.5], [0.5, -0.5], [0.5, -0.5]])
    speed = np.array([[0.1, 0.0], [1.0, -1.0], [-1.0, 1.0], [4.0, -4.0]])
    asked, left = law.effort(target, None, None, np.zeros((4, 2)), speed)
    assert asked == pytest.approx(np.array([[0.4, -1.2], [4.0, -4.0], [8.0, -8.0], [-2.0, 2.0]]))
    assert left == pytest.approx(np.clip(asked, -5.0, 5.0))
    pushed, _ = law.effort(None, np.full((4, 2), 9.0), np.ones((4, 2)), np.zeros((4, 2)), speed)
    assert pushed == pytest.approx(2.0 * (3.0 - speed) + 1.0)


def test_without_the_limit_between_its_loops_it_is_pd_control() -> None:
    plain = IdealPdActuatorCfg(
        joint_names_expr=DRIVES.joint_names_expr,
        stiffness=DRIVES.stiffness,
        damping=DRIVES.damping,
        effort_limit=DRIVES.effort_limit,
    )
    own, expected = (
        steps(Hopper.from_file(HOPPER_XML, drives), seed=0, seconds=0.5).columns
        for drives in (replace(DRIVES, velocity_limit=1e6), plain)
    )
    for name, values in expected.items():
        assert own[name] == pytest.approx(values, abs=1e-9), name


def test_a_jump_is_followed_no_faster_than_the_limit_between_its_loops() -> None:
    slow = Hopper.from_file(HOPPER_XML, replace(DRIVES, velocity_limit=2.0))
    speed = np.abs(steps(slow, seed=0, seconds=0.5).columns["knee/velocity"])
    assert 1.5 < speed.max() < 2.2
