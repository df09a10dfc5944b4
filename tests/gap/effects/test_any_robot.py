"""The numbers of every effect hold together on any robot that MuJoCo compiles, however it moved."""

import mujoco
import numpy as np
import pytest

from tests.gap.effects.any_robot import any_robot
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.simulation.ground_geoms import Ground
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.trials import Trials

FINGER = """
<mujoco><default><geom solimp="{solimp}"/></default>
<worldbody>{floor}<body name="trunk" pos="0 0 1"><geom size="0.1"/>
  <body name="leg" pos="0 0 -0.1"><joint name="hip" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02"/></body></body></worldbody></mujoco>
"""
FLOOR = '<geom type="plane" size="1 1 1"/>'


@pytest.mark.parametrize("first", range(0, 80, 20))
def test_bounds_and_starts_hold_on_any_robot(first):
    for seed in range(first, first + 20):
        robot, text = any_robot(seed)
        for effect in CATALOGUE.values():
            for site in effect.sites(robot, tuple(robot.joints)):
                parameters = effect.parameters(robot, site)  # which refuses what contradicts itself
                told = (effect.name, site, parameters, text)
                assert len({len(p.starts) for p in parameters}) == 1, told
                for p in parameters:
                    assert np.isfinite([p.zero, p.lower, p.upper, p.scale, *p.starts]).all(), told
                    assert p.scale < p.upper - p.lower, told
                starts = np.array([p.starts for p in parameters], dtype=float).T
                assert (starts != [p.zero for p in parameters]).any(axis=1).all(), told
                trials = Trials(robot, len(starts))
                effect.apply(trials, site, starts)
                for field in trials.fields.values():
                    assert np.isfinite(field).all(), told


def hanging(floor="", solimp="0.9 0.95 0.001"):
    text = FINGER.format(floor=floor, solimp=solimp)
    return robot_from_spec(mujoco.MjSpec.from_string(text), "hanging.xml")


def test_what_a_robot_hangs_by_is_no_ground():
    robot = hanging()
    assert not Ground(robot.model)
    for name in ("ground_friction", "ground_compliance"):
        assert CATALOGUE[name].sites(robot, tuple(robot.joints)) == ()
    standing = hanging(floor=FLOOR)
    assert [*Ground(standing.model).fixed] == [0]
    for name in ("ground_friction", "ground_compliance"):
        assert CATALOGUE[name].sites(standing, tuple(standing.joints)) == (EVERYWHERE,)


@pytest.mark.parametrize("solimp", ["0.015 1 0.031", "0 0 0.001", "1 1 0.001", "1 0.01 0.001"])
def test_contacts_of_any_impedance_can_be_softer_or_harder(solimp):
    robot = hanging(floor=FLOOR, solimp=solimp)
    (_, impedance) = CATALOGUE["ground_compliance"].parameters(robot, EVERYWHERE)
    assert impedance.lower < impedance.upper
    ends = np.array([[0.0, impedance.lower], [0.0, impedance.upper]])
    trials = Trials(robot, 2)
    CATALOGUE["ground_compliance"].apply(trials, EVERYWHERE, ends)
    both = trials.field("geom_solimp")[:, :, :2]
    assert both.min() >= 0.0
    assert both.max() <= 1.0
    assert not np.array_equal(both[0], both[1])


def test_a_drive_that_pushes_away_has_no_gains_of_a_servo():
    text = FINGER.format(floor="", solimp="0.9 0.95 0.001").replace(
        "</worldbody>",
        '</worldbody><actuator><general joint="hip" biastype="affine" gainprm="1" '
        'biasprm="0 5 2"/></actuator>',
    )
    robot = robot_from_spec(mujoco.MjSpec.from_string(text), "away.xml")
    for name in ("position_gain", "controller_deadband", "integral_action", "setpoint_filter"):
        assert CATALOGUE[name].sites(robot, ("hip",)) == ()
    (kd,) = CATALOGUE["velocity_gain"].parameters(robot, "hip")
    assert kd.lower == 0.0
