"""The simulation itself."""

import mujoco

from tests.gap.effects.contract import EffectContract


class TestTimestep(EffectContract):
    name = "timestep"
    chosen = True

    def plant(self, machine):
        machine.model.opt.timestep /= 4
        machine.model.opt.integrator = mujoco.mjtIntegrator.mjINT_EULER
        return {"*": [0.0005, 1]}
