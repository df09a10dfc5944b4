"""A velocity and the slope of its position that differ by a constant, and what only looks so."""

import mujoco
import numpy as np
import pytest
from scipy.signal import lfilter

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.units import with_checked_velocities
from walkerkit.gap.velocities import disagreement, held_ripple

RATE = 250.0
TIME = np.arange(0, 12, 1 / RATE)
SWING = 0.5 * np.sin(1.3 * TIME) + 0.2 * np.sin(4.1 * TIME) + 0.05 * np.sin(11 * TIME)
SPEED = 0.65 * np.cos(1.3 * TIME) + 0.82 * np.cos(4.1 * TIME) + 0.55 * np.cos(11 * TIME)
ROBOT = """<mujoco><worldbody><body><joint name="knee" axis="0 1 0"/>
<geom size="0.1"/></body></worldbody><actuator><position joint="knee" kp="9"/></actuator>
</mujoco>"""


def log(velocity, position=SWING, seed=0, noise=0.01):
    rng = np.random.default_rng(seed)
    columns = {
        "knee/position": position + 1e-4 * rng.standard_normal(TIME.size),
        "knee/velocity": velocity + noise * rng.standard_normal(TIME.size),
        "knee/position_target": position,
    }
    return Recording(name="log", time=TIME, columns=columns)


def checked(recording):
    return with_checked_velocities(
        robot_from_spec(mujoco.MjSpec.from_string(ROBOT), "knee.xml"), recording
    )


@pytest.mark.parametrize("factor", [0.4, 0.85, 0.93, 1.08, 2.28, 5.0])
def test_a_constant_factor_is_told_and_the_velocity_not_compared(factor):
    recording = checked(log(factor * SPEED))
    assert "knee/velocity" not in recording.columns
    assert "knee/velocity" in recording.unused
    (note,) = recording.notes
    assert f"is {factor:.3g} times the slope of knee/position, with a correlation of 0.99" in note
    assert "is not compared" in note


def test_a_constant_offset_is_told():
    found = disagreement(log(SPEED + 0.3), "knee")
    assert found.factor == 1.0
    assert found.offset == pytest.approx(0.3, abs=0.02)
    (note,) = checked(log(SPEED + 0.3)).notes
    assert "is the slope of knee/position +0.3 rad/s" in note


def test_a_wheel_at_one_speed_has_a_factor():
    turning = checked(log(0.4 * np.full(TIME.size, 3.0), position=3.0 * TIME))
    assert "is 0.4 times the slope" in turning.notes[0]
    assert checked(log(np.full(TIME.size, 3.0), position=3.0 * TIME)).notes == ()


@pytest.mark.parametrize(
    "read",
    [
        lambda v: v,
        lambda v: 1.01 * v,
        lambda v: lfilter([1 - 0.9], [1, -0.9], v),  # 40 ms, which slow motion hardly shows
        lambda v: np.trunc(v / 0.1) * 0.1,
        lambda v: np.floor(v / 0.05) * 0.05,
        lambda v: np.random.default_rng(1).standard_normal(v.size),
        lambda v: 0 * v,
    ],
    ids=["right", "a per cent", "filtered", "truncated", "floored", "noise", "zeros"],
)
def test_what_is_no_constant_is_compared(read):
    for seed in range(5):
        noise = np.random.default_rng(seed).standard_normal(TIME.size)
        recording = log(read(SPEED + 0.01 * noise), seed=seed, noise=0.0)
        assert disagreement(recording, "knee") is None
        assert "knee/velocity" in checked(recording).columns


def test_positions_in_revolutions_are_refused_and_a_gear_of_six_is_not():
    with pytest.raises(InputError, match=r"6.28 times.*'knee/position' looks like revolutions"):
        checked(log(SPEED, position=SWING / (2 * np.pi)))
    assert "is 6 times the slope" in checked(log(6 * SPEED)).notes[0]


def servoed(rate, factor=1.0):
    """A log of a stiff servo whose targets are held from row to row, with MuJoCo's own velocity."""
    model = mujoco.MjModel.from_xml_string(SERVO)
    data = mujoco.MjData(model)
    steps = round(1 / rate / model.opt.timestep)
    time = np.arange(0, 8, 1 / rate)
    target = 0.4 * np.sin(1.3 * time) + 0.2 * np.sin(4.1 * time)
    states = np.empty((time.size, 2))
    for row in range(time.size):
        data.ctrl[:], states[row] = target[row], [data.qpos[0], data.qvel[0]]
        mujoco.mj_step(model, data, steps)
    names = ("knee/position", "knee/velocity", "knee/position_target")
    columns = dict(zip(names, (states[:, 0], factor * states[:, 1], target), strict=True))
    robot = robot_from_spec(mujoco.MjSpec.from_string(SERVO), "knee.xml")
    return robot, Recording(name="log", time=time, columns=columns)


SERVO = """<mujoco><option timestep="0.001" integrator="implicitfast"/><worldbody><body>
<joint name="knee" axis="0 1 0" armature="0.005"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.012" mass="0.2"/></body></worldbody>
<actuator><position joint="knee" kp="60" kv="3"/></actuator></mujoco>"""


@pytest.mark.parametrize("rate", [100, 50])
def test_a_servo_that_slows_down_before_each_target_has_no_other_unit(rate):
    robot, recording = servoed(rate)
    least, most = held_ripple(1 / rate, inertia=0.0077, stiffness=60.0, damping=3.0)
    found = disagreement(recording, "knee")
    assert found.factor == pytest.approx(least, abs=0.02)
    assert most == 1.0
    assert with_checked_velocities(robot, recording).notes == ()
    robot, recording = servoed(rate, factor=0.5)
    assert "times the slope" in with_checked_velocities(robot, recording).notes[0]
