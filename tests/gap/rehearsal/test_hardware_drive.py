import mujoco
import numpy as np
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hardware_drive import PRESLIDING, Bristles, Drives, load_rig
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
            commanded = drives.commanded(data.ctrl, data.qpos[drives.qpos], data.qvel[drives.dofs])
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
        together = drives.delivered(drives.commanded(u, q, qd), q)
        for i in range(5):
            alone = drives.delivered(drives.commanded(u[i], q[i], qd[i]), q[i])
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
        pulled = drives.delivered(np.zeros(2), q)
        np.testing.assert_allclose(pulled, -2.0 * (q - 0.3) - 1.0 * (q + 0.6))

    def test_refuses_what_is_no_drive_s(self):
        with pytest.raises(ValueError, match="payload is hidden in the rigid bodies"):
            Drives(model()).hide(HiddenEffect(effect="payload", bodies=("x",), values={"mass": 1}))
        with pytest.raises(InputError, match=r"hidden in 'passive'.*it has elbow, shoulder"):
            Drives(model()).hide(
                HiddenEffect(effect="torque_bias", joints=("passive",), values={"bias": 1})
            )


@pytest.mark.parametrize(
    ("joint", "actuators", "message"),
    [
        ('name="j"', "", 'no actuators.*give each driven joint a <position joint="..."'),
        ('name="j"', '<motor name="m" joint="j"/>', "actuator 'm' is not a plain position servo"),
        ('name="j"', '<velocity joint="j" kv="2"/>', "actuator 'number 0' is not a plain position"),
        ('name="j"', '<position joint="j" kp="9" timeconst="0.1"/>', "not a plain position servo"),
        ('name="j"', '<position joint="j" kp="9" gear="2"/>', "has gear 2 where 1 is needed"),
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


class TestBristles:
    LIMIT = np.array([0.8])
    INERTIA = np.array([10.0])

    def bristles(self, step, limit=LIMIT):
        return Bristles(limit, self.INERTIA, step, 1)

    def after(self, path, step):
        bristles = self.bristles(step)
        return np.array([bristles.torque(np.array([[v]]))[0, 0] for v in np.diff(path) / step])

    @pytest.mark.parametrize("speed", [1e-3, 0.1, 50.0])
    def test_slides_at_coulomb_friction_at_any_speed_and_step(self, speed):
        bristles = self.bristles(0.01)
        for direction in (1.0, -1.0):
            steps = int(20 * PRESLIDING / (speed * 0.01)) + 1
            for _ in range(steps):
                torque = bristles.torque(np.array([[direction * speed]]))
            np.testing.assert_allclose(torque[0], -direction * self.LIMIT, rtol=1e-6)

    def test_is_exact_however_the_motion_is_cut_into_steps(self):
        # 1.2 bends forward, 0.4 back.
        forward, back = 1.2 * PRESLIDING, -0.4 * PRESLIDING
        expected = 0.8 * (1 - np.exp(-1.2))
        expected = expected * np.exp(-0.4) - 0.8 * (1 - np.exp(-0.4))
        for pieces in (1, 3, 100):
            path = np.concatenate(
                [
                    np.linspace(0, forward, pieces + 1),
                    forward + np.linspace(0, back, pieces + 1)[1:],
                ]
            )
            np.testing.assert_allclose(self.after(path, 1e-3)[-1], -expected, rtol=1e-9)

    def test_springs_back_before_it_slides(self):
        small = 0.01 * PRESLIDING
        torque = self.after(np.array([0.0, small, 0.0]), 1e-3)
        np.testing.assert_allclose(torque[0], -0.8 / PRESLIDING * small, rtol=0.01)
        assert abs(torque[1]) < 0.02 * abs(torque[0])

    def test_never_gives_energy_away(self):
        rng = np.random.default_rng(2)
        path = np.cumsum(np.cumsum(rng.normal(size=20000))) * 1e-7
        path -= np.linspace(path[0], path[-1], path.size)
        work = self.after(path, 1e-3) @ np.diff(path)
        assert work < 0

    def test_no_friction_is_no_torque(self):
        bristles = self.bristles(1e-3, np.zeros(1))
        np.testing.assert_array_equal(bristles.torque(np.array([[3.0]])), 0.0)

    def test_is_softer_where_the_inertia_is_too_light_for_the_step(self):
        light = Bristles(self.LIMIT, np.array([1e-6]), 1e-3, 1)
        q, qd = 0.0, 0.05
        for _ in range(3000):
            torque = light.torque(np.array([[qd]]))[0, 0]
            qd += 1e-3 * torque / 1e-6
            q += 1e-3 * qd
            assert abs(qd) < 0.1
