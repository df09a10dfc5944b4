"""What makes a walker own its actuators: which it gets and keeps, and what an action does."""

from __future__ import annotations

import numpy as np
import pytest
from dm_control import composer

from tests.walkers.robots import (
    DELAYED,
    DOG,
    DOG_HOME,
    DOG_JOINTS,
    EXPLICIT,
    KD,
    KP,
    MIXED,
    NATIVE,
    Drive,
    dog,
    go_to_target_task,
    without_camera,
    write,
)
from walkerkit.actuators import (
    ActuatorCmd,
    BuiltinMotorActuatorCfg,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    LearnedMlpActuatorCfg,
    LstmActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
)
from walkerkit.actuators.builtin_dc_motor import BuiltinDcMotorActuatorCfg
from walkerkit.actuators.drivetrain.controller import IntegralAction, SetpointFilter
from walkerkit.actuators.drivetrain.drive_stage import ActuatorLag, StrengthDrift
from walkerkit.actuators.drivetrain.joint_friction import LoadDependentFriction, PreslidingFriction
from walkerkit.actuators.networks.lstm import Lstm
from walkerkit.actuators.networks.mlp import Mlp
from walkerkit.actuators.randomization import Randomization
from walkerkit.walkers import LEG_XML, MjcfWalker

ALL = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=KP, damping=KD)


def started(walker, **options):
    environment = composer.Environment(Drive(walker), random_state=0, **options)
    environment.reset()
    return environment


def names_of(elements):
    return [element.name for element in elements]


class TestExisting:
    def test_kept_where_no_config_claims_the_joint(self, tmp_path):
        walker = dog(tmp_path, actuators=(EXPLICIT, DELAYED))
        root = walker.mjcf_model
        assert walker.actuator_group.joint_names == ("fl_hip", "fr_hip", "rl_hip", "rr_hip")
        assert names_of(walker.actuators[4:]) == ["rl_knee", "rr_knee"]
        assert root.find("sensor", "knee_force") is not None
        spec = walker.action_spec
        assert spec.name.split("\t")[4:] == ["rl_knee", "rr_knee"]
        np.testing.assert_array_equal(spec.minimum[4:], [-2, -1])
        np.testing.assert_array_equal(spec.maximum[4:], [0, 1])

    def test_replaced_with_what_measured_them(self, tmp_path):
        walker = dog(tmp_path, actuators=ALL)
        root = walker.mjcf_model
        assert root.find("actuator", "rl_knee").joint.name == "rl_knee"
        assert len(walker.actuators) == len(root.find_all("actuator")) == 8
        assert root.find("sensor", "knee_force") is None
        assert walker.action_spec.shape == (8,)
        environment = started(walker)
        assert environment.physics.model.nu == 8
        environment.step([np.zeros(8)])

    def test_two_on_one_joint_are_both_replaced(self, tmp_path):
        text = DOG.replace("<motor name", '<motor name="more" joint="rl_knee"/><motor name')
        walker = MjcfWalker.from_file(write(tmp_path, text), ALL)
        assert started(walker).physics.model.nu == 8

    def test_a_second_actuator_is_refused_where_they_are_kept(self, tmp_path):
        with pytest.raises(ValueError, match=r"'rl_knee' already has the actuator.*Xml… config"):
            dog(tmp_path, actuators=ALL, existing="keep")

    def test_wrapped(self, tmp_path):
        wrapped = (
            XmlPositionActuatorCfg(joint_names_expr=("rl_knee",)),
            XmlMotorActuatorCfg(joint_names_expr=("rr_knee",)),
        )
        walker = dog(tmp_path, actuators=(*MIXED, *wrapped))
        assert walker.actuator_group.joint_names == DOG_JOINTS
        assert walker.mjcf_model.find("sensor", "knee_force") is not None
        assert len(walker.actuators) == 8
        environment = started(walker)
        environment.step([walker.action_for()])
        bound = environment.physics.bind(walker.actuators)
        assert bound.ctrl[5] == DOG_HOME[5]
        cmd = ActuatorCmd(position_target=DOG_HOME, effort_target=np.eye(8)[7] * 5)
        walker.command = cmd
        walker.before_substep(environment.physics, None)
        assert environment.physics.bind(walker.actuators).ctrl[7] == 5 / 20

    @pytest.mark.parametrize("existing", ["replace", "keep"])
    def test_a_wrapped_one_is_not_replaced(self, tmp_path, existing):
        cfg = XmlPositionActuatorCfg(joint_names_expr=("rl_knee",))
        walker = dog(tmp_path, actuators=(EXPLICIT, cfg), existing=existing)
        assert [e.name for e in walker.actuator_group.elements][2:] == ["rl_knee"]

    def test_a_delayed_one_replaces_as_well(self, tmp_path):
        base = BuiltinPositionActuatorCfg(joint_names_expr=("r._knee",), stiffness=30, damping=0.5)
        walker = dog(tmp_path, actuators=DelayedActuatorCfg(base_cfg=base, delay_max_lag=2))
        assert len(walker.actuators) == 2
        started(walker).step([np.zeros(2)])

    def test_an_unnamed_one_goes_by_what_it_drives(self, tmp_path):
        text = DOG.replace('name="rl_knee" joint', "joint").replace('name="rr_knee" joint', "joint")
        text = text.replace(
            'actuatorfrc name="knee_force" actuator="rl_knee"', 'jointpos joint="rl_knee"'
        )
        walker = MjcfWalker.from_file(write(tmp_path, text), EXPLICIT)
        assert walker.action_spec.name.split("\t")[2:] == ["rl_knee", "rr_knee"]
        environment = started(walker)
        with pytest.raises(ValueError, match="nan for 'rr_knee'"):
            environment.step([[0, 0, 0, np.nan]])

    def test_tendons_and_muscles_are_kept(self, tmp_path):
        text = DOG.replace(
            "<actuator>",
            """<tendon><fixed name="knees"><joint joint="fl_knee" coef="1"/>
            <joint joint="fr_knee" coef="-1"/></fixed></tendon><actuator>
            <muscle name="bend" tendon="knees" lengthrange="-2 2"/>""",
        )
        walker = MjcfWalker.from_file(write(tmp_path, text), (EXPLICIT, DELAYED))
        assert names_of(walker.actuators[4:]) == ["bend", "rl_knee", "rr_knee"]
        np.testing.assert_array_equal(walker.action_spec.minimum[4:], [-1, -2, -1])
        environment = started(walker)
        environment.step([np.array([0, 0, 0, 0, 0.7, -1, 0.5])])
        physics = environment.physics
        assert physics.bind(walker.mjcf_model.find("actuator", "bend")).ctrl == 0.7
        assert physics.data.act[0] > 0

    def test_a_tendon_can_be_driven(self, tmp_path):
        text = DOG.replace(
            "<actuator>",
            """<tendon><fixed name="knees"><joint joint="fl_knee" coef="1"/>
            <joint joint="fr_knee" coef="-1"/></fixed></tendon><actuator>
            <motor name="old" tendon="knees"/>""",
        )
        cfg = IdealPdActuatorCfg(
            joint_names_expr=("knees",), transmission="tendon", stiffness=5.0, damping=0.1
        )
        walker = MjcfWalker.from_file(write(tmp_path, text), (EXPLICIT, cfg))
        assert walker.actuator_group.joint_names == ("fl_hip", "fr_hip", "knees")
        assert walker.mjcf_model.find("actuator", "old") is None
        environment = started(walker)
        walker.command = ActuatorCmd(position_target=np.array([0.4, 0.4, 0.3]))
        walker.before_substep(environment.physics, None)
        assert environment.physics.bind(walker.actuator_group.elements[2]).ctrl == 5.0 * 0.3


class TestAction:
    @pytest.fixture
    def environment(self, tmp_path):
        return started(dog(tmp_path))

    @pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
    @pytest.mark.parametrize(("column", "name"), [(0, "fl_hip"), (6, "rl_knee")])
    def test_must_be_finite(self, environment, value, column, name):
        (walker,) = environment.task.walkers
        environment.step([np.full(8, 0.1)])
        before = walker.command, walker.prev_action, environment.physics.data.ctrl.copy()
        action = np.zeros(8)
        action[column] = value
        with pytest.raises(
            ValueError, match=rf"the action is {value} for '{name}': check the policy"
        ):
            environment.step([action])
        assert walker.command is before[0]
        np.testing.assert_array_equal(walker.prev_action, before[1])
        np.testing.assert_array_equal(environment.physics.data.ctrl, before[2])

    @pytest.mark.parametrize("shape", [(7,), (9,), (0,), (), (1, 8), (8, 1)])
    def test_must_have_its_size(self, environment, shape):
        with pytest.raises(
            ValueError, match=r"the walker takes \(8,\): one number for each of.*fl_hip"
        ):
            environment.step([np.zeros(shape)])

    def test_is_clipped(self, environment):
        (walker,) = environment.task.walkers
        beyond = np.array([9, -9, 1e300, -1e300, 2, -2, 5, -7.0])
        environment.step([beyond])
        at_limits = walker.command.position_target.copy()
        kept = environment.physics.bind(walker.actuators[6:]).ctrl.copy()
        environment.step([np.clip(beyond, walker.action_spec.minimum, walker.action_spec.maximum)])
        np.testing.assert_array_equal(walker.command.position_target, at_limits)
        np.testing.assert_array_equal(environment.physics.bind(walker.actuators[6:]).ctrl, kept)
        np.testing.assert_array_equal(kept, [0, -1])
        names = walker.actuator_group.joint_names
        ranges = {"hip": (-1, 1), "knee": (-2, 0)}
        for name, target in zip(names, at_limits, strict=True):
            assert target in ranges[name.split("_")[1]]

    def test_spans_the_joints_ranges(self, environment):
        (walker,) = environment.task.walkers
        for value, ends in ((-1, (-1, -2)), (0, (0, -1)), (1, (1, 0))):
            environment.step([np.full(8, float(value))])
            wanted = [ends[name.endswith("knee")] for name in walker.actuator_group.joint_names]
            np.testing.assert_allclose(walker.command.position_target, wanted, atol=1e-15)

    @pytest.mark.parametrize("kind", [np.float32, np.int64, list])
    def test_may_be_of_any_kind_of_numbers(self, environment, kind):
        (walker,) = environment.task.walkers
        action = [0] * 8 if kind is list else np.zeros(8, dtype=kind)
        environment.step([action])
        assert walker.prev_action.dtype == np.float64

    def test_is_copied(self, environment):
        (walker,) = environment.task.walkers
        action = np.full(8, 0.25)
        environment.step([action])
        command = walker.command.position_target.copy()
        action[:] = -1.0
        np.testing.assert_array_equal(walker.prev_action, np.full(8, 0.25))
        np.testing.assert_array_equal(walker.command.position_target, command)
        with pytest.raises(ValueError, match="read-only"):
            walker.prev_action[0] = 1.0

    def test_comes_after_compilation(self, tmp_path):
        with pytest.raises(RuntimeError, match="call initialize"):
            dog(tmp_path).apply_action(None, np.zeros(8), None)

    def test_holds_until_the_next(self, environment):
        (walker,) = environment.task.walkers
        environment.step([np.full(8, 0.3)])
        command = walker.command
        for _ in range(3):
            walker.before_substep(environment.physics, None)
            environment.physics.step()
            assert walker.command is command

    def test_action_for_is_its_inverse(self, environment):
        (walker,) = environment.task.walkers
        action = np.linspace(-0.9, 0.9, 8)
        environment.step([action])
        np.testing.assert_allclose(walker.action_for(walker.command)[:6], action[:6], atol=1e-15)
        np.testing.assert_array_equal(walker.action_for()[6:], 0.0)

    def test_goes_by_the_order_of_the_model(self, tmp_path):
        """In which dm_control's tasks describe it."""
        walker = dog(tmp_path)
        environment = composer.Environment(go_to_target_task(walker), random_state=0)
        described = environment.action_spec()
        assert described.shape == walker.action_spec.shape
        assert described.name.replace("dog/", "") == walker.action_spec.name
        model = environment.physics.model
        names = [model.id2name(i, "actuator") for i in range(model.nu)]
        assert names == [element.full_identifier for element in walker.actuators]


class TestCommand:
    def test_of_another_size_is_refused(self, tmp_path):
        walker = dog(tmp_path)
        environment = started(walker)
        walker.command = ActuatorCmd(position_target=np.zeros(8))
        with pytest.raises(ValueError, match=r"shape \(8,\), the robot takes \(6,\)"):
            walker.before_substep(environment.physics, None)

    def test_of_another_type_is_refused(self, tmp_path):
        walker = dog(tmp_path)
        with pytest.raises(TypeError, match="command should be an ActuatorCmd"):
            walker.command = np.zeros(6)

    def test_works_before_the_first_reset(self, tmp_path):
        walker = dog(tmp_path)
        assert walker.prev_action.shape == (8,)
        np.testing.assert_array_equal(
            walker.command.position_target,
            [
                dict(zip(DOG_JOINTS, DOG_HOME, strict=True))[n]
                for n in walker.actuator_group.joint_names
            ],
        )


def network(folder, kind):
    rng = np.random.default_rng(3)
    motor = {"saturation_effort": 9.0, "velocity_limit": 20.0, "effort_limit": 5.0}
    motor |= {"pos_scale": 1.0, "vel_scale": 1.0, "torque_scale": 1.0}
    path = folder / f"{kind}.npz"
    if kind == "mlp":
        Mlp(
            weights=[rng.standard_normal((8, 6)), rng.standard_normal((1, 8))],
            biases=[np.zeros(8), np.zeros(1)],
            activations=["tanh", "identity"],
        ).save(path)
        return LearnedMlpActuatorCfg(
            joint_names_expr=(".*_hip",), network_file=path, history_length=3, **motor
        )
    Lstm(
        weights_ih=[rng.standard_normal((16, 2))],
        weights_hh=[rng.standard_normal((16, 4))],
        biases_ih=[np.zeros(16)],
        biases_hh=[np.zeros(16)],
        head_weight=rng.standard_normal((1, 4)),
        head_bias=np.zeros(1),
    ).save(path)
    return LstmActuatorCfg(joint_names_expr=(".*_hip",), network_file=path, **motor)


HIPS = {"joint_names_expr": (".*_hip",), "stiffness": 30.0, "damping": 0.5}
STATEFUL = {
    "mlp": lambda folder: network(folder, "mlp"),
    "lstm": lambda folder: network(folder, "lstm"),
    "wandering delay": lambda _: DelayedActuatorCfg(
        base_cfg=IdealPdActuatorCfg(**HIPS), delay_max_lag=5, delay_hold_prob=0.6
    ),
    "delay in MuJoCo": lambda _: DelayedActuatorCfg(
        base_cfg=BuiltinPositionActuatorCfg(**HIPS), delay_min_lag=3, delay_max_lag=3
    ),
    "winding and heat": lambda _: BuiltinDcMotorActuatorCfg(
        **HIPS,
        input="position",
        torque_constant=0.1,
        resistance=0.5,
        gear_ratio=9.0,
        inductance=1e-3,
        integral_gain=3.0,
        slew_rate=5.0,
        thermal_resistance=2.0,
        thermal_time_constant=0.5,
    ),
    "native": lambda _: BuiltinPdActuatorCfg(**HIPS),
    "random gains": lambda _: IdealPdActuatorCfg(**HIPS),
    "drivetrain": lambda _: IdealPdActuatorCfg(**HIPS),
}
HIPS_ONLY = {"joint_names_expr": (".*_hip",)}
OPTIONS = {
    "random gains": {
        "randomizations": (
            Randomization(parameter="stiffness", range=(0.7, 1.3)),
            Randomization(parameter="strength", range=(0.5, 1.0)),
        )
    },
    "drivetrain": {
        "laws": (
            SetpointFilter(**HIPS_ONLY, time_constant=0.02),
            IntegralAction(**HIPS_ONLY, gain=5.0),
            ActuatorLag(**HIPS_ONLY, time_constant=0.01),
            StrengthDrift(**HIPS_ONLY, rate=0.5),
            PreslidingFriction(**HIPS_ONLY, bristle_stiffness=50.0),
            LoadDependentFriction(**HIPS_ONLY, coefficient=0.1),
        )
    },
}


@pytest.mark.parametrize("recompile", [True, False])
@pytest.mark.parametrize("case", STATEFUL)
def test_no_state_survives_two_resets(tmp_path, case, recompile):
    walker = dog(tmp_path, actuators=STATEFUL[case](tmp_path), **OPTIONS.get(case, {}))
    environment = started(walker, recompile_mjcf_every_episode=recompile)

    def episode(resets):
        random_state = np.random.RandomState(4)
        for _ in range(resets):
            environment.random_state.seed(3)
            environment.reset()
        rows = []
        for _ in range(12):
            environment.step([random_state.uniform(-1, 1, walker.action_spec.shape)])
            physics = environment.physics
            group = walker.actuator_group
            rows += [physics.data.qpos.copy(), physics.data.ctrl.copy(), physics.data.act.copy()]
            rows += [group.applied_effort, group.computed_effort, physics.data.qfrc_applied.copy()]
        return np.concatenate(rows)

    first = episode(1)
    assert np.ptp(first) > 0
    for resets in (1, 2, 3):
        np.testing.assert_array_equal(episode(resets), first)


class Spy:
    """A randomization that notes when it was called, and with what."""

    def __init__(self):
        self.calls = []

    def apply(self, actuators, random_state):
        self.calls.append((actuators, random_state))


def test_randomizations_are_applied_once_an_episode(tmp_path):
    spy = Spy()
    walker = dog(tmp_path, randomizations=(spy,))
    environment = composer.Environment(Drive(walker), random_state=0)
    assert spy.calls == []
    for episodes in (1, 2):
        environment.reset()
        environment.step([np.zeros(8)])
        assert spy.calls == [(walker.actuator_group, environment.random_state)] * episodes


def test_randomizations_start_from_the_nominal_value(tmp_path):
    walker = dog(
        tmp_path,
        randomizations=(
            Randomization(parameter="stiffness", range=(0.5, 0.5), joint_names_expr=("f._hip",)),
        ),
    )
    environment = composer.Environment(
        Drive(walker), random_state=0, recompile_mjcf_every_episode=False
    )
    for _ in range(3):
        environment.reset()
        explicit = walker.actuator_group.actuators[2]
        np.testing.assert_array_equal(explicit.get("stiffness"), KP / 2)


def test_velocity_and_effort_actuators(tmp_path):
    cfgs = (
        BuiltinVelocityActuatorCfg(joint_names_expr=("f._hip",), damping=0.5),
        BuiltinMotorActuatorCfg(joint_names_expr=("r._hip",), effort_limit=3.0),
        NATIVE,
    )
    walker = dog(tmp_path, actuators=cfgs)
    environment = started(walker)
    environment.step([np.full(8, 0.5)])
    command = walker.command
    names = walker.actuator_group.joint_names
    assert names == ("fl_hip", "fl_knee", "fr_hip", "fr_knee", "rl_hip", "rr_hip")
    np.testing.assert_array_equal(command.position_target, [0, -0.5, 0, -0.5, 0, 0])
    np.testing.assert_array_equal(command.velocity_target, [5, 0, 5, 0, 0, 0])
    np.testing.assert_array_equal(command.effort_target, [0, 0, 0, 0, 1.5, 1.5])


@pytest.mark.parametrize(
    ("cfgs", "text"),
    [
        ((EXPLICIT, EXPLICIT), r"'fl_hip', 'fr_hip' are claimed by .* and by"),
        (
            IdealPdActuatorCfg(joint_names_expr=("hop",), stiffness=1, damping=1),
            "'hop' matches none",
        ),
        (IdealPdActuatorCfg(joint_names_expr=("root",), stiffness=1, damping=1), "matches none"),
        ((), "actuators is empty"),
    ],
)
def test_errors_name_it(tmp_path, cfgs, text):
    with pytest.raises(ValueError, match=text):
        dog(tmp_path, actuators=cfgs)


def test_a_path_is_no_config(tmp_path):
    with pytest.raises(TypeError, match="actuators should be actuator configs, got"):
        dog(tmp_path, actuators=("motor",))


def test_observables_of_a_walker_without_position_targets(tmp_path):
    cfg = BuiltinMotorActuatorCfg(joint_names_expr=(".*_hip",), effort_limit=3.0)
    walker = dog(tmp_path, actuators=cfg)
    walker.observables.enable_all()
    without_camera(walker)
    environment = started(walker)
    seen = environment.step([np.full(6, 0.5)]).observation
    np.testing.assert_array_equal(seen["dog/position_target"], np.zeros((1, 4)))
    np.testing.assert_array_equal(seen["dog/effort_target"], np.full((1, 4), 1.5))


@pytest.mark.parametrize("native", [True, False])
def test_a_task_that_writes_controls_itself_does_not_reach_past_the_command(native):
    gains = {"joint_names_expr": (".*",), "stiffness": 30.0, "damping": 1.0}
    cfg = (BuiltinPositionActuatorCfg if native else IdealPdActuatorCfg)(**gains)
    walker = MjcfWalker.from_file(LEG_XML, cfg)
    environment = composer.Environment(composer.NullTask(walker), random_state=0)
    environment.reset()
    for _ in range(3):
        environment.step(np.full(environment.action_spec().shape, 7.0))
        assert np.abs(walker.actuator_group.applied_effort).max() < 20
        np.testing.assert_allclose(environment.physics.data.qpos, walker.home, atol=0.2)
