import inspect

import numpy as np
import pytest
from dm_control import mjcf
from dm_control.composer.variation import distributions
from mujoco.batch import Batch

from walkerkit.actuators import (
    ActuatorGroup,
    BuiltinMotorActuatorCfg,
    BuiltinVelocityActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
)
from walkerkit.actuators.randomization import Randomization
from walkerkit.actuators.randomize import (
    randomize,
    randomize_armature,
    randomize_delay,
    randomize_effort_limits,
    randomize_friction,
    randomize_pd_gains,
    randomize_strength,
    randomize_viscous_damping,
)

XML = """
<mujoco>
  <worldbody>
    <body>
      <joint name="left_hip" axis="0 1 0" damping="0.2" frictionloss="0.1" armature="0.01"/>
      <geom size="0.05" pos="0 0 -0.2" mass="1"/>
      <body pos="0 0 -0.4">
        <joint name="left_knee" axis="0 1 0" damping="0.2" frictionloss="0.1" armature="0.01"/>
        <geom size="0.05" pos="0 0 -0.2" mass="1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
PD = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=40.0, damping=1.0, effort_limit=5.0)
N_SIMS = 20

NAMED = [
    (randomize_effort_limits, "effort_limit_range", "effort_limit"),
    (randomize_strength, "strength_range", "strength"),
    (randomize_friction, "frictionloss_range", "frictionloss"),
    (randomize_armature, "armature_range", "armature"),
    (randomize_viscous_damping, "viscous_damping_range", "viscous_damping"),
]
EVERY = [
    *NAMED,
    (randomize_pd_gains, "kp_range", "stiffness"),
    (randomize_pd_gains, "kd_range", "damping"),
]


def group_of(*cfgs):
    root = mjcf.from_xml_string(XML)
    group = ActuatorGroup(cfgs)
    group.edit_mjcf(root)
    group.initialize(Batch(mjcf.Physics.from_mjcf_model(root).model.ptr, N_SIMS, 1))
    group.reset()
    return group


def values_of(group):
    return {
        (i, name): actuator.get(name)
        for i, actuator in enumerate(group.actuators)
        for name in actuator.parameters
    }


def assert_same(group, other, but=()):
    before, after = values_of(group), values_of(other)
    for key, value in before.items():
        assert np.array_equal(value, after[key]) == (key[1] not in but), key


class TestNamed:
    @pytest.mark.parametrize(("function", "argument", "parameter"), EVERY)
    def test_varies_its_parameter_and_no_other(self, function, argument, parameter):
        group = group_of(PD)
        function(group, **{argument: (0.5, 0.9)}, random_state=np.random.default_rng(0))
        assert_same(group_of(PD), group, but=(parameter,))

    @pytest.mark.parametrize(("function", "argument", "parameter"), EVERY)
    @pytest.mark.parametrize(
        "options",
        [
            {},
            {"operation": "add"},
            {"operation": "abs", "distribution": "log_uniform"},
            {"distribution": "gaussian", "shared": True},
            {"joint_names_expr": (".*_knee",)},
        ],
    )
    @pytest.mark.parametrize("env_ids", [None, [3, 5]])
    def test_is_the_object_with_the_same_options(
        self, function, argument, parameter, options, env_ids
    ):
        numbers = (0.9, 0.1) if options.get("distribution") == "gaussian" else (0.5, 0.9)
        given, expected, general = group_of(PD), group_of(PD), group_of(PD)
        function(
            given,
            **{argument: numbers},
            random_state=np.random.default_rng(1),
            env_ids=env_ids,
            **options,
        )
        Randomization(parameter=parameter, range=numbers, **options).apply(
            expected, np.random.default_rng(1), env_ids
        )
        assert_same(given, expected)
        randomize(
            general,
            parameter,
            numbers,
            random_state=np.random.default_rng(1),
            env_ids=env_ids,
            **options,
        )
        assert_same(given, general)

    @pytest.mark.parametrize(("function", "argument", "parameter"), EVERY)
    def test_takes_a_variation(self, function, argument, parameter):
        group = group_of(PD)
        chosen = distributions.Uniform(0.5, 0.9)
        function(group, **{argument: chosen}, random_state=np.random.RandomState(0))
        actuator = group.actuators[0]
        ratio = actuator.get(parameter) / actuator.nominal(parameter)
        assert (ratio > 0.49).all()
        assert (ratio < 0.91).all()

    @pytest.mark.parametrize("function", [function for function, _, _ in NAMED] + [randomize])
    def test_random_state_is_required(self, function):
        assert inspect.signature(function).parameters["random_state"].default is inspect._empty


class TestPdGains:
    def test_both_are_drawn_apart(self):
        group = group_of(PD)
        randomize_pd_gains(
            group, kp_range=(0.8, 1.2), kd_range=(0.8, 1.2), random_state=np.random.default_rng(0)
        )
        actuator = group.actuators[0]
        kp, kd = actuator.get("stiffness") / 40, actuator.get("damping")
        assert abs(np.corrcoef(kp.ravel(), kd.ravel())[0, 1]) < 0.5
        assert_same(group_of(PD), group, but=("stiffness", "damping"))

    def test_wheels_have_damping_alone(self):
        hip = IdealPdActuatorCfg(joint_names_expr=("left_hip",), stiffness=40.0, damping=1.0)
        wheel = BuiltinVelocityActuatorCfg(joint_names_expr=("left_knee",), damping=3.0)
        group = group_of(hip, wheel)
        randomize_pd_gains(
            group, kp_range=(2, 2), kd_range=(3, 3), random_state=np.random.default_rng(0)
        )
        assert (group.actuators[0].get("stiffness") == 80).all()
        assert (group.actuators[0].get("damping") == 3).all()
        assert (group.actuators[1].get("damping") == 9).all()

    def test_what_refuses_one_leaves_the_other(self):
        group = group_of(PD)
        with pytest.raises(ValueError, match="damping should be at least 0"):
            randomize_pd_gains(
                group, kp_range=(0.8, 1.2), kd_range=(-1, 1), random_state=np.random.default_rng(0)
            )
        assert_same(group_of(PD), group)

    def test_no_range_is_refused(self):
        with pytest.raises(ValueError, match="kp_range and kd_range are both None"):
            randomize_pd_gains(group_of(PD), random_state=np.random.default_rng(0))

    def test_a_motor_has_no_gains(self):
        group = group_of(BuiltinMotorActuatorCfg(joint_names_expr=(".*",)))
        with pytest.raises(
            ValueError, match=r"'stiffness': no selected actuator has it.*'left_knee' has \["
        ):
            randomize_pd_gains(group, kp_range=(0.8, 1.2), random_state=np.random.default_rng(0))


def test_delay():
    cfg = DelayedActuatorCfg(base_cfg=PD, delay_min_lag=0, delay_max_lag=5)
    group = group_of(cfg)
    randomize_delay(group, lag_range=(1, 4), operation="abs", random_state=np.random.default_rng(0))
    group.reset()
    lag = group.actuators[0].lag("position")
    assert {*lag} == {1, 2, 3, 4}
    assert np.array_equal(lag, group.actuators[0].get("delay_max_lag")[:, 0])


def test_the_document_s_example():
    group = group_of(PD)
    rng = np.random.default_rng(0)
    for _ in range(10):
        randomize_pd_gains(
            group,
            kp_range=(0.8, 1.2),
            kd_range=(0.8, 1.2),
            distribution="uniform",
            operation="scale",
            random_state=rng,
            env_ids=rng.permutation(N_SIMS)[:5],
        )
        randomize_effort_limits(
            group,
            effort_limit_range=(0.7, 1.0),
            operation="scale",
            joint_names_expr=("left_.*",),
            random_state=rng,
        )
        limits = group.actuators[0].get("effort_limit")
        assert (limits >= 3.5).all()
        assert (limits <= 5.0).all()
