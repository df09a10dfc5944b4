import subprocess
import sys

import mujoco
import numpy as np
import pytest
from dm_control import composer, mjcf
from dm_control.composer import variation
from dm_control.composer.variation import distributions, noises
from mujoco.batch import Batch

from walkerkit.actuators import (
    ActuatorCmd,
    ActuatorGroup,
    BuiltinMotorActuatorCfg,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
    XmlVelocityActuatorCfg,
    add_position_actuator,
)
from walkerkit.actuators.builtin_dc_motor import BuiltinDcMotorActuatorCfg
from walkerkit.actuators.builtin_muscle import BuiltinMuscleActuatorCfg
from walkerkit.actuators.randomization import Randomization

XML = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="thigh">
      <joint name="hip" axis="0 1 0" damping="0.2" frictionloss="0.1" armature="0.01"/>
      <geom size="0.05" pos="0 0 -0.2" mass="1"/>
      <body name="shin" pos="0 0 -0.4">
        <joint name="knee" axis="0 1 0" damping="0.2" frictionloss="0.1" armature="0.02"/>
        <geom size="0.05" pos="0 0 -0.2" mass="1"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
BARE = XML
for _plain in ('damping="0.2" ', 'frictionloss="0.1" ', 'armature="0.01"', 'armature="0.02"'):
    BARE = BARE.replace(_plain, "")
ALL = (".*",)
PD = {"joint_names_expr": ALL, "stiffness": 40.0, "damping": 1.0, "effort_limit": 5.0}
VELOCITY = {"joint_names_expr": ALL, "damping": 4.0, "effort_limit": 5.0}
DC = {**PD, "saturation_effort": 8.0, "velocity_limit": 20.0}
NATIVE_DC = {
    **PD,
    "input": "position",
    "torque_constant": 0.05,
    "resistance": 0.4,
    "gear_ratio": 9.0,
    "voltage_limit": 24.0,
}


def rng(seed=0):
    return np.random.default_rng(seed)


def root_of(*cfgs, xml=XML):
    root = mjcf.from_xml_string(xml)
    group = ActuatorGroup(cfgs)
    group.edit_mjcf(root)
    return root, group


def physics_of(*cfgs, xml=XML):
    root, group = root_of(*cfgs, xml=xml)
    physics = mjcf.Physics.from_mjcf_model(root)
    group.initialize(physics)
    group.reset()
    return physics, group


def batch_of(*cfgs, n_sims=4, xml=XML):
    root, group = root_of(*cfgs, xml=xml)
    batch = Batch(mjcf.Physics.from_mjcf_model(root).model.ptr, n_sims, 1)
    group.initialize(batch)
    group.reset()
    return batch, group


def commands(group, n_steps, seed=7):
    """Random targets of whatever the actuators take, held for 20 steps each."""
    source = rng(seed)
    kind = next(
        k for k in ("position_target", "velocity_target", "effort_target") if k in group.takes
    )
    shape = (*group.simulation.batch_shape, len(group.joint_names))
    for i in range(n_steps):
        if i % 20 == 0:
            target = np.broadcast_to(source.uniform(-1.5, 1.5, size=shape[-1]), shape)
            cmd = ActuatorCmd(**{kind: target})
        yield cmd


def roll(simulated, group, n_steps=200):
    """Positions after each step, (n_steps, ..., 2)."""
    qpos = group.simulation.state("qpos")
    trajectory = []
    for cmd in commands(group, n_steps):
        group.update(group.simulation.model.opt.timestep)
        group.apply(cmd)
        simulated.step()
        trajectory.append(qpos.copy())
    return np.array(trajectory)


def apply(physics, group, *randomizations, seed=0):
    """As an environment does: what is derived from the parameters is worked out afterwards."""
    with physics.reset_context():
        for randomization in randomizations:
            randomization.apply(group, rng(seed))
        group.reset()


def snapshot(group):
    """Every parameter, and every field of the model that is one of some simulation."""
    values = {
        (i, name): actuator.get(name)
        for i, actuator in enumerate(group.actuators)
        for name in actuator.parameters
    }
    for field in (
        "actuator_gainprm",
        "actuator_biasprm",
        "actuator_forcerange",
        "dof_armature",
        "dof_frictionloss",
        "dof_damping",
        "dof_invweight0",
    ):
        values[0, field] = group.simulation.parameter(field).copy()
    return values


class TestOperations:
    @pytest.mark.parametrize(
        ("operation", "expected"), [("scale", [60, 15]), ("add", [41.5, 11.5]), ("abs", [1.5, 1.5])]
    )
    def test_work_on_the_nominal_value(self, operation, expected):
        _, group = physics_of(
            IdealPdActuatorCfg(**{**PD, "stiffness": {"hip": 40.0, "knee": 10.0}})
        )
        randomization = Randomization(parameter="stiffness", range=(1.5, 1.5), operation=operation)
        randomization.apply(group, rng())
        assert group.actuators[0].get("stiffness").tolist() == expected

    @pytest.mark.parametrize("cfg", [IdealPdActuatorCfg(**PD), BuiltinPositionActuatorCfg(**PD)])
    @pytest.mark.parametrize("operation", ["scale", "add"])
    def test_do_not_compound_over_100_resets(self, cfg, operation):
        physics, group = physics_of(cfg)
        source = rng(1)
        ranges = {"scale": (0.5, 1.5), "add": (-0.005, 0.005)}[operation]
        names = group.actuators[0].parameters
        for _ in range(100):
            with physics.reset_context():
                for name in names:
                    Randomization(parameter=name, range=ranges, operation=operation).apply(
                        group, source
                    )
                group.reset()
            for name in names:
                nominal = group.actuators[0].nominal(name)
                change = group.actuators[0].get(name)
                change = change / nominal if operation == "scale" else change - nominal
                assert (change >= ranges[0] - 1e-12).all()
                assert (change <= ranges[1] + 1e-12).all()
        assert group.actuators[0].nominal("stiffness").tolist() == [40, 40]
        # And back, to the bit: nothing was left behind on the way.
        untouched = snapshot(physics_of(cfg)[1])
        for name in names:
            Randomization(parameter=name, range=(1.0, 1.0)).apply(group, source)
        for key, value in snapshot(group).items():
            assert np.array_equal(value, untouched[key]), key

    def test_unlimited_effort_takes_an_absolute_limit_and_stays_unlimited_otherwise(self):
        cfgs = (
            IdealPdActuatorCfg(**{**PD, "joint_names_expr": ("hip",), "effort_limit": None}),
            IdealPdActuatorCfg(**{**PD, "joint_names_expr": ("knee",)}),
        )
        _, group = physics_of(*cfgs)
        limits = [actuator.get("effort_limit") for actuator in group.actuators]
        assert limits == [[np.inf], [5]]
        for operation, draw, expected in (
            ("scale", 0.5, [np.inf, 2.5]),
            ("add", -2.0, [np.inf, 3.0]),
            ("abs", 4.0, [4.0, 4.0]),
        ):
            Randomization(parameter="effort_limit", range=(draw, draw), operation=operation).apply(
                group, rng()
            )
            assert [a.get("effort_limit").item() for a in group.actuators] == expected


class TestDraws:
    def test_each_joint_has_its_own_unless_shared(self):
        _, group = physics_of(IdealPdActuatorCfg(**PD))
        randomization = Randomization(parameter="stiffness", range=(0.5, 1.5))
        randomization.apply(group, rng())
        hip, knee = group.actuators[0].get("stiffness")
        assert hip != knee
        Randomization(parameter="stiffness", range=(0.5, 1.5), shared=True).apply(group, rng())
        hip, knee = group.actuators[0].get("stiffness")
        assert hip == knee != 40

    def test_shared_is_for_the_joints_of_one_simulation_across_actuators(self):
        cfgs = (
            IdealPdActuatorCfg(**{**PD, "joint_names_expr": ("knee",)}),
            BuiltinPositionActuatorCfg(**{**PD, "joint_names_expr": ("hip",)}),
        )
        _, group = batch_of(*cfgs, n_sims=3)
        Randomization(parameter="damping", range=(0.5, 1.5), shared=True).apply(group, rng())
        knee, hip = (actuator.get("damping") for actuator in group.actuators)
        assert np.array_equal(knee, hip)
        assert len({*knee.ravel()}) == 3

    def test_every_simulation_of_a_batch_has_its_own(self):
        _, group = batch_of(IdealPdActuatorCfg(**PD), n_sims=50)
        Randomization(parameter="stiffness", range=(0.5, 1.5)).apply(group, rng())
        assert len({*group.actuators[0].get("stiffness").ravel()}) == 100

    @pytest.mark.parametrize("make", [np.random.default_rng, np.random.RandomState])
    def test_a_seed_settles_them(self, make):
        _, group = batch_of(IdealPdActuatorCfg(**PD))
        randomization = Randomization(parameter="stiffness", range=(0.5, 1.5))
        drawn = []
        for seed in (3, 3, 4):
            randomization.apply(group, make(seed))
            drawn.append(group.actuators[0].get("stiffness"))
        assert np.array_equal(drawn[0], drawn[1])
        assert not np.array_equal(drawn[0], drawn[2])

    def test_the_source_moves_on_and_the_global_one_is_left_alone(self):
        _, group = physics_of(IdealPdActuatorCfg(**PD))
        before = np.random.get_state()[1].copy()  # noqa: NPY002  that it is not used
        source = rng()
        drawn = []
        for _ in range(2):
            Randomization(parameter="stiffness", range=(0.5, 1.5)).apply(group, source)
            drawn.append(group.actuators[0].get("stiffness"))
        Randomization(parameter="stiffness", range=distributions.Uniform(0.5, 1.5)).apply(
            group, source
        )
        assert not np.array_equal(*drawn)
        assert np.array_equal(before, np.random.get_state()[1])  # noqa: NPY002

    def test_do_not_depend_on_the_order_of_the_configs(self):
        hip = IdealPdActuatorCfg(**{**PD, "joint_names_expr": ("hip",)})
        knee = BuiltinPositionActuatorCfg(**{**PD, "joint_names_expr": ("knee",)})
        drawn = []
        for cfgs in ((hip, knee), (knee, hip)):
            _, group = physics_of(*cfgs)
            Randomization(parameter="stiffness", range=(0.5, 1.5)).apply(group, rng())
            drawn.append({a.joint_names[0]: a.get("stiffness").item() for a in group.actuators})
        assert drawn[0] == drawn[1]
        assert drawn[0]["hip"] != drawn[0]["knee"]

    @pytest.mark.parametrize(
        ("distribution", "numbers", "mean", "low", "high"),
        [
            ("uniform", (0.5, 1.5), 40.0, 20.0, 60.0),
            ("log_uniform", (0.5, 2.0), 40 * 1.5 / np.log(4), 20.0, 80.0),
            ("gaussian", (1.0, 0.2), 40.0, 16.0, 64.0),
        ],
    )
    def test_are_distributed_as_asked(self, distribution, numbers, mean, low, high):
        _, group = batch_of(IdealPdActuatorCfg(**PD), n_sims=5000)
        Randomization(parameter="stiffness", range=numbers, distribution=distribution).apply(
            group, rng(5)
        )
        drawn = group.actuators[0].get("stiffness")
        assert drawn.mean() == pytest.approx(mean, rel=0.01)
        assert low <= drawn.min() < low + 3
        assert high - 3 < drawn.max() <= high
        assert abs(np.corrcoef(drawn.T)[0, 1]) < 0.05


class TestSelection:
    def test_only_the_joints_that_match(self):
        _, group = batch_of(IdealPdActuatorCfg(**PD))
        group.actuators[0].set("stiffness", 33.3)
        Randomization(parameter="stiffness", range=(0.5, 0.9), joint_names_expr=("kn.*",)).apply(
            group, rng()
        )
        drawn = group.actuators[0].get("stiffness")
        assert (drawn[:, 0] == 33.3).all()
        assert (drawn[:, 1] < 36).all()

    def test_passes_over_actuators_without_the_parameter(self):
        cfgs = (
            BuiltinVelocityActuatorCfg(joint_names_expr=("hip",), damping=2.0),
            BuiltinPositionActuatorCfg(joint_names_expr=("knee",), stiffness=9.0, damping=1.0),
        )
        _, group = physics_of(*cfgs)
        Randomization(parameter="stiffness", range=(2.0, 2.0)).apply(group, rng())
        assert group.actuators[1].get("stiffness") == [18]
        assert group.actuators[0].get("damping") == [2]

    def test_a_single_actuator_will_do(self):
        actuator = IdealPdActuatorCfg(**PD).build()
        root = mjcf.from_xml_string(XML)
        actuator.edit_mjcf(root)
        actuator.initialize(mjcf.Physics.from_mjcf_model(root))
        Randomization(parameter="damping", range=(2.0, 2.0)).apply(actuator, rng())
        assert actuator.get("damping").tolist() == [2, 2]

    def test_a_tendon_may_have_the_name_of_a_joint(self):
        xml = XML.replace(
            "</worldbody>",
            '</worldbody><tendon><fixed name="hip"><joint joint="knee" coef="1"/></fixed></tendon>',
        )
        cfgs = (
            BuiltinPositionActuatorCfg(**{**PD, "joint_names_expr": ("hip",)}),
            BuiltinPositionActuatorCfg(
                **{**PD, "joint_names_expr": ("hip",)}, transmission="tendon"
            ),
        )
        _, group = physics_of(*cfgs, xml=xml)
        Randomization(parameter="stiffness", range=(0.5, 1.5)).apply(group, rng())
        joint, tendon = (actuator.get("stiffness").item() for actuator in group.actuators)
        assert joint != tendon


SINGLE = [
    pytest.param(cfg, kwargs, parameter, value, id=f"{cfg.__name__}-{parameter}")
    for cfg, kwargs in (
        (IdealPdActuatorCfg, PD),
        (DcMotorActuatorCfg, DC),
        (BuiltinPositionActuatorCfg, PD),
        (BuiltinPdActuatorCfg, PD),
        (BuiltinVelocityActuatorCfg, VELOCITY),
        (BuiltinDcMotorActuatorCfg, NATIVE_DC),
    )
    for parameter, value in (
        ("stiffness", (17.3, 29.1)),
        ("damping", (0.71, 1.37)),
        ("effort_limit", (2.9, 4.3)),
        ("saturation_effort", (5.3, 6.1)),
        ("velocity_limit", (3.7, 7.9)),
        ("resistance", (2.3, 4.7)),
        ("armature", (0.033, 0.047)),
        ("frictionloss", (0.31, 0.57)),
        ("viscous_damping", (0.053, 0.37)),
    )
    if parameter in {*kwargs, "armature", "frictionloss", "viscous_damping"}
]


class TestSameAsConfigured:
    """A randomized actuator moves, to the bit, as one that was configured with its numbers."""

    @pytest.mark.parametrize(("cfg", "kwargs", "parameter", "value"), SINGLE)
    def test_one_physics(self, cfg, kwargs, parameter, value):
        physics, group = physics_of(cfg(**kwargs))
        unchanged = roll(physics, group)
        apply(physics, group, Randomization(parameter=parameter, range=value, operation="abs"))
        hip, knee = group.actuators[0].get(parameter)
        assert hip != knee
        moved = roll(physics, group)
        numbers = {**kwargs, parameter: {"hip": float(hip), "knee": float(knee)}}
        configured, other = physics_of(cfg(**numbers))
        apply(configured, other)
        assert np.array_equal(moved, roll(configured, other))
        assert not np.array_equal(moved, unchanged)

    @pytest.mark.parametrize(("cfg", "kwargs", "parameter", "value"), SINGLE)
    def test_each_simulation_of_a_batch(self, cfg, kwargs, parameter, value):
        batch, group = batch_of(cfg(**kwargs), n_sims=3)
        randomization = Randomization(parameter=parameter, range=value, operation="abs")
        randomization.apply(group, rng(), env_ids=[0, 2])
        numbers = group.actuators[0].get(parameter)
        moved = roll(batch, group)
        for i, (hip, knee) in enumerate(numbers):
            own = {parameter: {"hip": float(hip), "knee": float(knee)}} if i != 1 else {}
            configured, other = batch_of(cfg(**{**kwargs, **own}), n_sims=1)
            assert np.array_equal(moved[:, i], roll(configured, other)[:, 0])

    @pytest.mark.parametrize("parameter", ["armature", "frictionloss", "viscous_damping"])
    @pytest.mark.parametrize("cfg", [IdealPdActuatorCfg, BuiltinPositionActuatorCfg])
    def test_where_the_xml_has_none(self, cfg, parameter):
        physics, group = physics_of(cfg(**PD), xml=BARE)
        assert not group.actuators[0].nominal(parameter).any()
        apply(physics, group, Randomization(parameter=parameter, range=(0.2, 0.2), operation="add"))
        configured, other = physics_of(cfg(**PD, **{parameter: 0.2}), xml=BARE)
        apply(configured, other)
        assert np.array_equal(roll(physics, group), roll(configured, other))

    @pytest.mark.parametrize(
        ("cfg", "zero"),
        [
            (IdealPdActuatorCfg, "stiffness"),
            (BuiltinPdActuatorCfg, "stiffness"),
            (BuiltinPositionActuatorCfg, "stiffness"),
            (BuiltinVelocityActuatorCfg, "damping"),
        ],
    )
    def test_where_the_nominal_gain_is_zero(self, cfg, zero):
        kwargs = VELOCITY if cfg is BuiltinVelocityActuatorCfg else PD
        physics, group = physics_of(cfg(**{**kwargs, zero: 0.0}))
        apply(physics, group, Randomization(parameter=zero, range=(3, 3), operation="abs"))
        configured, other = physics_of(cfg(**{**kwargs, zero: 3.0}))
        apply(configured, other)
        assert np.array_equal(roll(physics, group), roll(configured, other))

    @pytest.mark.parametrize(
        "cfg", [IdealPdActuatorCfg, BuiltinPositionActuatorCfg, BuiltinPdActuatorCfg]
    )
    def test_strength_is_gains_and_limits_together(self, cfg):
        physics, group = physics_of(cfg(**PD))
        apply(physics, group, Randomization(parameter="strength", range=(0.5, 0.5)))
        half = {name: PD[name] / 2 for name in ("stiffness", "damping", "effort_limit")}
        configured, other = physics_of(cfg(**{**PD, **half}))
        apply(configured, other)
        assert np.array_equal(roll(physics, group), roll(configured, other))

    def test_strength_of_a_motor(self):
        physics, group = physics_of(BuiltinMotorActuatorCfg(joint_names_expr=ALL))
        apply(physics, group, Randomization(parameter="strength", range=(0.5, 0.5)))
        group.apply(ActuatorCmd(effort_target=np.array([1.0, -2.0])))
        physics.forward()
        assert physics.data.actuator_force.tolist() == [0.5, -1.0]

    @pytest.mark.parametrize("cfg", [IdealPdActuatorCfg, BuiltinPositionActuatorCfg])
    def test_delayed_actuators_are_unwrapped(self, cfg):
        def delayed(**numbers):
            base = cfg(**{**PD, **numbers})
            return DelayedActuatorCfg(base_cfg=base, delay_min_lag=3, delay_max_lag=3)

        physics, group = physics_of(delayed())
        assert group.actuators[0].native == (cfg is BuiltinPositionActuatorCfg)
        apply(
            physics,
            group,
            Randomization(parameter="stiffness", range=(17.3, 17.3), operation="abs"),
            Randomization(parameter="armature", range=(0.03, 0.03), operation="abs"),
        )
        configured, other = physics_of(delayed(stiffness=17.3, armature=0.03))
        apply(configured, other)
        assert np.array_equal(roll(physics, group), roll(configured, other))

    def test_a_change_reaches_a_command_that_is_held(self):
        physics, group = physics_of(BuiltinPdActuatorCfg(**PD))
        cmd = ActuatorCmd(position_target=np.ones(2))
        group.apply(cmd)
        Randomization(parameter="stiffness", range=(2.0, 2.0)).apply(group, rng())
        group.apply(cmd)
        assert physics.data.ctrl.tolist() == [80, 80]


class TestPartial:
    @pytest.mark.parametrize("env_ids", [[1, 3], np.array([False, True, False, True])])
    @pytest.mark.parametrize(
        "cfg",
        [
            IdealPdActuatorCfg(**PD),
            DcMotorActuatorCfg(**DC),
            BuiltinPositionActuatorCfg(**PD),
            BuiltinPdActuatorCfg(**PD),
            BuiltinDcMotorActuatorCfg(**NATIVE_DC),
            BuiltinMuscleActuatorCfg(joint_names_expr=ALL, lengthrange=(-1, 1)),
            DelayedActuatorCfg(base_cfg=BuiltinPositionActuatorCfg(**PD), delay_max_lag=9),
        ],
        ids=lambda cfg: type(cfg).__name__,
    )
    def test_the_other_rows_keep_every_bit(self, cfg, env_ids):
        _, group = batch_of(cfg)
        source = rng(2)
        actuator = group.actuators[0]
        names = [name for name in actuator.parameters if not name.startswith("delay")]
        if isinstance(cfg, DelayedActuatorCfg):
            names.append("delay")
        for name in names:
            Randomization(parameter=name, range=(0.3, 0.9)).apply(group, source)
        before = snapshot(group)
        for name in names:
            Randomization(parameter=name, range=(0.3, 0.9)).apply(group, source, env_ids)
        after = snapshot(group)
        for key, was in before.items():
            assert np.array_equal(after[key][[0, 2]], was[[0, 2]]), key
        for name in {*actuator.parameters}.intersection(names):
            assert not (after[0, name][[1, 3]] == before[0, name][[1, 3]]).any()
        assert not np.array_equal(
            after[0, "dof_invweight0"][[1, 3]], before[0, "dof_invweight0"][[1, 3]]
        )

    def test_the_model_itself_is_left_alone(self):
        root, group = root_of(BuiltinPositionActuatorCfg(**PD))
        model = mjcf.Physics.from_mjcf_model(root).model.ptr
        batch = Batch(model, 2, 1)
        group.initialize(batch)
        group.reset()
        for name in group.actuators[0].parameters:
            Randomization(parameter=name, range=(0.3, 0.9)).apply(group, rng())
        assert model.actuator_gainprm[:, 0].tolist() == [40, 40]
        assert model.dof_armature.tolist() == [0.01, 0.02]

    def test_no_rows_is_nothing(self):
        _, group = batch_of(IdealPdActuatorCfg(**PD))
        before = snapshot(group)
        for given in ((0.3, 0.9), distributions.Uniform(0.3, 0.9)):
            Randomization(parameter="stiffness", range=given).apply(group, rng(), env_ids=[])
        for key, value in snapshot(group).items():
            assert np.array_equal(value, before[key])

    def test_rows_that_are_not_there(self):
        _, group = batch_of(IdealPdActuatorCfg(**PD))
        randomization = Randomization(parameter="stiffness", range=(0.3, 0.9))
        with pytest.raises(ValueError, match="ids from 0 to 3"):
            randomization.apply(group, rng(), env_ids=[4])
        _, group = physics_of(IdealPdActuatorCfg(**PD))
        with pytest.raises(ValueError, match="there is one physics and no batch"):
            randomization.apply(group, rng(), env_ids=[0])


class TestNativeFields:
    def test_an_effort_limit_is_the_force_range(self):
        physics, group = physics_of(BuiltinPositionActuatorCfg(**PD))
        Randomization(parameter="effort_limit", range=(0.5, 0.5)).apply(group, rng())
        assert physics.model.actuator_forcerange.tolist() == [[-2.5, 2.5]] * 2
        group.apply(ActuatorCmd(position_target=np.array([1.0, -1.0])))
        physics.forward()
        assert physics.data.actuator_force.tolist() == [2.5, -2.5]

    def test_fields_of_joints(self):
        batch, group = batch_of(IdealPdActuatorCfg(**PD))
        for name, field in (
            ("armature", "dof_armature"),
            ("frictionloss", "dof_frictionloss"),
            ("viscous_damping", "dof_damping"),
        ):
            Randomization(parameter=name, range=(0.5, 0.9)).apply(group, rng())
            assert np.array_equal(batch.expand(field), group.actuators[0].get(name))
            assert len({*batch.expand(field).ravel()}) == 8

    def test_constants_follow_the_armature(self):
        physics, group = physics_of(IdealPdActuatorCfg(**PD))
        before = physics.model.dof_invweight0.copy()
        Randomization(parameter="armature", range=(5.0, 5.0)).apply(group, rng())
        assert (physics.model.dof_invweight0 < before).all()

    def test_fields_of_tendons(self):
        xml = XML.replace(
            "</worldbody>",
            '</worldbody><tendon><fixed name="belt" damping="0.3" frictionloss="0.2">'
            '<joint joint="hip" coef="1"/><joint joint="knee" coef="-0.5"/></fixed></tendon>',
        )
        cfg = BuiltinPositionActuatorCfg(
            joint_names_expr=("belt",), transmission="tendon", stiffness=40.0, damping=1.0
        )
        physics, group = physics_of(cfg, xml=xml)
        Randomization(parameter="frictionloss", range=(2.0, 2.0)).apply(group, rng())
        Randomization(parameter="viscous_damping", range=(2.0, 2.0)).apply(group, rng())
        assert physics.model.tendon_frictionloss.tolist() == [0.4]
        assert physics.model.tendon_damping.tolist() == [0.6]
        assert physics.model.dof_frictionloss.tolist() == [0.1, 0.1]


class TestWrapped:
    """Actuators of the XML: their targets mean the same at any gain."""

    def scaled(self):
        root = mjcf.from_xml_string(XML)
        for i, joint in enumerate(root.find_all("joint")):
            add_position_actuator(
                joint, qposrange=(-0.5 - i, 1.5), ctrlrange=(-1, 1), kp=20.0 + i, forcerange=(-9, 9)
            )
        group = ActuatorGroup((XmlPositionActuatorCfg(joint_names_expr=ALL),))
        group.edit_mjcf(root)
        physics = mjcf.Physics.from_mjcf_model(root)
        group.initialize(physics)
        group.reset()
        return physics, group

    def force(self, physics, group, **targets):
        group.apply(ActuatorCmd(**{name: np.array(value) for name, value in targets.items()}))
        physics.forward()
        return physics.data.actuator_force.copy()

    def test_scaled_actuators_keep_their_targets(self):
        physics, group = self.scaled()
        with physics.reset_context():
            physics.data.qpos[:] = [0.3, -0.2]
        # At the target there is no force, and the control is that of any other gain.
        nothing = self.force(physics, group, position_target=[0.3, -0.2])
        np.testing.assert_allclose(nothing, 0, atol=1e-14)
        control = physics.data.ctrl.copy()
        before = self.force(physics, group, position_target=[0.4, -0.3])
        np.testing.assert_allclose(before, [2.0, -2.1], rtol=1e-12)
        Randomization(parameter="stiffness", range=(0.5, 2.0)).apply(group, rng())
        ratio = group.actuators[0].get("stiffness") / [20, 21]
        assert (ratio != 1).all()
        after = self.force(physics, group, position_target=[0.4, -0.3])
        np.testing.assert_allclose(after, before * ratio, rtol=1e-12)
        nothing = self.force(physics, group, position_target=[0.3, -0.2])
        np.testing.assert_allclose(nothing, 0, atol=1e-13)
        assert np.array_equal(physics.data.ctrl, control)
        np.testing.assert_allclose(group.applied_effort, nothing, atol=1e-13)

    def test_scaled_actuators_take_their_limit_and_strength(self):
        physics, group = self.scaled()
        Randomization(parameter="effort_limit", range=(0.1, 0.1)).apply(group, rng())
        Randomization(parameter="strength", range=(0.5, 0.5)).apply(group, rng())
        forces = self.force(physics, group, position_target=[1.0, -1.0])
        np.testing.assert_allclose(forces, [0.45, -0.45], rtol=1e-12)

    def test_velocity_actuators(self):
        root = mjcf.from_xml_string(XML)
        root.actuator.add("velocity", joint=root.find("joint", "hip"), name="hip", kv=2, gear=[3])
        group = ActuatorGroup((XmlVelocityActuatorCfg(joint_names_expr=("hip",)),))
        group.edit_mjcf(root)
        physics = mjcf.Physics.from_mjcf_model(root)
        group.initialize(physics)
        assert group.actuators[0].nominal("damping") == [18]
        Randomization(parameter="damping", range=(0.5, 0.5)).apply(group, rng())
        with physics.reset_context():
            physics.data.qvel[0] = 0.2
        force = self.force(physics, group, velocity_target=[1.0])
        np.testing.assert_allclose(3 * force, [9 * (1.0 - 0.2)], rtol=1e-12)

    def test_a_muscle_like_range_keeps_its_direction(self):
        xml = XML.replace(
            "</worldbody>",
            '</worldbody><actuator><motor name="hip" joint="hip" forcerange="-6 0" '
            'forcelimited="true"/></actuator>',
        )
        physics, group = physics_of(XmlMotorActuatorCfg(joint_names_expr=("hip",)), xml=xml)
        assert group.actuators[0].nominal("effort_limit") == [6]
        Randomization(parameter="effort_limit", range=(0.5, 0.5)).apply(group, rng())
        assert physics.model.actuator_forcerange.tolist() == [[-3, 0]]
        Randomization(parameter="strength", range=(0.5, 0.5)).apply(group, rng())
        assert physics.model.actuator_forcerange.tolist() == [[-1.5, 0]]

    def test_a_limit_beside_an_actuator_that_has_none(self):
        motors = (
            '<motor name="hip" joint="hip"/>'
            '<motor name="knee" joint="knee" forcerange="-6 6" forcelimited="true"/>'
        )
        xml = XML.replace("</worldbody>", f"</worldbody><actuator>{motors}</actuator>")
        physics, group = physics_of(XmlMotorActuatorCfg(joint_names_expr=ALL), xml=xml)
        (actuator,) = group.actuators
        assert actuator.nominal("effort_limit").tolist() == [np.inf, 6]
        Randomization(parameter="effort_limit", range=(0.5, 0.5)).apply(group, rng())
        assert actuator.get("effort_limit").tolist() == [np.inf, 3]
        assert physics.model.actuator_forcerange.tolist() == [[0, 0], [-3, 3]]
        forces = self.force(physics, group, effort_target=[9.0, 9.0])
        assert forces.tolist() == [9, 3]
        with pytest.raises(ValueError, match="joint 'hip' has no effort_limit to change"):
            actuator.set("effort_limit", 4.0)
        assert actuator.get("effort_limit").tolist() == [np.inf, 3]


def delayed(low=0, high=6, joints=ALL, **more):
    base = IdealPdActuatorCfg(**{**PD, "joint_names_expr": joints})
    return DelayedActuatorCfg(
        base_cfg=base, delay_min_lag=low, delay_max_lag=high, delay_hold_prob=1.0, **more
    )


class TestDelay:
    def bounds(self, actuator):
        return [actuator.get(name)[..., 0] for name in ("delay_min_lag", "delay_max_lag")]

    def test_abs_is_a_constant_lag(self):
        _, group = batch_of(delayed(), n_sims=700)
        randomization = Randomization(parameter="delay", range=(1, 6), operation="abs")
        randomization.apply(group, rng())
        low, high = self.bounds(group.actuators[0])
        assert np.array_equal(low, high)
        values, counts = np.unique(low, return_counts=True)
        assert values.tolist() == [1, 2, 3, 4, 5, 6]
        assert counts.min() > 80
        group.reset()
        assert np.array_equal(group.actuators[0].lag("position"), low)

    def test_add_and_scale_move_both_bounds(self):
        _, group = batch_of(delayed(2, 6), n_sims=100)
        Randomization(parameter="delay", range=(-2, 0), operation="add").apply(group, rng())
        low, high = self.bounds(group.actuators[0])
        assert {*low} == {0, 1, 2}
        assert np.array_equal(high, low + 4)
        Randomization(parameter="delay", range=(0.0, 1.0)).apply(group, rng())
        low, high = self.bounds(group.actuators[0])
        assert {*low} == {0, 1, 2}
        # Rounded from 2 and 6 times the same draw.
        assert (np.abs(low - high / 3) <= 2 / 3 + 1e-9).all()
        assert {*high} == {0, 1, 2, 3, 4, 5, 6}

    def test_does_not_compound(self):
        _, group = batch_of(delayed(2, 6), n_sims=3)
        source = rng()
        for _ in range(100):
            Randomization(parameter="delay", range=(0, 6), operation="abs").apply(group, source)
            group.reset()
        Randomization(parameter="delay", range=(1.0, 1.0)).apply(group, source)
        low, high = self.bounds(group.actuators[0])
        assert low.tolist() == [2] * 3
        assert high.tolist() == [6] * 3

    def test_same_as_configured(self):
        physics, group = physics_of(delayed())
        apply(physics, group, Randomization(parameter="delay", range=(4, 4), operation="abs"))
        configured, other = physics_of(delayed(4, 4))
        apply(configured, other)
        assert np.array_equal(roll(physics, group), roll(configured, other))

    def test_actuators_have_their_own_unless_shared(self):
        cfgs = (delayed(joints=("knee",)), delayed(joints=("hip",)))
        _, group = batch_of(*cfgs, n_sims=100)
        for shared in (False, True):
            Randomization(parameter="delay", range=(0, 6), operation="abs", shared=shared).apply(
                group, rng()
            )
            knee, hip = (self.bounds(actuator)[0] for actuator in group.actuators)
            assert np.array_equal(knee, hip) == shared

    def test_takes_a_variation(self):
        _, group = batch_of(delayed(), n_sims=100)
        Randomization(
            parameter="delay", range=distributions.UniformInteger(2, 5), operation="abs"
        ).apply(group, rng())
        low, high = self.bounds(group.actuators[0])
        assert {*low} == {2, 3, 4}
        assert np.array_equal(low, high)

    @pytest.mark.parametrize(
        ("numbers", "operation", "lag"),
        [((3, 8), "abs", 8), ((-3, 0), "add", -3), ((1, 2), "scale", 12)],
    )
    def test_refuses_lags_without_room(self, numbers, operation, lag):
        _, group = batch_of(delayed(0 if operation == "add" else 2, 6))
        with pytest.raises(ValueError, match=rf"delay_m.._lag should be from 0 to 6.* got {lag};"):
            Randomization(parameter="delay", range=numbers, operation=operation).apply(group, rng())

    def test_refuses_fractions_of_steps(self):
        with pytest.raises(ValueError, match=r"whole physics steps .* got \(1.5, 3\)"):
            Randomization(parameter="delay", range=(1.5, 3), operation="abs")

    @pytest.mark.parametrize("name", ["delay_min_lag", "delay_max_lag"])
    def test_refuses_one_bound_alone(self, name):
        with pytest.raises(ValueError, match=f"'{name}'.*use parameter='delay'"):
            Randomization(parameter=name, range=(0, 1))

    def test_refuses_some_of_the_joints_with_one_delay(self):
        _, group = batch_of(delayed())
        with pytest.raises(ValueError, match="the delay of 'knee' is also that of 'hip'"):
            Randomization(
                parameter="delay", range=(0, 3), operation="abs", joint_names_expr=("knee",)
            ).apply(group, rng())

    def test_refuses_where_nothing_is_delayed(self):
        native = DelayedActuatorCfg(
            base_cfg=BuiltinPositionActuatorCfg(**PD), delay_min_lag=2, delay_max_lag=2
        )
        for cfg in (IdealPdActuatorCfg(**PD), native):
            _, group = physics_of(cfg)
            with pytest.raises(ValueError, match="use DelayedActuatorCfg with delay_min_lag below"):
                Randomization(parameter="delay", range=(0, 1), operation="abs").apply(group, rng())


class TestVariations:
    """Composer's own, in place of a range."""

    def test_a_distribution_is_the_draw(self):
        _, group = batch_of(IdealPdActuatorCfg(**PD), n_sims=2000)
        Randomization(parameter="stiffness", range=distributions.Uniform(0.5, 1.5)).apply(
            group, rng()
        )
        drawn = group.actuators[0].get("stiffness")
        assert len({*drawn.ravel()}) == 4000
        assert 20 <= drawn.min() < 20.5
        assert 59.5 < drawn.max() <= 60

    def test_a_single_sample_is_for_one_simulation(self):
        _, group = batch_of(IdealPdActuatorCfg(**PD), n_sims=5)
        Randomization(
            parameter="stiffness", range=distributions.Uniform(0.5, 1.5, single_sample=True)
        ).apply(group, rng())
        drawn = group.actuators[0].get("stiffness")
        assert np.array_equal(drawn[:, 0], drawn[:, 1])
        assert len({*drawn[:, 0]}) == 5

    def test_the_same_random_state_draws_what_composer_would(self):
        _, group = physics_of(IdealPdActuatorCfg(**PD))
        chosen = distributions.Normal(1.0, 0.1)
        Randomization(parameter="stiffness", range=chosen).apply(group, np.random.RandomState(4))
        expected = variation.evaluate(chosen, np.full(2, 40.0), None, np.random.RandomState(4))
        assert np.array_equal(group.actuators[0].get("stiffness"), 40 * expected)

    def test_they_compose(self):
        _, group = physics_of(
            IdealPdActuatorCfg(**{**PD, "stiffness": {"hip": 40.0, "knee": 10.0}})
        )
        multiplied = noises.Multiplicative(distributions.Uniform(0.9, 1.1)) + 2.0
        for _ in range(20):
            Randomization(parameter="stiffness", range=multiplied, operation="abs").apply(
                group, rng()
            )
        hip, knee = group.actuators[0].get("stiffness")
        assert 38 <= hip <= 46
        assert 11 <= knee <= 13

    def test_they_see_nominal_and_present_values_of_the_selected_joints(self):
        seen = []

        def spy(initial, current, random_state):
            seen.append((initial, current, random_state))
            return 1.0

        _, group = batch_of(IdealPdActuatorCfg(**PD), n_sims=2)
        group.actuators[0].set("stiffness", [[1.0, 2.0], [3.0, 4.0]])
        state = np.random.RandomState(0)
        Randomization(parameter="stiffness", range=spy, joint_names_expr=("knee",)).apply(
            group, state
        )
        assert [initial.tolist() for initial, _, _ in seen] == [[40], [40]]
        assert [current.tolist() for _, current, _ in seen] == [[2], [4]]
        assert all(given is state for _, _, given in seen)

    def test_what_they_return_is_judged(self):
        _, group = physics_of(IdealPdActuatorCfg(**PD))
        for drawn in (-0.5, np.nan, np.inf):
            with pytest.raises(ValueError, match="'hip': stiffness should be"):
                Randomization(parameter="stiffness", range=lambda i, c, r, x=drawn: x).apply(
                    group, rng()
                )
        assert group.actuators[0].get("stiffness").tolist() == [40, 40]
        with pytest.raises(ValueError, match="should return a number for all joints or 2 numbers"):
            Randomization(parameter="stiffness", range=lambda i, c, r: np.ones(3)).apply(
                group, rng()
            )

    @pytest.mark.parametrize("given", [{"shared": True}, {"distribution": "gaussian"}])
    def test_they_decide_alone(self, given):
        with pytest.raises(ValueError, match=f"{next(iter(given))}=.* says itself how it is"):
            Randomization(parameter="stiffness", range=distributions.Uniform(), **given)


class TestRefusals:
    @pytest.mark.parametrize(
        ("given", "text"),
        [
            ({"operation": "multiply"}, r"operation should be one of .* got 'multiply'"),
            ({"operation": "scales"}, "did you mean 'scale'"),
            ({"distribution": "loguniform"}, r"did you mean 'log_uniform'"),
            ({"range": (1.2, 0.8)}, r"range of 'stiffness' should rise .* use \(0.8, 1.2\)"),
            ({"range": (0, 1), "distribution": "log_uniform"}, "above 0 with log_uniform"),
            ({"range": (1, -0.1), "distribution": "gaussian"}, "standard deviation is negative"),
            ({"joint_names_expr": ()}, "joint_names_expr is empty"),
            ({"joint_names_expr": ("*",)}, "no regular expression"),
        ],
    )
    def test_of_fields(self, given, text):
        with pytest.raises(ValueError, match=text):
            Randomization(**{"parameter": "stiffness", "range": (0.8, 1.2), **given})

    @pytest.mark.parametrize(
        ("given", "text"),
        [
            ({"range": 1.2}, "range of 'stiffness' should be two numbers"),
            ({"range": None}, "or a composer variation, got None"),
            ({"joint_names_expr": "hip"}, r"use \('hip',\)"),
            ({"parameter": ("stiffness",)}, "parameter should be the name of one"),
        ],
    )
    def test_of_types(self, given, text):
        with pytest.raises(TypeError, match=text):
            Randomization(**{"parameter": "stiffness", "range": (0.8, 1.2), **given})

    @pytest.mark.parametrize(
        ("given", "text"),
        [
            (
                {"parameter": "stifness"},
                r"'stifness': no selected actuator has it \(did you mean 'stiffness'.*\): the "
                r"actuator of 'hip', 'knee' has \['armature'",
            ),
            ({"joint_names_expr": ("elbow",)}, "'elbow' matches none of 'hip', 'knee'"),
            ({"joint_names_expr": (".*", "hip")}, "'hip' is matched by '.*' and by 'hip'"),
            (
                {"range": (-0.1, 1.0)},
                r"'hip': stiffness should be at least 0, got -4.0; that is what scale -0.1 makes "
                r"of the nominal 40: narrow the range \(-0.1, 1.0\)$",
            ),
            ({"range": (-50, 0), "operation": "add"}, "got -10.0; that is what add -50 makes"),
            ({"range": (-1, 9), "operation": "abs"}, "got -1.0; that is what abs -1 makes"),
            (
                {"range": (1.0, 0.4), "distribution": "gaussian"},
                r"got -8.0.*a gaussian ends 3 standard deviations",
            ),
            ({"parameter": "effort_limit", "range": (0, 1)}, "effort_limit should be above 0"),
            ({"parameter": "saturation_effort", "range": (0, 1)}, "should be above 0, got 0.0"),
            ({"parameter": "velocity_limit", "range": (0, 1)}, "should be above 0, got 0.0"),
            ({"parameter": "strength", "range": (-0.5, 1)}, "strength should be .* at least 0"),
            ({"parameter": "armature", "range": (-1, 1)}, "armature should be at least 0"),
            ({"parameter": "frictionloss", "range": (-1, 1)}, "frictionloss should be at least 0"),
            ({"parameter": "viscous_damping", "range": (-1, 1)}, "should be at least 0"),
        ],
    )
    def test_leave_everything_as_it_was(self, given, text):
        _, group = batch_of(DcMotorActuatorCfg(**DC))
        before = snapshot(group)
        randomization = Randomization(**{"parameter": "stiffness", "range": (0.8, 1.2), **given})
        # Whatever is drawn.
        for seed in range(3):
            with pytest.raises(ValueError, match=text):
                randomization.apply(group, rng(seed))
        for key, value in snapshot(group).items():
            assert np.array_equal(value, before[key])

    def test_zero_is_possible_where_the_law_can_bear_it(self):
        _, group = physics_of(DcMotorActuatorCfg(**DC))
        for name in ("stiffness", "damping", "strength", "armature", "frictionloss"):
            Randomization(parameter=name, range=(0.0, 0.0)).apply(group, rng())
            assert not group.actuators[0].get(name).any()

    def test_of_a_delayed_actuator_are_those_of_its_base(self):
        cfg = DelayedActuatorCfg(base_cfg=DcMotorActuatorCfg(**DC), delay_max_lag=4)
        _, group = physics_of(cfg)
        with pytest.raises(ValueError, match="'hip': saturation_effort should be above 0"):
            Randomization(parameter="saturation_effort", range=(0, 1)).apply(group, rng())

    def test_numbers_that_no_config_has(self):
        _, group = physics_of(BuiltinDcMotorActuatorCfg(**NATIVE_DC))
        with pytest.raises(ValueError, match="motor_constant should be finite and above 0, got 0"):
            Randomization(parameter="motor_constant", range=(0, 1)).apply(group, rng())

    def test_limits_of_the_xml(self):
        xml = XML.replace(
            "</worldbody>",
            '</worldbody><actuator><motor name="hip" joint="hip" forcerange="-6 6" '
            'forcelimited="true"/></actuator>',
        )
        _, group = physics_of(XmlMotorActuatorCfg(joint_names_expr=("hip",)), xml=xml)
        with pytest.raises(ValueError, match="'hip': effort_limit should be finite and above 0"):
            Randomization(parameter="effort_limit", range=(0, 1)).apply(group, rng())

    @pytest.mark.parametrize(
        ("parameter", "operation", "what"),
        [
            ("frictionloss", "scale", "the nominal frictionloss of 'hip', 'knee' is 0"),
            ("effort_limit", "scale", "the nominal effort_limit of 'hip', 'knee' is unlimited"),
            ("effort_limit", "add", ".* is unlimited"),
        ],
    )
    def test_of_what_would_change_nothing(self, parameter, operation, what):
        _, group = physics_of(IdealPdActuatorCfg(**{**PD, "effort_limit": None}), xml=BARE)
        with pytest.raises(ValueError, match=f"changes nothing: {what}"):
            Randomization(parameter=parameter, range=(0.5, 1.5), operation=operation).apply(
                group, rng()
            )

    def test_scaling_what_some_joints_have_is_fine(self):
        _, group = physics_of(
            IdealPdActuatorCfg(**PD, frictionloss={"hip": 0.0, "knee": 0.2}), xml=BARE
        )
        Randomization(parameter="frictionloss", range=(2.0, 2.0)).apply(group, rng())
        assert group.actuators[0].get("frictionloss").tolist() == [0, 0.4]

    @pytest.mark.parametrize("source", [0, None, np.random])
    def test_of_a_source_that_is_none(self, source):
        _, group = physics_of(IdealPdActuatorCfg(**PD))
        with pytest.raises(TypeError, match="random_state should be a numpy Generator or Random"):
            Randomization(parameter="stiffness", range=(0.8, 1.2)).apply(group, source)

    def test_of_something_that_is_no_actuator(self):
        with pytest.raises(TypeError, match=r"an initialized Actuator or ActuatorGroup, got \['a"):
            Randomization(parameter="stiffness", range=(0.8, 1.2)).apply(["a"], rng())

    def test_of_actuators_without_physics(self):
        _, group = root_of(IdealPdActuatorCfg(**PD))
        with pytest.raises(RuntimeError, match=r"call initialize\(physics\)"):
            Randomization(parameter="stiffness", range=(0.8, 1.2)).apply(group, rng())

    def test_it_is_frozen(self):
        randomization = Randomization(parameter="stiffness", range=[0.8, 1.2])
        assert randomization == Randomization(parameter="stiffness", range=(0.8, 1.2))
        with pytest.raises(AttributeError, match="cannot assign"):
            randomization.range = (1.0, 2.0)


class Robot(composer.Entity):
    """An entity that runs its actuators, as a walker does."""

    def _build(self, cfgs):
        self._mjcf_root = mjcf.from_xml_string(XML)
        self.actuators_of_mine = ActuatorGroup(cfgs)
        self.actuators_of_mine.edit_mjcf(self._mjcf_root)
        self.cmd = None

    @property
    def mjcf_model(self):
        return self._mjcf_root

    def after_compile(self, physics, random_state):
        self.actuators_of_mine.initialize(physics)

    def initialize_episode(self, physics, random_state):
        self.actuators_of_mine.reset(random_state=random_state)

    def before_substep(self, physics, random_state):
        self.actuators_of_mine.update(physics.timestep())
        self.actuators_of_mine.apply(self.cmd)


class Varied(composer.NullTask):
    """A task that randomizes at the start of each episode."""

    def __init__(self, robot, randomizations):
        super().__init__(robot)
        self.randomizations = randomizations
        self.set_timesteps(control_timestep=0.02, physics_timestep=0.002)

    def action_spec(self, physics):
        from dm_env import specs

        return specs.BoundedArray(shape=(2,), dtype=float, minimum=-1.0, maximum=1.0)

    def before_step(self, physics, action, random_state):
        self.root_entity.cmd = ActuatorCmd(position_target=action)

    def initialize_episode(self, physics, random_state):
        for randomization in self.randomizations:
            randomization.apply(self.root_entity.actuators_of_mine, random_state)


CFGS = (
    DelayedActuatorCfg(
        base_cfg=IdealPdActuatorCfg(**{**PD, "joint_names_expr": ("hip",)}),
        delay_max_lag=8,
        delay_hold_prob=1.0,
    ),
    BuiltinPositionActuatorCfg(**{**PD, "joint_names_expr": ("knee",)}),
)


class TestComposer:
    def environment(self, recompile, *randomizations, cfgs=CFGS, seed=0):
        task = Varied(Robot(cfgs), randomizations)
        return composer.Environment(task, random_state=seed, recompile_mjcf_every_episode=recompile)

    def episode(self, environment):
        environment.reset()
        group = environment.task.root_entity.actuators_of_mine
        values = {
            (a.joint_names[0], name): a.get(name).item()
            for a in group.actuators
            for name in a.parameters
        }
        trajectory = []
        for action in rng(3).uniform(-1, 1, size=(10, 2)):
            environment.step(action)
            trajectory.append(environment.physics.data.qpos.copy())
        return values, np.array(trajectory)

    @pytest.mark.parametrize("recompile", [True, False])
    def test_every_episode_starts_from_the_nominal_values(self, recompile):
        environment = self.environment(
            recompile,
            Randomization(parameter="stiffness", range=(0.8, 1.2)),
            Randomization(parameter="armature", range=distributions.Uniform(0.8, 1.2)),
            Randomization(parameter="delay", range=(0, 8), operation="abs"),
        )
        seen = []
        for _ in range(30):
            values, _ = self.episode(environment)
            for joint, armature in (("hip", 0.01), ("knee", 0.02)):
                assert 32 <= values[joint, "stiffness"] <= 48
                assert 0.8 * armature <= values[joint, "armature"] <= 1.2 * armature
                assert values[joint, "damping"] == 1
            lag = environment.task.root_entity.actuators_of_mine.actuators[0].lag("position")
            assert lag == values["hip", "delay_min_lag"] == values["hip", "delay_max_lag"]
            seen.append(values)
        for key in (("hip", "stiffness"), ("knee", "stiffness"), ("knee", "armature")):
            assert len({values[key] for values in seen}) == 30
        assert len({values["hip", "delay_min_lag"] for values in seen}) > 4

    def test_recompilation_makes_no_difference(self):
        episodes = []
        for recompile in (True, False):
            environment = self.environment(
                recompile,
                Randomization(parameter="stiffness", range=(0.8, 1.2)),
                Randomization(parameter="frictionloss", range=(0.5, 2.0)),
                Randomization(parameter="armature", range=(0.5, 2.0)),
            )
            episodes.append([self.episode(environment) for _ in range(3)])
        for (values, trajectory), (others, other) in zip(*episodes, strict=True):
            assert values == others
            assert np.array_equal(trajectory, other)

    def test_an_episode_is_that_of_the_numbers_configured(self):
        cfg = BuiltinPositionActuatorCfg(**PD)
        randomization = Randomization(parameter="stiffness", range=(20, 60), operation="abs")
        environment = self.environment(False, randomization, cfgs=(cfg,))
        for _ in range(3):
            environment.reset()
        stiffness = environment.task.root_entity.actuators_of_mine.actuators[0].get("stiffness")
        numbers = dict(zip(("hip", "knee"), stiffness.tolist(), strict=True))
        configured = self.environment(
            True, cfgs=(BuiltinPositionActuatorCfg(**{**PD, "stiffness": numbers}),)
        )
        configured.reset()
        for action in rng(3).uniform(-1, 1, size=(10, 2)):
            environment.step(action)
            configured.step(action)
            assert np.array_equal(environment.physics.data.qpos, configured.physics.data.qpos)

    def test_the_seed_of_the_environment_settles_it(self):
        randomization = Randomization(parameter="stiffness", range=(0.8, 1.2))
        one, same, other = (self.environment(True, randomization, seed=s) for s in (1, 1, 2))
        first = self.episode(one)[0]
        assert first == self.episode(same)[0]
        assert first != self.episode(other)[0]
        assert first != self.episode(one)[0]


def test_dm_control_is_not_loaded():
    code = (
        "import sys, walkerkit.actuators, walkerkit.actuators.randomize\n"
        "sys.exit([name for name in sys.modules if name.startswith('dm_control')] or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


def test_plain_mujoco():
    root, group = root_of(IdealPdActuatorCfg(**PD))
    model = mjcf.Physics.from_mjcf_model(root).model.ptr
    group.initialize((model, mujoco.MjData(model)))
    Randomization(parameter="armature", range=(2.0, 2.0)).apply(group, rng())
    assert model.dof_armature.tolist() == [0.02, 0.04]
