"""Between motor and link."""

from tests.gap.effects.contract import EffectContract


class TestParallelSpring(EffectContract):
    name = "parallel_spring"
    idle = ("springref",)

    def plant(self, machine):
        knee = machine.model.joint("knee")
        knee.stiffness = 2.3
        machine.model.qpos_spring[knee.qposadr] = -0.4
        return {"knee": [2.3, -0.4]}
