"""The world around the robot."""

import mujoco
import numpy as np

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import LEG, PLAIN
from walkerkit.gap.effects import EVERYWHERE


class TestBaseTilt(EffectContract):
    name = "base_tilt"

    def plant(self, machine):
        # Gravity turned by roll about x, then by pitch about y.
        roll, pitch = 0.05, -0.08
        half = 0.5 * np.array([roll, pitch])
        (sx, sy), (cx, cy) = np.sin(half), np.cos(half)
        turn = np.zeros(4)
        mujoco.mju_mulQuat(turn, np.array([cy, 0, sy, 0]), np.array([cx, sx, 0, 0]))
        gravity = np.zeros(3)
        mujoco.mju_rotVecQuat(gravity, np.array([0, 0, -9.81]), turn)
        machine.model.opt.gravity = gravity
        return {EVERYWHERE: [roll, pitch]}


class TestEndStop(EffectContract):
    name = "end_stop"
    may_be_out_of_reach = True
    idle = ("lower", "upper", "timeconst")

    def plant(self, machine):
        stops = 'name="knee" limited="true" range="-0.2 0.85" solreflimit="0.013 1"'
        text = LEG.format(**PLAIN).replace('name="knee"', stops)
        machine.model = mujoco.MjModel.from_xml_string(text)
        return {"knee": [-0.2, 0.85, 0.013]}
