"""The rehearsal robot on a stand that gives way, against MuJoCo's own spring under it."""

import mujoco
import numpy as np
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hardware_mount import HINGES, SHARE, Stand, can_be_mounted, mounted
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.rehearsal.hidden_draw import draw_hidden

ARM = """
<mujoco model="arm"><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody>{base}<body name="link" pos="0 0 0.5" euler="0.2 0 0">
  <joint name="arm" axis="0 1 0" armature="0.01"/>
  <inertial pos="0.05 0 -0.2" mass="1" diaginertia="0.01 0.01 0.002"/></body>{end}</worldbody>
<actuator><position joint="arm" kp="40" kv="2"/></actuator>
<keyframe><key name="home" qpos="0.3" ctrl="0.3"/></keyframe></mujoco>
"""
PLAIN = ARM.format(base="", end="")
SOFT = HiddenEffect(effect="mount_compliance", values={"stiffness": 60.0, "damping_ratio": 0.1})


def spec(text=PLAIN):
    return mujoco.MjSpec.from_string(text)


def test_the_robot_stands_where_it_stood_with_two_hinges_under_it():
    model, own = mounted(spec()), spec().compile()
    assert model.nv == own.nv + 2
    placed = []
    for one in (model, own):
        data = mujoco.MjData(one)
        mujoco.mj_resetDataKeyframe(one, data, 0)
        mujoco.mj_kinematics(one, data)
        placed.append(np.r_[data.body("link").xpos, data.body("link").xquat])
    np.testing.assert_allclose(*placed, atol=1e-9)
    carried = [model.dof_M0[model.joint(name).dofadr[0]] for name in HINGES]
    bare = mujoco.MjData(model)
    mujoco.mj_forward(model, bare)
    assert model.body("stand").inertia[0] == pytest.approx(SHARE * max(carried), rel=0.1)


def test_it_rings_at_its_frequency_and_comes_to_rest_where_it_is_carried():
    model = mounted(spec())
    stand = Stand(model, [SOFT])
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_ACTUATION
    model.opt.gravity = 0
    model.opt.timestep = 2e-4
    data = mujoco.MjData(model)
    arm = model.joint("arm").dofadr[0]
    data.qpos[model.joint("stand_roll").qposadr] = 0.05
    seen = []
    for _ in range(5000):
        data.qfrc_applied[stand.dofs] = stand.effort(data.qpos[None], data.qvel[None])[0]
        data.qfrc_applied[arm] = -5.0 * data.qvel[arm]
        mujoco.mj_step(model, data)
        seen.append(data.qpos[model.joint("stand_roll").qposadr[0]])
    crossings = np.flatnonzero(np.diff(np.sign(seen)))
    rate = np.pi / (np.diff(crossings).mean() * 2e-4)
    inertia = model.dof_M0[stand.dofs[0]]
    assert rate == pytest.approx(np.sqrt(60.0 / inertia), rel=0.05)


def test_a_robot_on_it_moves_its_encoder_as_it_shakes():
    targets = np.where(np.arange(200) < 60, 0.3, 0.9)[:, None]
    stiff = HiddenEffect(effect="mount_compliance", values={"stiffness": 3e3, "damping_ratio": 0.5})
    plain, soft, hard = (
        run_hardware(spec(), [targets], rate=250.0, seed=0, hidden=hidden)[0].columns[
            "arm/position"
        ]
        for hidden in ((), (SOFT,), (stiff,))
    )
    assert np.abs(soft - plain).max() > 5 * np.abs(hard - plain).max() > 0


def test_no_encoder_sees_what_gives_way():
    targets = [np.full((50, 1), 0.3)]
    plain, soft = (
        run_hardware(spec(), targets, rate=250.0, seed=0, hidden=hidden)[0]
        for hidden in ((), (SOFT,))
    )
    assert soft.columns.keys() == plain.columns.keys()


def test_only_a_robot_of_one_body_on_the_world_has_one():
    floating = spec(
        ARM.format(base='<body name="trunk"><freejoint/><geom size=".1"/>', end="</body>")
    )
    assert not can_be_mounted(floating)
    with pytest.raises(InputError, match="does not float, with one body on the world"):
        mounted(floating)
    with pytest.raises(InputError, match="give its file or its spec"):
        run_hardware(spec().compile(), [np.full((50, 1), 0.3)], rate=250.0, seed=0, hidden=[SOFT])


def test_is_drawn_with_a_frequency_that_stands_have():
    rng = np.random.default_rng(0)
    drawn = draw_hidden(spec(), rng, ["mount_compliance"])
    model = mounted(spec())
    inertia = max(model.dof_M0[model.joint(name).dofadr[0]] for name in HINGES)
    assert 5 <= np.sqrt(drawn.value("stiffness") / inertia) / (2 * np.pi) <= 12
    with pytest.raises(InputError, match="can have none"):
        draw_hidden(spec().compile(), rng, ["mount_compliance"])
