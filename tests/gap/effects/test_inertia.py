"""Inertia that the model lacks."""

from tests.gap.effects.contract import EffectContract


class TestArmature(EffectContract):
    name = "armature"

    def plant(self, machine):
        machine.model.joint("hip").armature += 0.017
        return {"hip": [0.017]}


class TestPayload(EffectContract):
    name = "payload"

    def plant(self, machine):
        machine.model.body("shank").mass += 0.21
        return {"shank": [0.21]}


class TestComOffset(EffectContract):
    name = "com_offset"

    def plant(self, machine):
        machine.model.body("shank").ipos += (0.013, -0.008, -0.024)
        return {"shank": [0.013, -0.008, -0.024]}
