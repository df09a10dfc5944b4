import mujoco
import numpy as np
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hardware_drive import Drives, load_rig
from walkerkit.gap.rehearsal.hidden import HiddenEffect

ARM = """
<mujoco><compiler angle="radian"/><option gravity="0 0 0"/><worldbody>
  <body><joint name="passive" type="slide" axis="1 0 0" damping="7" frictionloss="0.7"/>
    <geom size="0.1" mass="2"/>
    <body><joint name="shoulder" axis="0 1 0" damping="0.1 0.2 0.3" {shoulder}/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="1"/>
      <body pos="0 0 -0.3"><joint name="elbow" axis="0 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5"/></body></body></body>
</worldbody><actuator>
  <position name="second" joint="elbow" kp="20" kv="1" forcerange="-4 5"/>
  <position name="first" joint="shoulder" kp="50" kv="2" ctrlrange="-1 1" {first}/>
</actuator></mujoco>
"""


def model(shoulder="", first=""):
    return mujoco.MjModel.from_xml_string(ARM.format(shoulder=shoulder, first=first))


def everywhere(effect, **values):
    return HiddenEffect(effect=effect, joints=("*",), values=values)


class TestDrives:
    def test_joints_are_in_the_actuators_order(self):
        drives = Drives(model())
        assert drives.joints == ("elbow", "shoulder")
        np.testing.assert_array_equal(drives.dofs, [2, 1])

    def test_servo_is_the_native_one_at_every_state(self):
        native = model(shoulder='actuatorfrcrange="-30 20"', first='forcerange="-25 40"')
        drives, data = Drives(native), mujoco.MjData(native)
        rng = np.random.default_rng(0)
        for _ in range(50):
            data.qpos[:], data.qvel[:] = rng.normal(size=(2, 3))
            data.ctrl[:] = rng.normal(size=2)
            mujoco.mj_forward(native, data)
            target = np.clip(data.ctrl, *drives.target_range)
            asked = drives.asked(target, data.qpos[drives.qpos], data.qvel[drives.dofs])
            commanded = np.clip(asked, *drives.effort_range)
            np.testing.assert_allclose(
                commanded, data.qfrc_actuator[drives.dofs], rtol=1e-12, atol=1e-12
            )

    def test_drag_is_the_native_damping_at_every_speed(self):
        native = model(first='damping="0.4 0.5 0.6"')
        drives, data = Drives(native), mujoco.MjData(native)
        for speed in (-3.0, -0.1, 0.0, 2.0):
            data.qvel[:] = speed * np.array([1, 2, -1])
            mujoco.mj_forward(native, data)
            np.testing.assert_allclose(drives.drag(data.qvel), data.qfrc_damper, atol=1e-12)

    def test_many_simulations_are_each_alone(self):
        drives = Drives(model())
        u, q, qd = np.random.default_rng(1).normal(size=(3, 5, 2))
        together = drives.asked(u, *drives.read(q, qd)) + drives.springs(q)
        for i in range(5):
            alone = drives.asked(u[i], *drives.read(q[i], qd[i])) + drives.springs(q[i])
            np.testing.assert_array_equal(together[i], alone)

    def test_hidden_numbers_pile_up(self):
        drives = Drives(model())
        for _ in range(2):
            drives.hide(everywhere("torque_constant", alpha=0.1))
            drives.hide(everywhere("command_delay", delay=0.004))
            drives.hide(everywhere("encoder_offset", offset=0.05))
        drives.hide(everywhere("effort_limit", forcerange=4.5))
        drives.hide(everywhere("effort_limit", forcerange=6.0))
        np.testing.assert_allclose(drives.strength, 1.21)
        np.testing.assert_allclose(drives.command_delay, 0.008)
        np.testing.assert_allclose(drives.offset, 0.1)
        np.testing.assert_allclose(drives.effort_range, [[-4.0, -4.5], [4.5, 4.5]])

    def test_two_springs_pull_like_their_sum(self):
        drives = Drives(model())
        drives.hide(everywhere("parallel_spring", stiffness=2.0, springref=0.3))
        drives.hide(everywhere("parallel_spring", stiffness=1.0, springref=-0.6))
        q = np.array([0.2, -1.0])
        np.testing.assert_allclose(drives.springs(q), -2.0 * (q - 0.3) - 1.0 * (q + 0.6))

    def test_encoders_read_too_steeply_about_zero_and_then_too_much(self):
        drives = Drives(model())
        drives.hide(everywhere("encoder_offset", offset=0.05))
        drives.hide(everywhere("encoder_gain", excess=0.1))
        position, speed = drives.read(np.array([1.0, 0.0]), np.array([2.0, -1.0]))
        np.testing.assert_allclose(position, [1.15, 0.05])
        np.testing.assert_allclose(speed, [2.2, -1.1])

    def test_refuses_joints_without_a_drive(self):
        with pytest.raises(InputError, match=r"hidden in 'passive'.*it has elbow, shoulder"):
            Drives(model()).hide(
                HiddenEffect(effect="torque_bias", joints=("passive",), values={"bias": 1})
            )


@pytest.mark.parametrize(
    ("joint", "actuators", "message"),
    [
        ('name="j"', "", 'no actuators.*give each driven joint a <position joint="..."'),
        (
            'name="j"',
            '<muscle name="m" joint="j" lengthrange="0 1"/>',
            "actuator 'm' is neither a plain servo nor a plain motor",
        ),
        (
            'name="j"',
            '<general joint="j" biastype="affine" biasprm="0 9 0"/>',
            "actuator 'number 0' is neither a plain servo nor a plain motor",
        ),
        (
            'name="j"',
            '<position joint="j" kp="9" timeconst="0.1"/>',
            "number 0' is neither a plain servo nor a plain motor",
        ),
        ('name="j"', 2 * '<position joint="j" kp="9"/>', "'number 1' is the second on joint 'j'"),
        ('name="j" type="ball"', '<position joint="j" kp="9"/>', "neither a hinge nor a slide"),
        (
            'name="j"',
            '<position site="s" kp="9" refsite="t"/>',
            "actuator 'number 0' does not drive a joint",
        ),
    ],
)
def test_refuses_models_without_plain_position_servos(tmp_path, joint, actuators, message):
    file = tmp_path / "model.xml"
    file.write_text(
        f"<mujoco><worldbody><site name='t'/><body><joint {joint}/><geom size='0.1'/>"
        f"<site name='s'/></body></worldbody><actuator>{actuators}</actuator></mujoco>"
    )
    with pytest.raises(InputError, match=message):
        load_rig(file)


@pytest.mark.parametrize("text", ["<mujoco><worldbody><body/></worldbody>", None])
def test_refuses_files_that_do_not_load(tmp_path, text):
    file = tmp_path / "broken.xml"
    if text:
        file.write_text(text)
    with pytest.raises(InputError, match=r"broken\.xml: the model does not load: .*") as refusal:
        load_rig(file)
    assert "\n" not in str(refusal.value)
