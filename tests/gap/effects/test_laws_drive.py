"""The drive: what becomes of the effort that its control law asks for."""

import numpy as np

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import STEP
from walkerkit.gap.effects import EVERYWHERE

HIP, KNEE = 0, 1
KP = np.array([60.0, 30.0])


class TestTorqueSpeedLimit(EffectContract):
    name = "torque_speed_limit"
    idle = ("saturation_effort", "velocity_limit")
    seconds = 2.0
    may_be_out_of_reach = True

    def plant(self, machine):
        stall, idle = 10.3, 6.7

        def limited(now):
            share = now.qd[HIP] / idle
            high = max(-stall, min(stall, stall * (1 - share)))
            low = max(-stall, min(stall, stall * (-1 - share)))
            now.effort[HIP] = max(low, min(high, now.effort[HIP]))

        machine.drive = limited
        return {"hip": [stall, idle]}


class TestActuatorLag(EffectContract):
    name = "actuator_lag"
    seconds = 2.0

    def plant(self, machine):
        where = []

        def lagging(now):
            x, seen = where[-1] if where else now.effort[HIP], []
            for _ in range(100):
                seen.append(x)
                x += STEP / 100 / 0.017 * (now.effort[HIP] - x)
            where.append(x)
            now.effort[HIP] = np.mean(seen)

        machine.drive = lagging
        return {"hip": [0.017]}


class TestStrengthDrift(EffectContract):
    name = "strength_drift"
    seconds = 2.0

    def plant(self, machine):
        def weakening(now):
            now.extra[KNEE] -= 0.043 * max(now.time, 0.0) * now.effort[KNEE]

        machine.gear = weakening
        return {"knee": [0.043]}


class TestLoopDelay(EffectContract):
    name = "loop_delay"
    seconds = 2.0

    def plant(self, machine):
        made, asked = [], []

        def late(now):
            made.append(now.effort.copy())
            asked.append(KP * now.target)
            after, before = max(-3, -len(made)), max(-4, -len(made))
            # Two steps and a half ago, when the targets were those of three steps ago.
            now.effort[:] = 0.5 * made[after] + 0.5 * made[before]
            now.ahead[:] = 0.5 * (asked[before] - asked[after])

        machine.drive = late
        return {EVERYWHERE: [2.5 * STEP]}


class TestSupplySag(EffectContract):
    name = "supply_sag"
    may_be_out_of_reach = True

    def plant(self, machine):
        def sagging(now):
            power = abs(now.effort[HIP] * now.qd[HIP]) + abs(now.effort[KNEE] * now.qd[KNEE])
            left = 20.0 * max(1 - 0.1 * power, 0.0)
            now.effort[KNEE] = max(-left, min(left, now.effort[KNEE]))

        machine.drive = sagging
        return {EVERYWHERE: [0.1]}
