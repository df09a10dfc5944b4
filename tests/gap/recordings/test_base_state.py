"""The base's measured pose and velocity, against MuJoCo's own quaternions and free joint."""

import mujoco
import numpy as np
import pytest

from walkerkit.gap.recordings.base_state import (
    BaseState,
    angles,
    base_signal,
    missing,
    turned,
    with_checked_base,
)
from walkerkit.gap.recordings.recording import Recording

BOX = """
<mujoco><option timestep="0.001"/><worldbody><body name="box"><freejoint/>
  <geom type="box" size="0.1 0.2 0.3" mass="1"/></body></worldbody></mujoco>
"""


STEP = 6e-3  # m/s; half of what gravity adds in a step of semi-implicit integration, and more


def tumbling(seconds=1.0, start=(1, 0, 0, 0)):
    """The flight of a box that turns about all axes, (T, 7) poses and (T, 6) velocities."""
    model = mujoco.MjModel.from_xml_string(BOX)
    data = mujoco.MjData(model)
    data.qpos[3:] = start
    data.qvel[:] = (0.3, -0.2, 4.9, 1.1, 0.4, -0.9)
    rows = []
    for _ in range(round(seconds / model.opt.timestep)):
        rows.append(np.r_[data.qpos, data.qvel])
        mujoco.mj_step(model, data)
    poses, velocities = np.split(np.array(rows), [7], axis=1)
    return model.opt.timestep * np.arange(len(rows)), poses, velocities


def log(time, poses, velocities=None, **columns):
    names = [f"base/position_{a}" for a in "xyz"] + [f"base/quaternion_{a}" for a in "wxyz"]
    found = dict(zip(names, poses.T, strict=True))
    if velocities is not None:
        kinds = [f"base/{kind}_velocity_{a}" for kind in ("linear", "angular") for a in "xyz"]
        found |= dict(zip(kinds, velocities.T, strict=True))
    joint = {"knee/position": np.sin(time), "knee/position_target": np.zeros_like(time)}
    return Recording(name="log", time=time, columns=joint | found | columns)


def test_the_state_is_that_of_the_free_joint():
    time, poses, velocities = tumbling()
    for recording in (log(time, poses), log(time, poses, velocities)):
        pose, velocity = BaseState(recording).at(time[50:-50])
        np.testing.assert_allclose(pose, poses[50:-50], atol=1e-5)
        np.testing.assert_allclose(velocity, velocities[50:-50], atol=STEP)


def test_a_flipped_quaternion_is_the_same_pose():
    time, poses, velocities = tumbling()
    flipped = poses.copy()
    flipped[::2, 3:] *= -1
    one, other = BaseState(log(time, poses)), BaseState(log(time, flipped))
    for mine, theirs in zip(one.at(time), other.at(time), strict=True):
        np.testing.assert_allclose(np.abs(mine), np.abs(theirs), atol=1e-12)
    np.testing.assert_allclose(other.at(time)[1][50:-50], velocities[50:-50], atol=STEP)
    for axis in "xyz":
        signal = f"orientation_{axis}"
        np.testing.assert_allclose(
            base_signal(log(time, flipped), signal), base_signal(log(time, poses), signal)
        )


def test_a_logged_velocity_is_used_and_one_in_the_wrong_frame_is_not():
    half_turn = (np.cos(1.5), 0.0, 0.0, np.sin(1.5))
    time, poses, velocities = tumbling(start=half_turn)
    rng = np.random.default_rng(0)
    noisy = poses.copy()
    noisy[:, :3] += 2e-3 * rng.normal(size=(len(time), 3))
    state = BaseState(log(time, noisy, velocities))
    assert state.contradictions == ()
    np.testing.assert_allclose(state.at(time[50:-50])[1], velocities[50:-50], atol=STEP)
    in_body = velocities.copy()
    for row, (pose, velocity) in enumerate(zip(poses, velocities, strict=True)):
        inverse = np.zeros(4)
        mujoco.mju_negQuat(inverse, pose[3:])
        mujoco.mju_rotVecQuat(in_body[row, :3], velocity[:3], inverse)
    state = BaseState(log(time, poses, in_body))
    assert state.contradictions == ("base/linear_velocity_x",)
    (note,) = with_checked_base(log(time, poses, in_body)).notes
    assert note.startswith("base/linear_velocity_x, _y and _z contradict how the base's pose")
    assert "log them in the world's frame" in note
    (note,) = with_checked_base(log(time, poses, velocities * [1, 1, 1, 3, 3, 3])).notes
    assert note.startswith("base/angular_velocity_x, ")
    assert "log them in the base's frame" in note
    for fine in (log(time, poses), log(time, noisy, velocities)):
        assert with_checked_base(fine) is fine
    np.testing.assert_allclose(state.at(time[50:-50])[1], velocities[50:-50], atol=STEP)


def test_angles_are_roll_pitch_and_yaw():
    wanted = np.array([0.3, -0.4, 2.9])
    turn = np.array([1.0, 0, 0, 0])
    for axis, angle in zip(np.eye(3)[::-1], wanted[::-1], strict=True):
        once = np.zeros(4)
        mujoco.mju_axisAngle2Quat(once, axis, angle)
        mujoco.mju_mulQuat(turn, turn.copy(), once)
    np.testing.assert_allclose(angles(turn[None])[0], wanted, atol=1e-12)


@pytest.mark.parametrize("size", [0.0, 1e-12, 1e-3, 1.0, 3.1])
def test_turned_is_mujoco_s_own_difference(size):
    rng = np.random.default_rng(3)
    first, axis = rng.normal(size=4), rng.normal(size=3)
    first /= np.linalg.norm(first)
    axis *= size / np.linalg.norm(axis)
    second = first.copy()
    mujoco.mju_quatIntegrate(second, axis, 1.0)
    expected = np.zeros(3)
    mujoco.mju_subQuat(expected, second, first)
    for sign in (1, -1):
        np.testing.assert_allclose(turned(first, sign * second), expected, atol=1e-9)


def test_a_pose_that_is_not_whole_is_said_to_be_missing():
    time, poses, _ = tumbling(0.1)
    whole = log(time, poses)
    assert missing(whole) == ()
    part = {n: v for n, v in whole.columns.items() if not n.startswith("base/position")}
    part = Recording(name="part", time=time, columns=part)
    assert missing(part) == tuple(f"base/position_{axis}" for axis in "xyz")
    assert base_signal(part, "orientation_x") is None
    np.testing.assert_array_equal(base_signal(whole, "position_z"), poses[:, 2])
