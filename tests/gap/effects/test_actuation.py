"""The drive: its gains, its torque and its limits, alone and together."""

import mujoco
import numpy as np
import pytest

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import SIGNALS, STEP
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.search.structure import Structure, Term
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Channel, Replay


class TestPositionGain(EffectContract):
    name = "position_gain"

    def plant(self, machine):
        machine.model.actuator("k").gainprm[0] = 22
        machine.model.actuator("k").biasprm[1] = -22
        return {"knee": [-8]}


class TestVelocityGain(EffectContract):
    name = "velocity_gain"

    def plant(self, machine):
        machine.model.actuator("k").biasprm[2] = -1.6
        return {"knee": [0.6]}


class TestTorqueConstant(EffectContract):
    name = "torque_constant"

    def plant(self, machine):
        # The same servo, felt 1.23 times as strongly and logged as before.
        for name, (kp, kv, strength) in {"h": (60, 2, 1), "k": (30, 1, 1.23)}.items():
            machine.model.actuator(name).gainprm[0] = strength * kp
            machine.model.actuator(name).biasprm[1:3] = -strength * kp, -strength * kv
        machine.model.actuator("k").forcerange *= 1.23
        machine.effort_factor[1] = 1 / 1.23
        return {"knee": [0.23]}


class TestTorqueBias(EffectContract):
    name = "torque_bias"

    def plant(self, machine):
        machine.applied[0] = -0.62
        return {"hip": [-0.62]}


class TestEffortLimit(EffectContract):
    name = "effort_limit"
    idle = ("limit",)
    may_be_out_of_reach = True

    def plant(self, machine):
        # A joint's own actuatorfrcrange is the same limit, but other code integrates its damping.
        hip = machine.model.actuator("h").id
        machine.model.actuator_forcelimited[hip] = 1
        machine.model.actuator_forcerange[hip] = (-5.3, 5.3)
        return {"hip": [5.3]}


# Of each: the law's kp and kd at the joint, and the effort at its target.
SERVOS = {
    "position": ('<position joint="j" kp="30" kv="1"/>', 30, 1, 0),
    "scaled": (
        '<general joint="j" gear="-2" biastype="affine" gainprm="9" biasprm="3 -7.5 -0.25"/>',
        30,
        1,
        0,
    ),
    "with effort": (
        '<general joint="j" gear="2" input="pos" biastype="affine" gainprm="7.5" '
        'biasprm="0.6 -7.5 -0.25"/>',
        30,
        1,
        1.2,
    ),
}


class TestTogether:
    """Several effects on one drive, against its law by hand.

    Euler's integrator treats an actuator like any other effort, so that the law may be applied from
    outside, step by step, and has to agree to the last digits.
    """

    ROD = """
    <mujoco><compiler angle="radian"/><option timestep="0.002" integrator="Euler">
    <flag eulerdamp="disable"/></option>
    <worldbody><body name="rod"><joint name="j" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/></body></worldbody>
    <actuator>{actuator}</actuator></mujoco>"""

    def compare(self, actuator, values, law, forward=0.0, kind="position"):
        """Replays the effects, in their order, beside a law of (target, q, q̇) → (effort, log)."""
        robot = robot_from_spec(
            mujoco.MjSpec.from_string(self.ROD.format(actuator=actuator)), "rod"
        )
        time = STEP * np.arange(500)
        target = 0.4 * np.sin(9 * time) + 0.3 * np.sign(np.sin(5 * time))
        columns = {"j/position": 0 * time, f"j/{kind}_target": target}
        if forward:
            columns["j/effort_target"] = forward * np.sin(13 * time)
        recording = Recording(name="log", time=time, columns=columns)
        terms = tuple(Term(effect=CATALOGUE[name], sites=("j",)) for name in values)
        structure = Structure(terms, (robot,))
        trials = structure.trials(robot, np.array([[*values.values()]], dtype=float))
        channels = [Channel(joint="j", signal=signal) for signal in SIGNALS]
        (got,) = Replay(robot, whole(recording), channels).predict(trials)

        model = mujoco.MjModel.from_xml_string(self.ROD.format(actuator=""))
        data, expected = mujoco.MjData(model), []
        for k, u in enumerate(target):
            effort, logged = law(u, float(data.qpos[0]), float(data.qvel[0]))
            ahead = columns["j/effort_target"][k] if forward else 0.0
            data.qfrc_applied[0] = effort + ahead * self.strength
            expected.append((float(data.qpos[0]), logged + ahead))
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(got, expected, rtol=1e-7, atol=1e-7)
        return np.array(expected)[:, 1]

    strength = 1.0

    @pytest.mark.parametrize("servo", SERVOS)
    def test_gains_keep_the_meaning_of_the_target(self, servo):
        actuator, kp, kd, constant = SERVOS[servo]

        def law(u, q, qd):
            effort = (kp + 11) * (u - q) - (kd + 0.3) * qd + constant
            return effort, effort

        self.compare(actuator, {"position_gain": 11, "velocity_gain": 0.3}, law)

    @pytest.mark.parametrize("gear", [1, -2])
    def test_gain_of_a_velocity_servo(self, gear):
        def law(v, q, qd):
            return 2 * (2.6 * (v - qd),)

        actuator = f'<velocity joint="j" kv="{2 / gear**2}" gear="{gear}"/>'
        self.compare(actuator, {"velocity_gain": 0.6}, law, kind="velocity")

    @pytest.mark.parametrize("servo", SERVOS)
    def test_torque_constant_and_bias_in_either_order(self, servo):
        actuator, kp, kd, constant = SERVOS[servo]
        for names, bias in (
            (["torque_constant", "torque_bias"], 0.7),
            (["torque_bias", "torque_constant"], 1.25 * 0.7),
        ):

            def law(u, q, qd, bias=bias):
                believed = kp * (u - q) - kd * qd + constant
                return 1.25 * believed + bias, believed

            values = {"torque_constant": 0.25, "torque_bias": 0.7}
            self.compare(actuator, {name: values[name] for name in names}, law)

    @pytest.mark.parametrize("servo", SERVOS)
    def test_limit_is_of_what_the_drive_believes_in_either_order(self, servo):
        actuator, kp, kd, constant = SERVOS[servo]

        def law(u, q, qd):
            believed = np.clip(kp * (u - q) - kd * qd + constant, -3.3, 3.3)
            return 1.25 * believed, believed

        values = {"torque_constant": 0.25, "effort_limit": 3.3}
        for names in (list(values), list(values)[::-1]):
            logged = self.compare(actuator, {name: values[name] for name in names}, law)
            assert np.mean(np.abs(logged) == 3.3) > 0.1

    def test_torque_constant_scales_feed_forward_effort_too(self):
        def law(u, q, qd):
            believed = 30 * (u - q) - qd
            return 1.25 * believed, believed

        self.strength = 1.25
        actuator = SERVOS["position"][0]
        self.compare(actuator, {"torque_constant": 0.25}, law, forward=3.0)
