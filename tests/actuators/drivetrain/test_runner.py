"""Laws around actuators: the same joint in a walker, in a batch and in the gap's replay."""

import mujoco
import numpy as np
import pytest
from dm_control import composer, mjcf
from mujoco.batch import Batch

from walkerkit.actuators import (
    ActuatorCmd,
    ActuatorGroup,
    BuiltinPositionActuatorCfg,
    IdealPdActuatorCfg,
    Randomization,
    XmlPositionActuatorCfg,
)
from walkerkit.actuators.drivetrain import (
    AsymmetricFriction,
    Cogging,
    LawRunner,
    PreslidingFriction,
    SetpointFilter,
    StribeckFriction,
    TorqueSpeedLimit,
)
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.trials import Trials
from walkerkit.walkers import LEG_XML, Leg, MjcfWalker

EVERY = {"joint_names_expr": (".*",)}
LAWS = (
    SetpointFilter(**EVERY, time_constant=0.01),
    TorqueSpeedLimit(**EVERY, saturation_effort=25.0, velocity_limit=15.0),
    StribeckFriction(**EVERY, breakaway=0.5, velocity=0.1),
    Cogging(joint_names_expr=("calf",), amplitude=0.3, periods=20.0),
    PreslidingFriction(joint_names_expr=("thigh",), bristle_stiffness=60.0),
)
STEPS = 400


def targets():
    time = 0.001 * np.arange(STEPS)
    home = np.array([0.0, 0.8, -1.6])
    return home + 0.3 * np.sign(np.sin(12 * time))[:, None] * np.array([1.0, -1.0, 0.7])


def legs_root():
    root = mjcf.from_path(str(LEG_XML))
    root.keyframe.key["home"].remove()
    return root


def started(physics):
    with physics.reset_context():
        physics.data.qpos[:] = targets()[0]


def run_one(cfg, laws, native=True, legacy_step=True):
    root = legs_root()
    if not native:
        for element in list(root.find_all("actuator")):
            element.remove()
    group, runner = ActuatorGroup(cfg), LawRunner(laws)
    group.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    physics.legacy_step = legacy_step
    started(physics)
    group.initialize(physics)
    runner.initialize(group)
    group.reset()
    runner.reset()
    path = []
    for target in targets():
        runner.apply(ActuatorCmd(position_target=target))
        physics.step()
        path.append(physics.data.qpos.copy())
    return np.array(path)


def test_a_walker_moves_as_the_replay_says():
    robot = load_robot(LEG_XML)
    time = 0.001 * np.arange(STEPS + 1)
    columns = {}
    for k, joint in enumerate(robot.joints):
        asked = targets()[:, k]
        columns[f"{joint}/position_target"] = np.append(asked, asked[-1])
        columns[f"{joint}/position"] = np.full(STEPS + 1, asked[0])
    log = Recording(name="log", time=time, columns=columns)
    channels = [Channel(joint=joint, signal="position") for joint in robot.joints]
    trials = Trials(robot, 1)
    for law in LAWS:
        for joint in robot.joints:
            if law.joint_names_expr[0] in (".*", joint):
                for name, (value,) in law.numbers((joint,)).items():
                    trials.law(type(law), joint)[name][:] = value
    predicted = Replay(robot, whole(log), channels, n_threads=1).predict(trials)[0]
    cfg = XmlPositionActuatorCfg(**EVERY)
    alone = run_one(cfg, LAWS, legacy_step=False)
    np.testing.assert_allclose(alone, predicted[1:], atol=1e-9)
    moved = np.abs(alone - run_one(cfg, ())).max()
    assert moved > 0.02
    # dm_control's own order of half steps takes up dry friction one step late.
    assert np.abs(run_one(cfg, LAWS) - alone).max() < 0.03 * moved


class Commanded(composer.NullTask):
    """Passes actions to the walker, as dm_control's locomotion tasks do."""

    def before_step(self, physics, action, random_state):
        self.root_entity.apply_action(physics, action, random_state)


def test_a_composer_walker_moves_like_the_bare_physics_in_every_episode():
    walker = MjcfWalker.from_file(LEG_XML, XmlPositionActuatorCfg(**EVERY), laws=LAWS)
    environment = composer.Environment(Commanded(walker), random_state=0)
    environment.task.set_timesteps(physics_timestep=0.001, control_timestep=0.001)
    alone = run_one(XmlPositionActuatorCfg(**EVERY), LAWS)
    for _ in range(2):
        environment.reset()
        np.testing.assert_array_equal(environment.physics.data.qpos, targets()[0])
        path = []
        for target in targets():
            asked = walker.drivetrain.action_for(ActuatorCmd(position_target=target))
            environment.step(asked)
            path.append(environment.physics.data.qpos.copy())
        np.testing.assert_allclose(np.array(path), alone, atol=1e-9)


@pytest.mark.parametrize("native", [True, False])
def test_a_batch_is_one_physics_many_times(native):
    gains = {"stiffness": 60.0, "damping": 1.5, "effort_limit": 30.0}
    cfg = (BuiltinPositionActuatorCfg if native else IdealPdActuatorCfg)(**EVERY, **gains)
    root = legs_root()
    for element in list(root.find_all("actuator")):
        element.remove()
    group, runner = ActuatorGroup(cfg), LawRunner(LAWS)
    group.edit_mjcf(root)
    model = mujoco.MjModel.from_xml_string(root.to_xml_string())
    batch = Batch(model, 3, 1)
    batch.qpos[:] = targets()[0]
    group.initialize(batch)
    runner.initialize(group)
    group.reset()
    runner.reset()
    path = []
    for target in targets():
        runner.apply(ActuatorCmd(position_target=np.tile(target, (3, 1))))
        batch.step()
        path.append(batch.qpos.copy())
    alone = run_one(cfg, LAWS, native=False, legacy_step=False)
    np.testing.assert_array_equal(np.array(path), np.repeat(alone[:, None], 3, axis=1))


def test_randomized_friction_is_kept_beside_the_laws():
    laws = (AsymmetricFriction(**EVERY, forward=0.2, backward=0.2),)
    friction = Randomization(parameter="frictionloss", range=(0.3, 0.3), operation="abs")
    walker = MjcfWalker.from_file(
        LEG_XML, XmlPositionActuatorCfg(**EVERY), laws=laws, randomizations=(friction,)
    )
    environment = composer.Environment(
        composer.NullTask(walker), random_state=0, recompile_mjcf_every_episode=False
    )
    for _ in range(3):
        environment.reset()
        for _ in range(3):
            environment.step(np.zeros(environment.action_spec().shape))
        np.testing.assert_allclose(environment.physics.model.dof_frictionloss, 0.5, rtol=1e-12)


def test_a_law_twice_on_one_joint_is_refused():
    law = Cogging(joint_names_expr=("calf",), amplitude=0.3, periods=20.0)
    with pytest.raises(ValueError, match="'calf' has cogging twice"):
        run_one(XmlPositionActuatorCfg(**EVERY), (law, law))


def test_an_expression_that_matches_nothing_is_refused():
    law = Cogging(joint_names_expr=("calv",), amplitude=0.3, periods=20.0)
    with pytest.raises(ValueError, match="did you mean 'calf'"):
        run_one(XmlPositionActuatorCfg(**EVERY), (law,))


def test_leg_is_a_walker():
    assert isinstance(Leg(), MjcfWalker)
