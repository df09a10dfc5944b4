"""Between the joint and its log."""

from tests.gap.effects.contract import EffectContract


class TestEncoderOffset(EffectContract):
    name = "encoder_offset"

    def plant(self, machine):
        machine.offset[1] = 0.047
        return {"knee": [0.047]}


class TestEncoderGain(EffectContract):
    name = "encoder_gain"

    def plant(self, machine):
        # A servo of 1.06 q is one of 1.06 times the gains whose targets are as much smaller.
        knee = machine.model.actuator("k")
        knee.gainprm[0], knee.biasprm[1:3] = 1.06 * 30, (-1.06 * 30, -1.06 * 1)

        def smaller(now):
            now.target[1] /= 1.06

        machine.controller = smaller
        machine.shown = lambda q: q * [1, 1.06]
        return {"knee": [0.06]}


class TestClockSkew(EffectContract):
    name = "clock_skew"

    def plant(self, machine):
        machine.clock = 1.004
        return {"*": [0.004]}
