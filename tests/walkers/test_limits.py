"""Actions of ±1 ask for what robot files state, of robots that others wrote."""

from __future__ import annotations

from pathlib import Path

import gymnasium
import mujoco
import numpy as np
import pytest
from dm_control import composer, mjcf, suite
from dm_control.locomotion.arenas import floors
from dm_control.locomotion.tasks import go_to_target

from walkerkit.actuators import (
    BuiltinMotorActuatorCfg,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
    IdealPdActuatorCfg,
    XmlActuatorCfg,
    XmlMotorActuatorCfg,
)
from walkerkit.tasks import suite as our_suite
from walkerkit.tasks import with_bounds
from walkerkit.walkers import MjcfWalker

GYMNASIUM = Path(gymnasium.__file__).parent / "envs" / "mujoco" / "assets"
LEGS = """
<mujoco model="legs">{option}<worldbody><body name="trunk"><freejoint/><geom size="0.1" mass="5"/>
  <body name="a"><joint name="hip" axis="0 1 0" range="-60 60" {joint}/>
    <geom size="0.05" pos="0 0 -0.3" mass="1"/>
  <body name="b" pos="0 0 -0.3"><joint name="knee" axis="0 1 0"/>
    <geom size="0.05" pos="0 0 -0.3" mass="1"/></body></body></body></worldbody>
  <actuator>{actuators}</actuator></mujoco>
"""
EVERY = {"joint_names_expr": (".*",)}
PD = BuiltinPositionActuatorCfg(**EVERY, stiffness=20.0, damping=1.0)
MOTORS = '<motor joint="hip" ctrlrange="-23.7 23.7"/><motor joint="knee" ctrlrange="-45.43 45.43"/>'


def legs(tmp_path, cfgs=None, actuators=MOTORS, joint="", option="", **options):
    path = tmp_path / "legs.xml"
    path.write_text(LEGS.format(actuators=actuators, joint=joint, option=option))
    return MjcfWalker.from_file(path, cfgs, **options)


def efforts_at(walker, value):
    """Efforts on the joints that the walker drives under an action of this value everywhere."""
    physics = mjcf.Physics.from_mjcf_model(walker.mjcf_model)
    drivetrain = walker.drivetrain
    drivetrain.initialize(physics)
    drivetrain.reset(np.random.RandomState(0))
    drivetrain.act(np.full(walker.action_spec.shape, value))
    drivetrain.run()
    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    model = physics.model.ptr
    return physics.data.qfrc_actuator[model.jnt_dofadr[drivetrain.group.joint_ids]]


def as_far_as_they_go(walker, control):
    """The same with MuJoCo's own controls as far as they go."""
    physics = mjcf.Physics.from_mjcf_model(walker.mjcf_model)
    physics.data.ctrl[:] = control
    mujoco.mj_forward(physics.model.ptr, physics.data.ptr)
    walker.drivetrain.initialize(physics)
    dofs = physics.model.ptr.jnt_dofadr[walker.actuator_group.joint_ids]
    return physics.data.qfrc_actuator[dofs]


@pytest.mark.filterwarnings("ignore:.*settotalmass")
@pytest.mark.parametrize(
    "robot", ["ant", "half_cheetah", "hopper", "humanoid", "swimmer", "walker2d", "pusher"]
)
def test_of_gymnasium(robot):
    walker = MjcfWalker.from_file(GYMNASIUM / f"{robot}.xml")
    for value in (-1.0, 1.0):
        ours = efforts_at(walker, value)
        np.testing.assert_allclose(ours, as_far_as_they_go(walker, value * 1e9), rtol=0, atol=1e-9)
        assert np.abs(ours).min() > 0


def test_the_ant_has_its_150_newton_metres():
    walker = MjcfWalker.from_file(GYMNASIUM / "ant.xml")
    np.testing.assert_allclose(efforts_at(walker, 1.0), 150.0, rtol=0, atol=1e-9)
    assert walker.drivetrain.joints.efforts.tolist() == [150.0] * 8


def test_the_least_of_all_that_is_stated(tmp_path):
    walker = legs(tmp_path, joint='actuatorfrcrange="-20 20"')
    np.testing.assert_allclose(efforts_at(walker, 1.0), [20.0, 45.43], rtol=0, atol=1e-9)
    geared = '<motor joint="hip" gear="25" ctrlrange="-4.5 4.5"/><motor joint="knee"/>'
    walker = legs(tmp_path, actuators=geared)
    np.testing.assert_allclose(efforts_at(walker, -1.0), [-112.5, -1.0], rtol=0, atol=1e-9)


def test_an_actuator_without_limits_spans_what_the_one_before_it_could_do(tmp_path):
    walker = legs(tmp_path, BuiltinMotorActuatorCfg(**EVERY))
    np.testing.assert_allclose(efforts_at(walker, 1.0), [23.7, 45.43], rtol=0, atol=1e-9)
    # That is what an action spans, and no limit of the actuator.
    assert np.isinf(walker.drivetrain.joints.efforts).all()
    limited = BuiltinMotorActuatorCfg(**EVERY, effort_limit=7.0)
    np.testing.assert_allclose(efforts_at(legs(tmp_path, limited), 1.0), 7.0, rtol=0, atol=1e-9)
    wheels = '<velocity joint="hip" ctrlrange="-4 6"/><velocity joint="knee"/>'
    walker = legs(tmp_path, BuiltinVelocityActuatorCfg(**EVERY, damping=1.0), wheels)
    np.testing.assert_array_equal(
        walker.drivetrain.joints.reach["velocity_target"], [[-4, 6], [-np.inf, np.inf]]
    )


def test_of_a_suite_task():
    cfg = XmlMotorActuatorCfg(joint_names_expr=(".*_(hip|knee|ankle)",))
    ours = our_suite.load("walker", "walk", cfg, task_kwargs={"random": 0})
    theirs = suite.load("walker", "walk", task_kwargs={"random": 0})
    ours.reset(), theirs.reset()
    rng = np.random.default_rng(0)
    np.testing.assert_array_equal(ours.action_spec().maximum, theirs.action_spec().maximum)
    for _ in range(10):
        action = rng.uniform(-1, 1, 6)
        one, other = ours.step(action), theirs.step(action)
        assert one.reward == pytest.approx(other.reward, abs=1e-9)
        np.testing.assert_allclose(ours.physics.data.qpos, theirs.physics.data.qpos, atol=1e-9)


class TestIntegrator:
    """A file that says nothing gets the one that bears the damping that it is given."""

    @pytest.mark.parametrize(
        ("cfgs", "option", "integrator"),
        [
            (PD, "", "implicitfast"),
            (BuiltinPdActuatorCfg(**EVERY, stiffness=20.0, damping=1.0), "", "implicitfast"),
            (IdealPdActuatorCfg(**EVERY, stiffness=20.0, damping=0.1), "", "implicitfast"),
            (PD, '<option integrator="Euler"/>', None),
            (PD, '<option timestep="0.002"/>', "implicitfast"),
            (PD, '<!-- <option integrator="Euler"/> -->', "implicitfast"),
            (PD, '<option integrator="RK4"/>', "RK4"),
            (PD, "<option\n  timestep=\"0.002\"\n  integrator = 'implicit'/>", "implicit"),
            (BuiltinMotorActuatorCfg(**EVERY), "", None),
            (IdealPdActuatorCfg(**EVERY, stiffness=20.0, damping=0.0), "", None),
            (
                IdealPdActuatorCfg(**EVERY, stiffness=0.0, damping={"hip": 0.0, "knee": 0.1}),
                "",
                "implicitfast",
            ),
            (XmlActuatorCfg(**EVERY), "", None),
        ],
    )
    def test_of_a_file(self, tmp_path, cfgs, option, integrator):
        root = legs(tmp_path, cfgs, option=option).mjcf_model
        assert root.option.integrator == integrator

    def test_that_an_included_file_states(self, tmp_path):
        (tmp_path / "options.xml").write_text('<mujoco><option integrator="Euler"/></mujoco>')
        walker = legs(tmp_path, PD, option='<include file="options.xml"/>')
        assert walker.mjcf_model.option.integrator is None

    def test_of_a_suite_task(self):
        cfg = BuiltinPositionActuatorCfg(
            joint_names_expr=(".*_(hip|knee|ankle)",), stiffness=20.0, damping=1.0
        )
        environment = our_suite.load("walker", "walk", cfg)
        implicit = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        assert environment.physics.model.opt.integrator == implicit

    def test_is_that_of_the_arena(self, tmp_path):
        walker = legs(tmp_path, PD)
        task = go_to_target.GoToTarget(
            walker, floors.Floor(), physics_timestep=0.002, control_timestep=0.02
        )
        environment = composer.Environment(task, random_state=0)
        environment.reset()
        implicit = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        assert environment.physics.model.opt.integrator == implicit


class TestBounds:
    def task(self, tmp_path, walker=None):
        walker = walker or legs(tmp_path, PD)
        floor = floors.Floor()
        return walker, go_to_target.GoToTarget(
            walker, floor, physics_timestep=0.002, control_timestep=0.02
        )

    def test_make_an_action_spec_that_can_be_sampled(self, tmp_path):
        walker, task = self.task(tmp_path)
        unbounded = composer.Environment(task, random_state=0).action_spec()
        assert (unbounded.maximum > 1e9).all()
        assert with_bounds(task, walker) is task
        assert isinstance(task, go_to_target.GoToTarget)
        environment = composer.Environment(with_bounds(task, walker), random_state=0)
        spec = environment.action_spec()
        environment.reset()
        rng = np.random.default_rng(0)
        for _ in range(3):
            action = rng.uniform(spec.minimum, spec.maximum)
            spec.validate(action)
            environment.step(action)
        assert spec == walker.action_spec

    def test_of_what_is_not_there(self, tmp_path):
        walker, task = self.task(tmp_path)
        with pytest.raises(TypeError, match="task should be a composer task, got 3"):
            with_bounds(3, walker)
        with pytest.raises(TypeError, match=r"has no actuators of ours.*with_actuators"):
            with_bounds(task, floors.Floor())
        with pytest.raises(ValueError, match=r"MjcfWalker that is not in the GoToTarget"):
            with_bounds(task, legs(tmp_path, PD))


def test_a_config_that_finds_the_kind(tmp_path):
    every = XmlActuatorCfg(**EVERY)
    assert legs(tmp_path, every).actuator_group.takes == {"effort_target"}
    servos = '<position joint="hip" kp="5"/><position joint="knee" kp="5"/>'
    walker = legs(tmp_path, every, servos)
    assert walker.actuator_group.takes == {"position_target"}
    assert walker.actuator_group.actuators[0].nominal("stiffness").tolist() == [5.0, 5.0]
    mixed = '<position joint="hip" kp="5"/><velocity joint="knee" kv="5"/>'
    with pytest.raises(ValueError, match=r"several kinds.*XmlPosition.*'hip',.*XmlVelocity"):
        legs(tmp_path, every, mixed)
    with pytest.raises(ValueError, match="has a law that is not affine"):
        legs(tmp_path, every, '<motor joint="hip"/><muscle joint="knee" lengthrange="0.1 1"/>')
