"""What a robot stands on, held to MuJoCo's own distances and to finite differences."""

import mujoco
import numpy as np
import pytest

from walkerkit.gap.simulation.base import find_base, imu_mounting
from walkerkit.gap.simulation.feet import Legs, find_feet, lowest
from walkerkit.walkers import BIPED_XML, QUADRUPED_XML

FLOOR = '<geom name="floor" type="plane" size="0 0 1"/>'
SHAPES = {
    "sphere": 'size="0.05"',
    "capsule": 'size="0.03 0.08"',
    "cylinder": 'size="0.03 0.08"',
    "ellipsoid": 'size="0.03 0.05 0.08"',
    "box": 'size="0.03 0.05 0.08"',
    "mesh": 'mesh="wedge"',
}
WEDGE = '<asset><mesh name="wedge" vertex="0 0 0 .1 0 0 0 .08 0 0 0 .05 .1 .08 .06"/></asset>'


def standing(path):
    spec = mujoco.MjSpec.from_file(str(path))
    spec.worldbody.add_geom(name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    model = spec.compile()
    return model, find_base(model, "robot.xml")


@pytest.mark.parametrize("shape", SHAPES)
def test_the_lowest_point_is_as_far_from_a_plane_as_mujoco_says(shape):
    text = (
        f"<mujoco>{WEDGE}<worldbody>{FLOOR}<body pos='0 0 1'><freejoint/>"
        f"<geom name='g' type='{shape}' {SHAPES[shape]} mass='1'/></body></worldbody></mujoco>"
    )
    model = mujoco.MjModel.from_xml_string(text)
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    for _ in range(10):
        quaternion = rng.standard_normal(4)
        data.qpos[3:7] = quaternion / np.linalg.norm(quaternion)
        mujoco.mj_kinematics(model, data)
        far = mujoco.mj_geomDistance(model, data, 0, 1, 5.0, None)
        point = lowest(model, data, 1, np.array([0.0, 0.0, -1.0]))
        assert point[2] == pytest.approx(far, abs=2e-6)


@pytest.mark.parametrize(
    ("path", "names"),
    [
        (QUADRUPED_XML, ("FL_foot", "FR_foot", "RL_foot", "RR_foot")),
        (BIPED_XML, ("left_foot", "right_foot")),
    ],
)
def test_feet_are_what_the_robot_stands_on(path, names):
    model, base = standing(path)
    feet = find_feet(model, base)
    assert tuple(foot.name for foot in feet) == names
    for foot in feet:
        assert foot.name in foot.names
        assert {model.geom(g).name for g in foot.geoms} == {foot.name}
    assert find_feet(model, None) == ()


def test_feet_may_have_contact_pairs_of_their_own():
    text = QUADRUPED_XML.read_text()
    pairs = "".join(f'<pair geom1="{leg}_foot" geom2="floor"/>' for leg in ("FL", "RR"))
    text = text.replace("</mujoco>", f"<contact>{pairs}</contact></mujoco>")
    text = text.replace("<worldbody>", f"<worldbody>{FLOOR}")
    model = mujoco.MjModel.from_xml_string(text)
    assert len(find_feet(model, find_base(model, "robot.xml"))) == 4


def test_velocities_are_those_of_the_points_that_are_fixed_to_the_feet():
    model, base = standing(QUADRUPED_XML)
    feet, rng, dt = find_feet(model, base), np.random.default_rng(1), 1e-6
    qpos = np.tile(model.key_qpos[0], (2, 1))
    qvel = np.zeros((2, model.nv))
    qvel[:, 6:] = rng.standard_normal(12)
    qpos[1, 7:] += dt * qvel[0, 6:]
    legs = Legs(model, base, feet, qpos, qvel, np.repeat([0.0, 0.01], [6, 12]))
    down = np.tile([0.1, 0.2, -1.0] / np.linalg.norm([0.1, 0.2, -1.0]), (2, 1))
    data = mujoco.MjData(model)
    for f, foot in enumerate(feet):
        point = legs.point(f, down)[0]
        seen = []
        for row in qpos:
            data.qpos[:] = row
            data.qpos[:7] = (0, 0, 0, 1, 0, 0, 0)
            mujoco.mj_kinematics(model, data)
            seen.append((data.xpos[foot.body].copy(), data.xmat[foot.body].reshape(3, 3).copy()))
        fixed = seen[0][1].T @ (point - seen[0][0])
        moved = seen[1][0] + seen[1][1] @ fixed
        velocity = legs.velocity(f, np.tile(point, (2, 1)))[0]
        np.testing.assert_allclose(velocity, (moved - point) / dt, atol=1e-5)
    assert (legs.noise > 1e-3).all()
    assert (legs.noise < 0.01).all()


def test_a_unit_is_where_its_site_is():
    text = (
        "<mujoco><worldbody><body name='b'><freejoint/><geom size='0.1'/><body pos='0.1 0 0' "
        "quat='0 0 0 1'><geom size='0.1'/><site name='{}' pos='0.02 0 0.03'/></body></body>"
        "</worldbody></mujoco>"
    )
    place, turned = imu_mounting(mujoco.MjModel.from_xml_string(text.format("imu")), 1)
    np.testing.assert_allclose(place, (0.08, 0, 0.03), atol=1e-12)
    np.testing.assert_allclose(turned, np.diag([-1.0, -1.0, 1.0]), atol=1e-12)
    place, turned = imu_mounting(mujoco.MjModel.from_xml_string(text.format("other")), 1)
    np.testing.assert_array_equal(place, np.zeros(3))
    np.testing.assert_array_equal(turned, np.eye(3))
