"""Between the joint and its log."""

from tests.gap.effects.contract import EffectContract


class TestEncoderOffset(EffectContract):
    name = "encoder_offset"

    def plant(self, machine):
        machine.offset[1] = 0.047
        return {"knee": [0.047]}
