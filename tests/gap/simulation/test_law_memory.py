"""What drivetrain laws know of the time before a segment, and what of them is run before it."""

import mujoco
import numpy as np
import pytest

from walkerkit.actuators.drivetrain import (
    ActuatorLag,
    AsymmetricFriction,
    IntegralAction,
    LoopDelay,
    SampleAndHold,
    SetpointFilter,
    SlewLimit,
    StrengthDrift,
    VelocityFilter,
)
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import Segment, whole
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.trials import Trials

STEP = 0.002
ARM = """
<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body><joint name="hip" axis="0 1 0" damping="0.1" armature="0.01"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/>
  <body pos="0 0 -0.3"><joint name="knee" axis="0 1 0" damping="0.05"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/></body></body></worldbody>
<actuator>
  <general name="hip" joint="hip" gear="-2" biastype="affine" gainprm="20"
    biasprm="3 -15 -0.5" {hip}/>
  <position name="knee" joint="knee" kp="25" kv="1" delay="0.004" nsample="2"/>
</actuator></mujoco>
"""
JOINTS = ("hip", "knee")
CHANNELS = tuple(Channel(joint=j, signal=s) for s in ("position", "effort") for j in JOINTS)


def arm(hip=""):
    return robot_from_spec(mujoco.MjSpec.from_string(ARM.format(hip=hip)), "arm.xml")


def swinging(seconds=3.0):
    time = 7.0 + STEP * np.arange(round(seconds / STEP))
    t = time - 7.0
    return Recording(
        name="log",
        time=time,
        columns={
            "hip/position": np.full(len(t), 0.1),
            "knee/position": np.full(len(t), 0.4),
            "hip/position_target": 0.1 + 0.3 * np.sin(4 * t) + 0.1 * np.sign(np.sin(5 * t)),
            "knee/position_target": 0.4 + 0.35 * np.sin(7 * t),
        },
    )


def variant(robot, law, joints=JOINTS, n=1, **parameters):
    trials = Trials(robot, n)
    for joint in joints:
        for name, value in parameters.items():
            trials.law(law, joint)[name][:] = value
    return trials


def predict(robot, segments, trials):
    return Replay(robot, segments, CHANNELS, n_threads=1).predict(trials)


def as_logged(robot, trials):
    """The recording that a robot of this kind makes of the swinging targets."""
    recording = swinging()
    (shown,) = predict(robot, whole(recording), trials)
    measured = {
        f"{channel.joint}/{channel.signal}": shown[:, c] for c, channel in enumerate(CHANNELS)
    }
    return Recording(name="log", time=recording.time, columns={**recording.columns, **measured})


@pytest.mark.parametrize(
    ("law", "parameters"),
    [
        (SetpointFilter, {"time_constant": 0.03}),
        (SlewLimit, {"rate": 1.1}),
        (SampleAndHold, {"period": 0.0153}),
    ],
)
@pytest.mark.parametrize("hip", ["", 'dyntype="filterexact" dynprm="0.02"'])
def test_laws_of_targets_run_beforehand_as_in_lock_step(law, parameters, hip, monkeypatch):
    robot, segments = arm(hip), whole(swinging(1.0))
    trials = variant(robot, law, **parameters)
    beforehand = predict(robot, segments, trials)
    assert np.abs(beforehand - predict(robot, segments, Trials(robot, 1))).max() > 1e-3
    monkeypatch.setattr(law, "targets_only", False)
    if hip:  # what its filter remembers at the start, it has from targets as they come
        monkeypatch.setattr(Trials, "stepwise", Trials.with_laws)
    np.testing.assert_allclose(beforehand, predict(robot, segments, trials), atol=1e-12)


@pytest.mark.parametrize("rate", [None, 1.1], ids=["alone", "beside_a_limit_of_targets"])
def test_what_laws_add_to_every_step_runs_natively_as_in_lock_step(rate, monkeypatch):
    robot, segments = arm(), whole(swinging(1.0))
    trials = Trials(robot, 2)
    trials.field("dof_frictionloss")[:] = 0.05
    if rate is not None:
        trials.law(SlewLimit, "knee")["rate"][:] = rate
    trials.law(AsymmetricFriction, "hip")["forward"][:] = 0.3, 0.0
    trials.law(AsymmetricFriction, "hip")["backward"][:] = 0.1, 0.0
    assert not trials.stepwise.any()
    natively = predict(robot, segments, trials)
    assert np.abs(natively[0] - natively[1]).max() > 1e-2
    monkeypatch.setattr(AsymmetricFriction, "constant", False)
    assert trials.stepwise.tolist() == [True, False]
    np.testing.assert_array_equal(natively, predict(robot, segments, trials))


MEMORIES = [
    (SetpointFilter, {"time_constant": 0.15}),
    (SlewLimit, {"rate": 1.0}),
    (SampleAndHold, {"period": 0.1}),
    (ActuatorLag, {"time_constant": 0.03}),
    (VelocityFilter, {"time_constant": 0.03}),
    (LoopDelay, {"delay": 0.02, "joints": ["hip"]}),
    (IntegralAction, {"gain": 40.0, "clamp": 1e9}),
    (StrengthDrift, {"rate": 0.1}),
]


@pytest.mark.parametrize(("law", "parameters"), MEMORIES, ids=lambda x: getattr(x, "name", ""))
def test_a_window_goes_on_where_the_whole_was(law, parameters):
    robot = arm()
    trials = variant(robot, law, **parameters)
    log = as_logged(robot, trials)
    first, n = 733, 100
    segment = Segment(recording=log, first=first, last=first + n)
    (inside,) = predict(robot, (segment,), trials)
    expected = np.stack([log.signal(c.joint, c.signal) for c in CHANNELS], 1)[first : first + n]
    # As if the log had begun there.
    begun = log.between(log.time[first], log.time[first + n])
    fresh = Recording(name="begun", time=begun.time, columns=begun.columns)
    (without,) = predict(robot, whole(fresh), trials)
    error, forgetful = (np.abs(p - expected)[:, :2].max() for p in (inside, without))
    assert forgetful > 3e-3
    assert error < 0.2 * forgetful


def test_an_integrator_that_has_settled_holds_its_joint():
    robot = arm()
    time = STEP * np.arange(500)
    still = {"hip": 0.5, "knee": 0.3}
    columns = {}
    for joint, q in still.items():
        columns[f"{joint}/position"] = columns[f"{joint}/position_target"] = np.full(500, q)
    log = Recording(name="log", time=time, columns=columns)
    trials = variant(robot, IntegralAction, n=3, gain=np.array([0.0, 60.0, 300.0]), clamp=1e9)
    trials.field("body_mass")[2, 2] += 0.7  # a load is its to hold, too
    sagging, holding, loaded = predict(robot, whole(log), trials)
    assert np.abs(sagging[:, :2] - [0.5, 0.3]).max() > 0.02
    for held in (holding, loaded):
        np.testing.assert_allclose(held[:, :2], np.tile([0.5, 0.3], (500, 1)), atol=1e-5)
    clamped = variant(robot, IntegralAction, gain=60.0, clamp=0.3)
    assert np.abs(predict(robot, whole(log), clamped)[0, :, :2] - [0.5, 0.3]).max() > 0.01


def test_a_drive_with_a_filter_of_its_own_makes_what_mujoco_says():
    # What a law makes of the effort is beside what the drive makes of it after its filter.
    robot, segments = arm('dyntype="filterexact" dynprm="0.03"'), whole(swinging(1.0))
    trials = variant(robot, StrengthDrift, joints=["hip"], rate=1e-12)
    np.testing.assert_allclose(
        predict(robot, segments, trials), predict(robot, segments, Trials(robot, 1)), atol=1e-9
    )
    # Where it takes away all that the drive makes, the joint swings freely.
    weak = variant(robot, StrengthDrift, joints=["hip"], rate=1e9)
    (limp,) = predict(robot, segments, weak)
    text = ARM.format(hip="")
    hip = text[text.index("<general") : text.index("<position")]
    free = robot_from_spec(mujoco.MjSpec.from_string(text.replace(hip, "")), "free.xml")
    log = swinging(1.0)
    columns = {name: v for name, v in log.columns.items() if name != "hip/position_target"}
    log = Recording(name="log", time=log.time, columns=columns)
    (swung,) = predict(free, whole(log), Trials(free, 1))
    # MuJoCo goes on taking the drive's damping for implicit, which is a little more inertia.
    np.testing.assert_allclose(limp[:, :2], swung[:, :2], atol=0.05 * np.ptp(swung[:, 0]))


@pytest.mark.parametrize("beside", [False, True], ids=["natively", "in lock step"])
def test_drives_report_jumps_when_they_come(beside):
    # Of targets that jump between steps, steps in the middle of a jump make the mean; the log shows
    # what was made when it was read, as a simulation in short steps does.
    shown = []
    for robot in (arm(), arm().refined(20)):
        trials = variant(robot, SampleAndHold, period=0.0153)
        if beside:
            variant_of = trials.law(StrengthDrift, "hip")
            variant_of["rate"][:] = 1e-12
        shown.append(predict(robot, whole(swinging(1.0)), trials)[0, :, 2:])
    coarse, fine = shown
    jumps = np.abs(np.diff(fine, axis=0)).max(axis=0)
    off = np.abs(coarse - fine)
    # One in eight samples follows a jump; one whose step ends with the jump itself may be either.
    assert ((off > 0.2 * jumps).mean(axis=0) < 0.01).all()
