"""Effects that come back with the pose."""

import math

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.test_law_friction import stiffened


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
