"""The drive: what becomes of the effort that its control law asks for."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import AWKWARD, JOINTS, PLAIN, STEP, robot_of
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.simulation.excursion import excursions

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


def battery(time):
    """Volts of a supply of 12 V on which other things hang, too."""
    return 12.0 + 2.2 * np.sin(4.1 * np.asarray(time))


class TestSupplyVoltage(EffectContract):
    name = "supply_voltage"
    seconds = 2.0

    @pytest.fixture(scope="class")
    @classmethod
    def plain(cls):
        return robot_of(PLAIN, battery)

    @pytest.fixture(scope="class")
    @classmethod
    def awkward(cls):
        return robot_of(AWKWARD, battery)

    def plant(self, machine):
        machine.voltage = battery
        usual = float(np.median(battery(STEP * np.arange(round(self.seconds / STEP)))))

        def weaker(now):
            now.effort *= battery(now.time) / usual

        machine.drive = weaker
        return {EVERYWHERE: [1.0]}

    def test_acts_only_where_the_voltage_was_logged_and_varied(self, plain):
        robot, recording = plain
        effect = CATALOGUE[self.name]
        assert effect.sites(robot, JOINTS) == JOINTS
        steady = {**recording.columns, "voltage": np.full(len(recording.time), 12.0)}
        silent = {name: v for name, v in steady.items() if name != "voltage"}
        for columns in (steady, silent):
            log = replace(recording, columns=columns)
            moved = replace(robot, excursions=excursions(robot, [log], JOINTS))
            assert effect.sites(moved, JOINTS) == ()


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
