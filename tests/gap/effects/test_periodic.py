"""Effects that come back with the pose."""

import math
from dataclasses import replace

import mujoco
import pytest

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.test_law_friction import stiffened
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.robot import Excursion
from walkerkit.gap.simulation.wave import Wave

ARM = """
<mujoco><worldbody><body><joint name="j" axis="0 1 0"/><geom size="0.1"/></body></worldbody>
<actuator><position joint="j" kp="10"/></actuator></mujoco>
"""


@pytest.mark.parametrize("periods", [1e-3, 1e5])
def test_a_wave_beyond_the_bounds_starts_at_them(periods):
    robot = robot_from_spec(mujoco.MjSpec.from_string(ARM), "arm.xml")
    wave = Wave(form="pose", periods=periods, amplitude=0.1, phase=0.0)
    robot = replace(robot, excursions={"j": Excursion(prominent=lambda: (wave,))})
    found = CATALOGUE["cogging"].parameters(robot, "j")
    (parameter,) = [one for one in found if one.name == "periods"]
    assert parameter.starts == ((parameter.lower if periods < 1 else parameter.upper),)


class TestPoseDependentFriction(EffectContract):
    name = "pose_dependent_friction"
    seconds = 2.0
    idle = ("periods", "phase")

    def plant(self, machine):
        knee = stiffened(machine, "knee")

        def gear(now):
            now.friction[knee] += 0.3 + 0.2 * math.cos(9.0 * now.q[knee])

        machine.gear = gear
        return {"knee": [0.1, 0.4, 9.0, math.pi / 2]}


class TestCogging(EffectContract):
    name = "cogging"
    seconds = 2.0
    idle = ("periods", "phase")

    def plant(self, machine):
        def gear(now):
            now.extra[1] += 0.15 * math.sin(21.0 * now.q[1]) + 0.2 * math.cos(21.0 * now.q[1])

        machine.gear = gear
        return {"knee": [0.25, 21.0, math.atan2(0.2, 0.15)]}


class TestTorqueRipple(EffectContract):
    name = "torque_ripple"
    seconds = 2.0
    idle = ("periods", "phase")

    def plant(self, machine):
        def gear(now):
            now.extra[0] += 0.18 * now.effort[0] * math.sin(12.0 * (now.q[0] - 0.1))

        machine.gear = gear
        return {"hip": [0.18, 12.0, -1.2]}
