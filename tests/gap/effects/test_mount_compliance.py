"""What a robot is mounted on, where that gives way."""

import mujoco
import numpy as np
import pytest

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import JOINTS, LEG, PLAIN, robot_of
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.mount import MOUNTS, STAND, with_mount

STIFFNESS, RATIO = 400.0, 0.15  # N·m/rad, 1
STAND_XML = """
<body name="stand">
  <joint name="sideways" axis="1 0 0" stiffness="{k}" damping="{damping[0]}"/>
  <joint name="forwards" axis="0 1 0" stiffness="{k}" damping="{damping[1]}"/>
  <inertial pos="0 0 0" mass="1e-4" diaginertia="{inertia[0]} {inertia[1]} {inertia[0]}"/>
  <body name="thigh">"""


def on_a_stand(carried, damping):
    """The leg of the machine on a body of its own, which springs hold upright."""
    text = LEG.format(**PLAIN)
    stand = STAND_XML.format(k=STIFFNESS, damping=damping, inertia=STAND * carried)
    text = text.replace('<body name="thigh">', stand).replace("</worldbody>", "</body></worldbody>")
    return mujoco.MjModel.from_xml_string(text)


class TestMountCompliance(EffectContract):
    name = "mount_compliance"
    seconds = 2.0
    rounding = 2e-5  # the stand's stiffness and inertia are written with eight digits

    def plant(self, machine):
        # What the stand carries in the reference pose, by the same leg on a stand of next to none.
        without = on_a_stand(np.full(2, 1e-6), np.ones(2))
        carried = without.dof_M0[:2]
        damping = 2 * RATIO * np.sqrt(STIFFNESS * carried * (1 + STAND))
        machine.model = on_a_stand(carried, damping)
        return {EVERYWHERE: [1 / STIFFNESS, RATIO]}


class TestMount:
    def test_is_under_every_joint_and_a_mended_model_has_no_other(self):
        robot, _ = robot_of(PLAIN)
        mounted = with_mount(robot)
        assert tuple(mounted.joints) == (*MOUNTS, *JOINTS)
        assert CATALOGUE["mount_compliance"].sites(mounted, JOINTS) == ()
        with pytest.raises(ValueError, match="no mount can be put under it"):
            with_mount(mounted)

    def test_turns_about_the_world_s_axes_however_the_body_lies(self):
        text = LEG.format(**PLAIN).replace('<body name="thigh">', '<body euler="0.3 -0.5 1.1">')
        mounted = with_mount(robot_from_spec(mujoco.MjSpec.from_string(text), "leg.xml"))
        data = mujoco.MjData(mounted.model)
        mujoco.mj_kinematics(mounted.model, data)
        axes = data.xaxis[[mounted.joints[name].id for name in MOUNTS]]
        np.testing.assert_allclose(axes, np.eye(3)[:2], atol=1e-9)

    def test_is_for_robots_that_do_not_float(self):
        trunk = '<body><freejoint/><geom size="0.1" mass="2"/><body name="thigh">'
        text = LEG.format(**PLAIN).replace('<body name="thigh">', trunk)
        text = text.replace("</worldbody>", "</body></worldbody>")
        robot = robot_from_spec(mujoco.MjSpec.from_string(text), "leg.xml")
        assert CATALOGUE["mount_compliance"].sites(robot, JOINTS) == ()
