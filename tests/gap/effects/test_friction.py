"""Friction in the joint."""

from tests.gap.effects.contract import EffectContract


class TestViscousFriction(EffectContract):
    name = "viscous_friction"

    def plant(self, machine):
        machine.model.joint("knee").damping += 0.37
        return {"knee": [0.37]}


class TestCoulombFriction(EffectContract):
    name = "coulomb_friction"

    def plant(self, machine):
        knee = machine.model.joint("knee")
        machine.model.dof_solref[knee.dofadr] = (0.004, 1)
        machine.model.dof_solimp[knee.dofadr] = (0.99, 0.99, 0.001, 0.5, 2)
        knee.frictionloss = 0.43
        return {"knee": [0.43]}
