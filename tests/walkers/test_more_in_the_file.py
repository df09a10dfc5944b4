"""Files with more in them than one robot of which each joint has one actuator."""

from __future__ import annotations

import numpy as np
import pytest
from dm_control import composer

from benchmarks.robots.written import WRITTEN
from walkerkit.actuators import BuiltinPdActuatorCfg, XmlInputsActuatorCfg
from walkerkit.walkers import MjcfWalker

MULTI = """
<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body><joint name="a" axis="0 1 0" armature="0.01"/><geom size="0.1" mass="1"/></body>
  </worldbody>
  <tendon><fixed name="t"><joint joint="a" coef="1"/></fixed></tendon>
  <actuator>
    <dcmotor name="d" tendon="t" motorconst=".1 .1" resistance=".5" input="pos vel ff"
      controller="1 0 .05"/>
  </actuator>
</mujoco>
"""


class Alone(composer.Task):
    def __init__(self, walker):
        self._arena, self._walker = composer.Arena(), walker
        walker.create_root_joints(self._arena.attach(walker))
        self.set_timesteps(0.02, 0.002)

    @property
    def root_entity(self):
        return self._arena

    def before_step(self, physics, action, random_state):
        self._walker.apply_action(physics, action, random_state)

    def get_reward(self, physics):
        return 0.0


@pytest.fixture
def write(tmp_path):
    def written(name, text=None):
        path = tmp_path / f"{name}.xml"
        path.write_text(text or WRITTEN[name], encoding="utf-8")
        return path

    return written


def stepped(walker, actions=5):
    environment = composer.Environment(Alone(walker), random_state=0)
    environment.reset()
    spec = environment.action_spec()
    assert spec.shape == walker.action_spec.shape
    for _ in range(actions):
        environment.step(np.zeros(spec.shape))
    assert np.isfinite(environment.physics.data.qpos).all()
    return environment


@pytest.mark.parametrize(
    ("name", "joints", "kept"),
    [
        ("pair", ("shoulder", "elbow"), ()),
        ("two_servos", ("shoulder", "elbow"), ()),
        ("door", ("hip", "knee"), ()),
        ("mimic", ("shoulder", "elbow", "left_finger"), ()),
        ("mimic_with_two_servos", ("shoulder", "elbow", "left_finger", "right_finger"), ()),
        ("gripper_on_a_tendon", ("shoulder", "elbow"), ("grip",)),
        ("slidercrank", ("elbow",), ("piston",)),
        ("joint_in_parent", ("shoulder", "elbow"), ()),
        ("four_bar", ("crank",), ()),
        ("dc_motors", ("shoulder", "elbow"), ()),
        ("many_inputs", ("shoulder", "elbow"), ()),
        ("muscle", ("shoulder",), ("biceps",)),
    ],
)
def test_its_own_actuators(write, name, joints, kept):
    walker = MjcfWalker.from_file(write(name))
    assert walker.actuator_group.joint_names == joints
    left = [element.name for element in walker.drivetrain.kept]
    assert left == [*kept] if name != "two_servos" else ["elbow_2"]
    stepped(walker)


def test_a_pair_has_a_number_for_each_target(write):
    walker = MjcfWalker.from_file(write("pair"))
    assert walker.action_spec.name.split("\t") == ["shoulder", "elbow", "elbow"]
    kinds = [type(cfg) for cfg in walker.actuator_group.cfgs]
    assert kinds[-1] is XmlInputsActuatorCfg
    environment = stepped(walker, 1)
    environment.step([0.0, 0.0, 0.5])
    np.testing.assert_allclose(walker.command.velocity_target, [0.0, 5.0])


def test_a_kept_actuator_takes_as_many_numbers_as_it_has_inputs(write):
    walker = MjcfWalker.from_file(write("multi", MULTI))
    assert walker.action_spec.name.split("\t") == ["d[0]", "d[1]", "d[2]"]
    environment = composer.Environment(Alone(walker), random_state=0)
    environment.reset()
    environment.step([0.5, 0.25, 1.0])
    np.testing.assert_array_equal(environment.physics.data.ctrl, [0.5, 0.25, 1.0])


def test_a_follower_stands_where_it_is_put(write):
    text = WRITTEN["mimic"].replace(
        'joint2="left_finger"/>', 'joint2="left_finger" polycoef="0.01 -0.5 0 0 0"/>'
    )
    walker = MjcfWalker.from_file(write("mimic", text), home={"left_finger": 0.02})
    np.testing.assert_allclose(walker.home, [0.0, 0.0, 0.02, 0.01 - 0.5 * 0.02])
    explicit = {"left_finger": 0.02, "right_finger": 0.0}
    walker = MjcfWalker.from_file(write("mimic", text), home=explicit)
    np.testing.assert_allclose(walker.home, [0.0, 0.0, 0.02, 0.0])


def test_one_degree_of_freedom_gets_one_drive(write):
    path = write("mimic_with_two_servos")
    gains = {"stiffness": 300.0, "damping": 10.0}
    walker = MjcfWalker.from_file(path, BuiltinPdActuatorCfg(joint_names_expr=(".*",), **gains))
    assert walker.actuator_group.joint_names == ("shoulder", "elbow", "left_finger")
    assert not walker.drivetrain.kept  # the second servo would hold it back
    both = BuiltinPdActuatorCfg(joint_names_expr=("left_finger", "right_finger"), **gains)
    walker = MjcfWalker.from_file(path, both)
    assert walker.actuator_group.joint_names == ("left_finger", "right_finger")


def test_numbers_may_be_said_of_a_follower_too(write):
    cfg = BuiltinPdActuatorCfg(
        joint_names_expr=(".*",),
        stiffness={"shoulder|elbow": 10.0, "left_finger": 20.0, "right_finger": 30.0},
        damping=1.0,
    )
    walker = MjcfWalker.from_file(write("mimic"), cfg)
    environment = stepped(walker, 1)
    assert environment.physics.model.nu == 3
    np.testing.assert_allclose(
        walker.actuator_group.actuators[0].nominal("stiffness"), [10.0, 10.0, 20.0]
    )
