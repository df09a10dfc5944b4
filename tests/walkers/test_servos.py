"""Motors as PD drives, and the same drives left to MuJoCo."""

import math

import mujoco
import numpy as np
import pytest
from dm_control import mjcf

from walkerkit.actuators import (
    DcMotorActuatorCfg,
    ElectricActuator,
    IdealPdActuatorCfg,
    XmlPositionActuatorCfg,
)
from walkerkit.walkers.servos import choose, motor_pd, scaled_servos

MOTOR = ElectricActuator(reflected_inertia=0.01, velocity_limit=20.0, effort_limit=30.0)
ARM = """
<mujoco model="arm">
  <compiler angle="radian" autolimits="true"/>
  <worldbody>
    <body><joint name="a" axis="0 1 0" range="-1 2"/><geom size="0.1" mass="1"/>
      <body><joint name="b" axis="0 1 0" range="0 1"/><geom size="0.1" pos="0 0 1" mass="1"/>
        <body><joint name="c" axis="0 1 0" range="-3 1"/><geom size="0.1" pos="0 0 1" mass="1"/>
    </body></body></body>
  </worldbody>
</mujoco>
"""


def arm():
    return mjcf.from_xml_string(ARM)


def compiled(root):
    return mujoco.MjModel.from_xml_string(root.to_xml_string())


class TestMotorPd:
    def test_gains_are_those_of_the_motor_s_inertia(self):
        cfg = motor_pd(("a",), MOTOR, frequency=10.0, ratio=2.0)
        omega = 2 * math.pi * 10
        assert isinstance(cfg, DcMotorActuatorCfg)
        assert cfg.stiffness == pytest.approx(0.01 * omega**2)
        assert cfg.damping == pytest.approx(2 * 2.0 * 0.01 * omega)
        assert (cfg.effort_limit, cfg.velocity_limit) == (30.0, 20.0)
        assert cfg.armature is None

    def test_stall_torque_is_the_effort_limit_where_none_is_published(self):
        assert motor_pd(("a",), MOTOR, frequency=1.0, ratio=1.0).saturation_effort == 30.0
        strong = ElectricActuator(
            reflected_inertia=0.01, velocity_limit=20.0, effort_limit=30.0, saturation_effort=45.0
        )
        assert motor_pd(("a",), strong, frequency=1.0, ratio=1.0).saturation_effort == 45.0


class TestScaledServos:
    def test_have_gains_limits_and_ranges_in_kinematic_order(self):
        root = arm()
        cfg = scaled_servos(
            root,
            [
                IdealPdActuatorCfg(
                    joint_names_expr=("c", "b"),
                    stiffness={"c": 7.0, "b": 5.0},
                    damping=0.5,
                    effort_limit={"b": 2.0, "c": 3.0},
                ),
                IdealPdActuatorCfg(joint_names_expr=("a",), stiffness=9.0, damping=0.1),
            ],
        )
        assert cfg == XmlPositionActuatorCfg(joint_names_expr=("a", "b", "c"))
        model = compiled(root)
        assert [model.actuator(i).name for i in range(3)] == ["a", "b", "c"]
        np.testing.assert_allclose(
            model.actuator_biasprm[:, 1:3], [[-9, -0.1], [-5, -0.5], [-7, -0.5]]
        )
        np.testing.assert_allclose(model.actuator_forcerange, [[0, 0], [-2, 2], [-3, 3]])
        np.testing.assert_array_equal(model.actuator_forcelimited, [0, 1, 1])
        np.testing.assert_allclose(model.actuator_ctrlrange, [[-1, 1]] * 3)
        data = mujoco.MjData(model)
        for end, column in ((-1.0, 0), (1.0, 1)):
            # At the target itself a servo rests.
            data.qpos[:] = model.jnt_range[:, column]
            data.ctrl[:] = end
            mujoco.mj_forward(model, data)
            np.testing.assert_allclose(data.actuator_force, 0.0, atol=1e-12)

    def test_leave_other_joints_alone(self):
        root = arm()
        scaled_servos(
            root, [IdealPdActuatorCfg(joint_names_expr=("b",), stiffness=1.0, damping=0.0)]
        )
        assert [element.name for element in root.find_all("actuator")] == ["b"]


class TestChoose:
    DRIVES = (motor_pd((".*",), MOTOR, frequency=10.0, ratio=1.0),)

    def test_the_default_what_was_given_or_the_servos(self):
        given = IdealPdActuatorCfg(joint_names_expr=(".*",), stiffness=1.0, damping=1.0)
        root = arm()
        assert choose(root, self.DRIVES, None, False) is self.DRIVES
        assert choose(root, self.DRIVES, given, False) is given
        assert root.find_all("actuator") == []
        assert isinstance(choose(root, self.DRIVES, None, True), XmlPositionActuatorCfg)
        assert len(root.find_all("actuator")) == 3

    def test_not_both(self):
        root = arm()
        with pytest.raises(ValueError, match="position_controlled=True and actuators="):
            choose(root, self.DRIVES, self.DRIVES, True)
        assert root.find_all("actuator") == []
