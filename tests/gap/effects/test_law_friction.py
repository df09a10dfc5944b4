"""Dry friction that knows a direction, a speed, a load or a memory."""

import math

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import STEP


def stiffened(machine, name):
    """Dry friction that hardly creeps; the joint's number among hip and knee."""
    joint = machine.model.joint(name)
    machine.model.dof_solref[joint.dofadr] = (2 * STEP, 1)
    machine.model.dof_solimp[joint.dofadr] = (0.99, 0.99, 0.001, 0.5, 2)
    return ("hip", "knee").index(name)


class TestQuadraticDrag(EffectContract):
    name = "quadratic_drag"

    def plant(self, machine):
        def gear(now):
            now.extra[1] -= 0.13 * now.qd[1] * abs(now.qd[1])

        machine.gear = gear
        return {"knee": [0.13]}


class TestAsymmetricFriction(EffectContract):
    name = "asymmetric_friction"

    def plant(self, machine):
        knee = stiffened(machine, "knee")

        def gear(now):
            # A ratchet: a preload that the joint has to lift one way and is held against the other.
            now.friction[knee] += 0.24
            now.extra[knee] -= 0.17

        machine.gear = gear
        return {"knee": [0.41, 0.07]}


class TestStribeckFriction(EffectContract):
    name = "stribeck_friction"
    idle = ("velocity", "exponent")

    def plant(self, machine):
        knee = stiffened(machine, "knee")

        def gear(now):
            now.friction[knee] += 0.52 * math.exp(-((abs(now.qd[knee]) / 0.31) ** 1.4))

        machine.gear = gear
        return {"knee": [0.52, 0.31, 1.4]}


class TestLoadDependentFriction(EffectContract):
    name = "load_dependent_friction"

    def plant(self, machine):
        hip = stiffened(machine, "hip")

        def gear(now):
            now.friction[hip] += 0.23 * abs(now.effort[hip])

        machine.gear = gear
        return {"hip": [0.23]}


class TestDirectionalEfficiency(EffectContract):
    name = "directional_efficiency"

    def plant(self, machine):
        hip = stiffened(machine, "hip")

        def gear(now):
            # Lost when it drives: a quarter of the effort less than what the gear holds.
            now.friction[hip] += 0.125 * abs(now.effort[hip])
            now.extra[hip] -= 0.125 * now.effort[hip]

        machine.gear = gear
        return {"hip": [0.75, 1.0]}


class TestPreslidingFriction(EffectContract):
    name = "presliding_friction"
    idle = ("bend",)

    def plant(self, machine):
        bent = 0.0

        def gear(now):
            nonlocal bent
            for _ in range(200):
                speed = now.qd[1]
                bent += STEP / 200 * (speed - 45.0 * abs(speed) * bent / 0.4)
            now.extra[1] -= 45.0 * bent

        machine.gear = gear
        return {"knee": [0.4, 0.4 / 45.0]}
