from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from dm_control import suite as dm_suite

from walkerkit.actuators import (
    BuiltinPositionActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
)
from walkerkit.actuators.drivetrain import TorqueSpeedLimit
from walkerkit.actuators.randomization import Randomization
from walkerkit.tasks import JointEffortAction, JointPositionAction, suite

STEPS = 80
MOTORS = (
    ("walker", "walk"),
    ("walker", "stand"),
    ("cheetah", "run"),
    ("humanoid", "walk"),
    ("humanoid", "run_pure_state"),
    ("hopper", "hop"),
    ("hopper", "stand"),
    ("cartpole", "swingup"),
    ("cartpole", "balance"),
    ("cartpole", "three_poles"),
)
BESIDE = (
    ("quadruped", "run", ("(pitch|knee|ankle)_.*",)),
    ("quadruped", "fetch", ("ankle_.*",)),
    ("walker", "run", ("root[xyz]",)),
    ("cheetah", "run", ("rooty",)),
    ("cartpole", "two_poles", ("hinge_.",)),
    ("hopper", "stand", ("rooty",)),
)


def idle(*joints: str) -> IdealPdActuatorCfg:
    """Runs in Python before every physics step, and passes on the effort that it is asked for."""
    return IdealPdActuatorCfg(joint_names_expr=joints, stiffness=0.0, damping=0.0)


def same_episode(theirs: Any, ours: Any, seed: int) -> None:
    rng = np.random.default_rng(seed)
    spec = theirs.action_spec()
    expected, got = theirs.reset(), ours.reset()
    for step in range(STEPS + 1):
        assert got.reward == expected.reward, step
        assert got.step_type == expected.step_type
        assert got.observation.keys() == expected.observation.keys()
        for name, value in expected.observation.items():
            np.testing.assert_array_equal(got.observation[name], value, err_msg=f"{name} at {step}")
        for field in ("qpos", "qvel", "time"):
            np.testing.assert_array_equal(
                getattr(ours.physics.data, field), getattr(theirs.physics.data, field)
            )
        action = rng.uniform(spec.minimum, spec.maximum)
        expected, got = theirs.step(action), ours.step(action)


@pytest.mark.parametrize(("domain", "task"), MOTORS)
def test_a_law_that_does_nothing_is_the_suite_bit_for_bit(domain: str, task: str) -> None:
    theirs = dm_suite.load(domain, task, {"random": 7})
    model = theirs.physics.model
    joints = [model.id2name(i, "joint") for i in model.actuator_trnid[:, 0]]
    # One term each, so that the action has the suite's order, which need not be the kinematic one.
    efforts = [
        JointEffortAction(joint_names_expr=(joint,), scale=gear)
        for joint, gear in zip(joints, model.actuator_gear[:, 0].tolist(), strict=True)
    ]
    ours = suite.load(domain, task, idle(*joints), action=efforts, task_kwargs={"random": 7})
    assert ours.action_spec().name.split("\t") == joints
    for episode in range(2):
        same_episode(theirs, ours, seed=episode)
    applied = ours.physics.drivetrain.group.applied_effort
    assert np.abs(applied).max() > 0


@pytest.mark.parametrize(("domain", "task", "joints"), BESIDE)
def test_laws_beside_the_suite_s_own_actuators(
    domain: str, task: str, joints: tuple[str, ...]
) -> None:
    theirs = dm_suite.load(domain, task, {"random": 7})
    ours = suite.load(
        domain, task, idle(*joints), action=(), existing="keep", task_kwargs={"random": 7}
    )
    np.testing.assert_array_equal(ours.action_spec().minimum, theirs.action_spec().minimum)
    np.testing.assert_array_equal(ours.action_spec().maximum, theirs.action_spec().maximum)
    same_episode(theirs, ours, seed=0)


def test_a_drivetrain_law_that_does_nothing_is_the_suite_bit_for_bit() -> None:
    theirs = dm_suite.load("cartpole", "balance", {"random": 7})
    never = TorqueSpeedLimit(
        joint_names_expr=("slider",), saturation_effort=1e6, velocity_limit=1e6
    )
    push = JointEffortAction(joint_names_expr=("slider",), scale=10.0)
    options: dict[str, Any] = {"action": push, "task_kwargs": {"random": 7}}
    same_episode(
        theirs, suite.load("cartpole", "balance", idle("slider"), laws=(never,), **options), seed=0
    )
    weak = TorqueSpeedLimit(joint_names_expr=("slider",), saturation_effort=2.0, velocity_limit=5.0)
    ours = suite.load("cartpole", "balance", idle("slider"), laws=(weak,), **options)
    theirs = dm_suite.load("cartpole", "balance", {"random": 7})
    speeds = []
    for environment in (theirs, ours):
        environment.reset()
        for _ in range(20):
            environment.step([1.0])
        speeds.append(float(environment.physics.velocity()[0]))
    assert 0 < speeds[1] < 0.5 * speeds[0]


def test_without_actuators_it_is_the_suite_s_environment() -> None:
    theirs = dm_suite.load("walker", "walk", {"random": 3})
    ours = suite.load("walker", "walk", task_kwargs={"random": 3})
    assert type(ours.physics) is type(theirs.physics)
    same_episode(theirs, ours, seed=0)


def test_laws_run_before_every_physics_step(monkeypatch: pytest.MonkeyPatch) -> None:
    environment = suite.load("walker", "walk", idle(".*_knee"), task_kwargs={"random": 0})
    environment.reset()
    ran: list[float] = []
    group = environment.physics.drivetrain.group
    apply = group.apply
    monkeypatch.setattr(
        group, "apply", lambda cmd: (ran.append(environment.physics.time()), apply(cmd))
    )
    environment.step(np.zeros(environment.action_spec().shape))
    assert ran == pytest.approx(np.arange(10) * 0.0025)


KNEES = DcMotorActuatorCfg(
    joint_names_expr=(".*_knee",),
    stiffness=60.0,
    damping=2.0,
    effort_limit=40.0,
    saturation_effort=60.0,
    velocity_limit=20.0,
)


def test_explicit_actuators_of_some_joints_and_the_suite_s_motors_of_the_others() -> None:
    environment = suite.load(
        "walker",
        "walk",
        KNEES,
        action=JointPositionAction(joint_names_expr=(".*_knee",), scale=0.5, offset=-0.6),
        default={"right_knee": -0.1, "left_knee": -0.1},
        task_kwargs={"random": 0},
    )
    assert environment.action_spec().name.split("\t") == [
        "right_knee",
        "left_knee",
        "right_hip",
        "right_ankle",
        "left_hip",
        "left_ankle",
    ]
    environment.reset()
    for _ in range(40):
        environment.step([0.2, -0.4, 0.0, 0.0, 0.0, 0.0])
    command = environment.physics.drivetrain.command
    np.testing.assert_allclose(command.position_target, [-0.6, -0.9])
    applied = environment.physics.drivetrain.group.applied_effort
    named = environment.physics.named.data
    np.testing.assert_array_equal(named.qfrc_actuator[["right_knee", "left_knee"]], applied)
    assert (np.abs(applied) > 0).all()
    assert (np.abs(applied) <= 40.0).all()
    np.testing.assert_array_equal(named.ctrl[["right_hip", "left_ankle"]], [0.0, 0.0])
    np.testing.assert_array_equal(environment.physics.control(), [0.2, -0.4, 0, 0, 0, 0])


def test_native_actuators() -> None:
    servo = BuiltinPositionActuatorCfg(
        joint_names_expr=(".*_knee",), stiffness=80.0, damping=4.0, effort_limit=60.0
    )
    environment = suite.load("walker", "stand", servo, task_kwargs={"random": 0})
    environment.reset()
    timestep = environment.step(np.zeros(environment.action_spec().shape))
    assert 0 <= timestep.reward <= 1


def test_no_state_survives_a_reset() -> None:
    late = DelayedActuatorCfg(
        base_cfg=KNEES, delay_target="position", delay_min_lag=2, delay_max_lag=6
    )
    weak = Randomization(parameter="strength", range=(0.5, 1.0))

    def rewards(before: int) -> list[float]:
        environment = suite.load("walker", "walk", late, randomizations=(weak,))
        for _ in range(before):
            environment.reset()
            for _ in range(5):
                environment.step(np.ones(6))
        environment.task._random = np.random.RandomState(11)
        environment.reset()
        np.testing.assert_array_equal(environment.physics.control(), np.zeros(6))
        return [environment.step(np.full(6, 0.3)).reward for _ in range(10)]

    assert rewards(0) == rewards(3)


def test_seeds_are_reproducible_and_differ() -> None:
    weak = Randomization(parameter="strength", range=(0.5, 1.0))

    def strengths(seed: int) -> list[np.ndarray]:
        environment = suite.load(
            "walker", "walk", KNEES, randomizations=(weak,), task_kwargs={"random": seed}
        )
        drawn = []
        for _ in range(3):
            environment.reset()
            drawn.append(environment.physics.drivetrain.group.actuators[0].get("strength"))
        return drawn

    first = strengths(0)
    np.testing.assert_array_equal(first, strengths(0))
    assert not np.array_equal(first, strengths(1))
    assert not np.array_equal(first[0], first[1])


def test_randomization_leaves_the_draws_of_the_task_alone() -> None:
    weak = Randomization(parameter="strength", range=(0.5, 1.0))
    plain = suite.load("walker", "walk", KNEES, task_kwargs={"random": 5})
    random = suite.load("walker", "walk", KNEES, randomizations=(weak,), task_kwargs={"random": 5})
    for _ in range(3):
        expected, got = plain.reset().observation, random.reset().observation
        np.testing.assert_array_equal(got["orientations"], expected["orientations"])


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.full(6, np.nan), r"the action is nan for 'right_knee'"),
        (np.zeros(5), r"the action has shape \(5,\), the walker takes \(6,\)"),
    ],
)
def test_bad_actions_are_refused(action: np.ndarray, message: str) -> None:
    environment = suite.load("walker", "walk", KNEES, task_kwargs={"random": 0})
    environment.reset()
    with pytest.raises(ValueError, match=message):
        environment.step(action)


def test_actions_out_of_range_are_clipped() -> None:
    environments = [suite.load("walker", "walk", KNEES, task_kwargs={"random": 0}) for _ in "ab"]
    for environment, size in zip(environments, (1.0, 7.0), strict=True):
        environment.reset()
        for _ in range(5):
            environment.step(np.full(6, size))
    first, second = (environment.physics.state() for environment in environments)
    np.testing.assert_array_equal(first, second)


def test_copies_have_no_actuators() -> None:
    physics = suite.load("walker", "walk", KNEES).physics
    with pytest.raises(RuntimeError, match="this ActuatedPhysics has no actuators: they stay with"):
        physics.copy().step()


@pytest.mark.parametrize(
    ("domain", "task", "message"),
    [
        ("walkr", "walk", r"no domain 'walkr' \(did you mean 'walker'"),
        ("walker", "wlak", r"domain 'walker' has no task 'wlak' \(did you mean 'walk'"),
        ("walkerkit_quadruped", "run", r"it has 'stand', 'walk'"),
    ],
)
def test_unknown_names(domain: str, task: str, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        suite.load(domain, task)


@pytest.mark.parametrize(
    ("domain", "reason"),
    [
        ("humanoid_CMU", r"PyMJCF cannot write its file back; use with_actuators\("),
        ("dog", "its task asks every actuator for an activation state"),
    ],
)
def test_domains_that_take_no_actuators_say_why(domain: str, reason: str) -> None:
    with pytest.raises(ValueError, match=f"domain '{domain}' takes no actuators of ours: {reason}"):
        suite.load(domain, "stand", KNEES)


def test_arguments_of_no_use_are_refused() -> None:
    with pytest.raises(ValueError, match="existing is of no use with actuators=None"):
        suite.load("walker", "walk", existing="keep")
    with pytest.raises(ValueError, match="default is of no use with domain 'walkerkit_biped'"):
        suite.load("walkerkit_biped", "stand", default={})


@pytest.mark.parametrize("domain", ["walkerkit_quadruped", "walkerkit_biped"])
@pytest.mark.parametrize("task", ["stand", "walk"])
def test_our_domains(domain: str, task: str) -> None:
    environment = suite.load(domain, task, task_kwargs={"random": 0, "time_limit": 0.2})
    timestep = environment.reset()
    n = 0
    while not timestep.last():
        timestep = environment.step(environment.task.walker.action_for())
        assert 0 <= timestep.reward <= 1
        n += 1
    assert n == 10
    assert environment.task.fallen == ()
    assert timestep.discount == 1.0


def test_visualize_reward_and_environment_arguments_reach_the_suite() -> None:
    environment = suite.load(
        "walker",
        "walk",
        KNEES,
        task_kwargs={"random": 0, "time_limit": 0.1},
        environment_kwargs={"flat_observation": True},
        visualize_reward=True,
    )
    timestep = environment.reset()
    assert list(timestep.observation) == ["observations"]
    for _ in range(4):
        timestep = environment.step(np.zeros(6))
    assert timestep.last()
    assert environment.task.visualize_reward
