"""Gaps and springs between motor and link.

They are planted in a machine whose rotor is a body of its own, beside the link, and tied to it by a
tendon.
"""

import mujoco
import numpy as np

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import LEG, PLAIN

ROTOR = 0.004  # kg·m²
MOTOR = 0  # where the encoder is
COUPLED = (
    LEG.format(**PLAIN)
    .replace(
        '<joint name="knee" axis="0 1 0" damping="0.1" />', '<joint name="link" axis="0 1 0"/>'
    )
    .replace(
        '<body name="shank"',
        '<body name="rotor" pos="0 0 -0.3"><inertial pos="0 0 0" mass="1e-9" '
        'diaginertia="1e-9 1e-9 1e-9"/><joint name="knee" axis="0 1 0" damping="0.1" '
        f'armature="{ROTOR}"/></body><body name="shank"',
    )
    .replace(
        "</mujoco>",
        '<tendon><fixed name="gear" {gear}><joint joint="link" coef="1"/>'
        '<joint joint="knee" coef="-1"/></fixed></tendon></mujoco>',
    )
)


def coupled(gear):
    return mujoco.MjModel.from_xml_string(COUPLED.format(gear=gear))


class TestBacklash(EffectContract):
    name = "backlash"
    idle = ("load_side", "armature")

    def plant(self, machine):
        machine.model = coupled(
            'limited="true" range="-0.017 0.017" solreflimit="0.004 1" solimplimit="0.95 0.95"'
        )
        return {"knee": [0.034, MOTOR, ROTOR]}


class TestSeriesElasticity(EffectContract):
    name = "series_elasticity"
    idle = ("damping_ratio", "load_side", "armature")

    def plant(self, machine):
        free = coupled("")
        inertia = 1 / (free.dof_invweight0[free.joint("link").dofadr[0]] + 1 / ROTOR)
        stiffness, ratio = 35.0, 0.07
        damping = 2 * ratio * np.sqrt(stiffness * inertia)
        machine.model = coupled(f'stiffness="{stiffness}" damping="{damping}" springlength="0"')
        return {"knee": [1 / stiffness, ratio, MOTOR, ROTOR]}
