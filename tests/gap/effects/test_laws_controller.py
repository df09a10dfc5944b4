"""The controller in the drive: what becomes of targets and of feedback."""

import numpy as np

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import STEP
from walkerkit.gap.effects import EVERYWHERE

HIP, KNEE = 0, 1
KP, KD = (60.0, 30.0), (2.0, 1.0)


class TestSetpointFilter(EffectContract):
    name = "setpoint_filter"
    seconds = 2.0

    def plant(self, machine):
        where = {}

        def filtered(now):
            # Forward Euler in a hundred parts of a step, and their mean.
            for joint in (HIP, KNEE):
                x, seen = where.get(joint, now.target[joint]), []
                for _ in range(100):
                    seen.append(x)
                    x += STEP / 100 / 0.021 * (now.target[joint] - x)
                where[joint] = x
                now.target[joint] = np.mean(seen)

        machine.controller = filtered
        return {EVERYWHERE: [0.021]}


class TestSlewLimit(EffectContract):
    name = "slew_limit"
    seconds = 2.0
    may_be_out_of_reach = True

    def plant(self, machine):
        where = []

        def slewed(now):
            last = where[-1] if where else now.target[KNEE]
            step = 1.3 * STEP
            here = last + max(-step, min(step, now.target[KNEE] - last))
            where.append(here)
            now.target[KNEE] = here

        machine.controller = slewed
        return {"knee": [1.3]}

    def test_a_limit_that_only_the_fastest_moves_reach_is_near_a_start(self, plain):
        # Its gap is narrow: above the fastest move nothing changes, far below it all moves are off.
        robot, _ = plain
        (rate,) = self.effect.parameters(robot, "knee")
        starts = np.array(rate.starts)
        for limit in np.linspace(0.5, 1.0, 26) * robot.excursion("knee").velocity:
            assert np.abs(starts / limit - 1).min() < 0.1, limit


class TestSampleAndHold(EffectContract):
    name = "sample_and_hold"
    seconds = 2.0

    def plant(self, machine):
        held = {}

        def sampled(now):
            if round(now.time / STEP) % 8 == 0 or not held:
                held[0] = now.target.copy()
            now.target[:] = held[0]

        machine.controller = sampled
        return {EVERYWHERE: [8 * STEP]}


class TestControllerDeadband(EffectContract):
    name = "controller_deadband"
    # At the edge of the band, the noise of the first position decides on when efforts begin.
    noises_left = 30.0
    rounding = 1e-3
    may_be_out_of_reach = True
    seconds = 2.0

    def plant(self, machine):
        def dead(now):
            # A loop of many turns in each step.
            turns = STEP * (np.arange(100) + 0.5) / 100
            errors = now.target[KNEE] - now.q[KNEE] - now.qd[KNEE] * turns
            left_alone = np.abs(errors) < 0.037
            error = now.target[KNEE] - now.q[KNEE]
            now.target[KNEE] -= np.mean(left_alone) * error
            now.ahead[KNEE] = KP[KNEE] * (np.mean(left_alone) - left_alone[0]) * error

        machine.controller = dead
        return {"knee": [0.037]}


class TestIntegralAction(EffectContract):
    name = "integral_action"
    may_be_out_of_reach = True
    idle = ("clamp",)
    seconds = 2.0

    def plant(self, machine):
        added = [0.0]

        def integrated(now):
            error = now.target[HIP] - now.q[HIP]
            added[0] += 47.0 * error * STEP
            added[0] = max(-0.6, min(0.6, added[0]))
            now.effort[HIP] += added[0]

        machine.drive = integrated
        return {"hip": [47.0, 0.6]}


class TestVelocityFilter(EffectContract):
    name = "velocity_filter"
    seconds = 2.0

    def plant(self, machine):
        where = np.zeros(2)

        def filtered(now):
            for joint in (HIP, KNEE):
                seen = []
                for _ in range(100):
                    seen.append(where[joint])
                    where[joint] += STEP / 100 / 0.013 * (now.qd[joint] - where[joint])
                now.effort[joint] += KD[joint] * (now.qd[joint] - np.mean(seen))
            now.effort[KNEE] = max(-20.0, min(20.0, now.effort[KNEE]))

        machine.drive = filtered
        return {EVERYWHERE: [0.013]}
