"""What the robot is mounted on and runs into."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests.gap.effects.contract import EffectContract, replayed
from tests.gap.effects.machine import LEG, PLAIN
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.trials import Trials


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
    rounding = 1e-5  # stops turn around what hits them
    idle = ("lower", "upper", "stiffness", "damping_ratio")

    def plant(self, machine):
        inertia = 1 / machine.model.dof_invweight0[1]

        def stops(now):
            beyond = now.q[1] - np.clip(now.q[1], -0.2, 0.85)
            effort = 400 * beyond + 2 * 0.4 * np.sqrt(400 * inertia) * now.qd[1]
            now.extra[1] -= effort * (beyond * effort > 0)

        machine.gear = stops
        return {"knee": [-0.2, 0.85, 400, 0.4]}


class TestStops:
    """Stops by hand: what is set, where, and what is left alone."""

    @staticmethod
    def trials(robot, *rows, joint="knee"):
        effect = CATALOGUE["end_stop"]
        zero = [parameter.zero for parameter in effect.parameters(robot, joint)]
        trials = Trials(robot, len(rows))
        values = np.array(
            [[z if v is None else v for v, z in zip(row, zero, strict=True)] for row in rows]
        )
        effect.apply(trials, joint, values)
        return trials

    def test_only_variants_with_a_stop_are_limited(self, plain):
        robot, recording = plain
        nothing, above, below = (None,) * 4, (None, 0.6, None, None), (-0.1, None, 500, 0.2)
        trials = self.trials(robot, nothing, above, below)
        knee = robot.joints["knee"].id
        assert trials.field("jnt_limited")[:, knee].tolist() == [False, True, True]
        free, above, below = replayed(robot, recording, trials)[:, :, 1]
        assert above.max() == pytest.approx(0.6, abs=0.05) != pytest.approx(free.max(), abs=0.1)
        assert above.min() == pytest.approx(free.min(), abs=1e-3)
        assert below.min() == pytest.approx(-0.1, abs=0.05) != pytest.approx(free.min(), abs=0.1)

    def test_the_other_stop_of_the_model_stays(self, awkward):
        robot, _ = awkward
        knee = robot.joints["knee"].id
        trials = self.trials(robot, (None, 0.6, None, None), (None, None, 200, None), (None,) * 4)
        own = robot.model.jnt_range[knee]
        np.testing.assert_array_equal(
            trials.field("jnt_range")[:, knee], [[own[0], 0.6], [own[0], own[1]], own]
        )
        # Softer stops are a change, too.
        solref = trials.field("jnt_solref")[:, knee, 0]
        assert solref[0] < solref[1] < 0 < solref[2]

    def test_a_stop_of_the_model_that_the_robot_passed_may_move_outwards(self, plain):
        robot, _ = plain
        far = replace(robot.excursion("knee"), lower=-3.0, upper=3.0)
        text = LEG.format(**PLAIN | {"knee": 'limited="true" range="-0.5 0.5"'})
        narrow = replace(
            robot_from_spec(mujoco.MjSpec.from_string(text), "leg.xml"), excursions={"knee": far}
        )
        lower, upper, *_ = CATALOGUE["end_stop"].parameters(narrow, "knee")
        assert (lower.zero, upper.zero) == (-0.5, 0.5)
        assert lower.lower < -3
        assert upper.upper > 3
