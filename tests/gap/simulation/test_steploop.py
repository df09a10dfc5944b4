"""Laws step by step, held to what MuJoCo does natively where it has the same law."""

import mujoco
import numpy as np
import pytest

from tests.gap.simulation.arm import CHANNELS, arm, arm_text
from walkerkit.actuators.drivetrain.controller import SampleAndHold, SetpointFilter, SlewLimit
from walkerkit.actuators.drivetrain.drive_stage import ActuatorLag, Cogging, QuadraticDrag
from walkerkit.actuators.drivetrain.joint_friction import AsymmetricFriction, LoadDependentFriction
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.trials import Trials

STEP = 0.002


def recording(n=500, start=0.0):
    time = start + STEP * np.arange(n)
    return Recording(
        name="log",
        time=time,
        columns={
            "hip/position": np.full(n, 0.1),
            "knee/position": np.full(n, 0.4),
            "hip/position_target": 0.1 + 0.4 * np.sign(np.sin(5 * (time - start))),
            "knee/position_target": 0.4 + 0.35 * np.sin(7 * (time - start)),
        },
    )


def predict(robot, law=None, joint="knee", hold="zero_order", n=1, **parameters):
    trials = Trials(robot, n)
    if law is not None:
        for name, value in parameters.items():
            trials.law(law, joint)[name][:] = value
    return Replay(robot, whole(recording()), CHANNELS, hold=hold, n_threads=1).predict(trials)


@pytest.mark.parametrize("integrator", ["Euler", "implicitfast"])
def test_a_law_too_small_to_matter_changes_not_one_bit(integrator):
    robot = arm(integrator=integrator)
    native = predict(robot)
    np.testing.assert_array_equal(predict(robot, Cogging, amplitude=1e-300), native)
    np.testing.assert_array_equal(predict(robot, SlewLimit, rate=1e8), native)


def test_laws_and_none_side_by_side():
    robot = arm()
    trials = Trials(robot, 3)
    trials.law(Cogging, "knee")["amplitude"][:] = [0.0, 0.5, 0.0]
    together = Replay(robot, whole(recording()), CHANNELS, n_threads=2).predict(trials)
    np.testing.assert_array_equal(together[[0, 2]], np.tile(predict(robot), (2, 1, 1)))
    np.testing.assert_array_equal(together[1:2], predict(robot, Cogging, amplitude=0.5))
    assert np.abs(together[1] - together[0])[:, 1].max() > 1e-3


def test_dry_friction_is_mujoco_s():
    by_law = predict(arm(), AsymmetricFriction, forward=0.25, backward=0.25)
    np.testing.assert_array_equal(by_law, predict(arm(dry="0.35")))


def test_asymmetric_friction_is_a_bias_and_the_mean():
    robot = arm()
    by_law = predict(robot, AsymmetricFriction, forward=0.4, backward=0.1)
    trials = Trials(robot, 1)
    knee = robot.joints["knee"]
    trials.field("dof_frictionloss")[:, knee.dof] += 0.25
    trials.law(Cogging, "knee")["amplitude"][:] = -0.15  # with no phase to turn it
    trials.law(Cogging, "knee")["periods"][:] = 1e-12
    trials.law(Cogging, "knee")["phase"][:] = np.pi / 2
    other = Replay(robot, whole(recording()), CHANNELS, n_threads=1).predict(trials)
    np.testing.assert_allclose(by_law, other, atol=1e-9)


def test_actuator_lag_is_mujoco_s_filter_on_a_motor():
    # A first-order filter before a constant gain is one behind it.
    text = arm_text(integrator="Euler", dry="0")
    text = text.replace('kp="25" kv="1" delay="0.004" nsample="2"', 'kp="25"')
    native_text = text.replace(
        '<position name="knee" joint="knee" kp="25" />',
        '<general name="knee" joint="knee" dyntype="filterexact" dynprm="0.03" gainprm="2"/>',
    )
    law_text = native_text.replace('dyntype="filterexact" dynprm="0.03" ', "")
    log = recording()
    effort = log.columns["knee/position_target"]
    columns = {k: v for k, v in log.columns.items() if k != "knee/position_target"}
    log = Recording(name="log", time=log.time, columns=columns | {"knee/effort_target": effort})
    robots = [
        robot_from_spec(mujoco.MjSpec.from_string(t), "arm.xml") for t in (native_text, law_text)
    ]
    trials = [Trials(robot, 1) for robot in robots]
    trials[1].law(ActuatorLag, "knee")["time_constant"][:] = 0.03
    native, law = (
        Replay(r, whole(log), CHANNELS, n_threads=1).predict(t)[0]
        for r, t in zip(robots, trials, strict=True)
    )
    # MuJoCo's activation is that of the beginning of a step, the law's the mean over it.
    np.testing.assert_allclose(law[:, 5], native[:, 5], atol=np.abs(np.diff(native[:, 5])).max())
    moved = np.ptp(native[:, 1])
    assert np.abs(law[:, 1] - native[:, 1]).max() < 0.02 * moved


def test_setpoint_filter_is_mujoco_s_time_constant():
    native = predict(arm(hip='timeconst="0.05"'))
    law = predict(arm(), SetpointFilter, joint="hip", time_constant=0.05)
    moved = np.abs(native - predict(arm()))[..., 0].max()
    assert moved > 0.05
    assert np.abs(native - law)[..., 0].max() < 0.1 * moved


def test_quadratic_drag_is_mujoco_s_polynomial():
    native = predict(arm(damping="0.1 0.3"))
    law = predict(arm(), QuadraticDrag, joint="hip", drag=0.3)
    moved = np.abs(native - predict(arm()))[..., 0].max()
    assert moved > 1e-3
    assert np.abs(native - law)[..., 0].max() < 0.05 * moved


def test_load_dependent_friction_needs_a_load():
    robot = arm(dry="0")
    heavy = predict(robot, LoadDependentFriction, coefficient=0.3)
    assert np.abs(heavy - predict(robot))[..., 1].max() > 1e-3


def test_what_the_drive_reports_has_what_laws_of_the_drive_change():
    robot = arm()
    plain, lagging = predict(robot), predict(robot, ActuatorLag, joint="hip", time_constant=0.02)
    jump = np.abs(np.diff(plain[0, :, 4])).max()
    assert np.abs(np.diff(lagging[0, :, 4])).max() < 0.3 * jump
    # What lies behind the drive does not show there but through the motion.
    start = predict(robot, Cogging, joint="hip", amplitude=1.0)[0, :2, 4]
    np.testing.assert_allclose(start[0], plain[0, 0, 4], atol=1e-9)


def test_sample_and_hold_takes_up_targets_at_its_period():
    robot = arm()
    held = predict(robot, SampleAndHold, joint="knee", period=0.02)
    log = recording()
    every = (np.arange(len(log.time)) // 10) * 10
    columns = dict(log.columns)
    columns["knee/position_target"] = columns["knee/position_target"][every]
    # The delay of the knee's drive lies before what samples the target.
    late = np.maximum(np.arange(len(log.time)) - 2, 0)
    delayed = log.columns["knee/position_target"][late][every]
    columns["knee/position_target"] = np.concatenate([delayed[2:], delayed[-2:]])
    log = Recording(name="log", time=log.time, columns=columns)
    native = Replay(robot, whole(log), CHANNELS, n_threads=1).predict(Trials(robot, 1))
    np.testing.assert_allclose(held[..., 1], native[..., 1], atol=2e-3)


def test_a_law_that_diverges_takes_nobody_along():
    robot = arm()
    trials = Trials(robot, 3)
    trials.law(Cogging, "knee")["amplitude"][:] = [0.1, 1e12, 0.1]
    found = Replay(robot, whole(recording()), CHANNELS, n_threads=2).predict(trials)
    assert np.isnan(found[1]).all()
    np.testing.assert_array_equal(found[0], found[2])
    assert np.isfinite(found[0]).all()
