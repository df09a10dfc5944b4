"""Delays."""

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import STEP
from walkerkit.gap.effects import EVERYWHERE


class TestCommandDelay(EffectContract):
    name = "command_delay"

    def plant(self, machine):
        machine.command_age = 7
        return {EVERYWHERE: [7 * STEP]}


class TestSensorDelay(EffectContract):
    name = "sensor_delay"

    def plant(self, machine):
        machine.sensor_age = 7
        return {EVERYWHERE: [7 * STEP]}
