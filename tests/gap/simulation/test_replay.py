"""Replay, with commands, segments and the measured state: against loops over `mj_step` by hand."""

import weakref
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from walkerkit.actuators.drivetrain import CommandDelay
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import cut, stretches, whole, windows
from walkerkit.gap.recordings.state import MeasuredState
from walkerkit.gap.search.structure import Structure, candidate_terms
from walkerkit.gap.simulation.commands import between_samples, driven_by_effort, routes
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.robot import Measurement
from walkerkit.gap.simulation.segment_group import similar_lengths
from walkerkit.gap.simulation.trials import Trials

STEP = 0.002
ARM = """
<mujoco><compiler angle="radian"/>
<option timestep="{step}" integrator="implicitfast"/>
<worldbody><body><joint name="hip" axis="0 1 0" damping="0.1" armature="0.01"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/>
  <body pos="0 0 -0.3"><joint name="knee" axis="0 1 0" damping="0.05" frictionloss="0.1"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/></body></body></worldbody>
<actuator>{actuators}</actuator>{more}</mujoco>
"""
SERVO = '<position name="{0}" joint="{0}" kp="{1}" kv="{2}" {3}/>'
SERVOS = SERVO.format("hip", 60, 2, "") + SERVO.format("knee", 25, 1, "")
JOINTS = ("hip", "knee")
SIGNALS = ("position", "velocity", "effort")
CHANNELS = tuple(Channel(joint=joint, signal=signal) for signal in SIGNALS for joint in JOINTS)
NEAR = {"rtol": 1e-9, "atol": 1e-11}


def arm(actuators=SERVOS, step=STEP, more=""):
    text = ARM.format(actuators=actuators, step=step, more=more)
    return robot_from_spec(mujoco.MjSpec.from_string(text), "arm.xml")


def log(time, name="log", **more):
    """Motion and targets that no simulation made; the columns need not agree with each other."""
    columns = {
        "hip/position": 0.4 * np.sin(3 * time) + 0.1 * np.sin(11 * time),
        "knee/position": 0.8 + 0.3 * np.sin(4 * time + 1),
        "hip/position_target": 0.4 * np.sign(np.sin(5 * time)) + 0.1 * time,
        "knee/position_target": 0.8 + 0.35 * np.sin(7 * time),
    }
    return Recording(name=name, time=time, columns=columns | more)


def irregular(n=300, seed=0):
    return np.cumsum(0.004 * np.random.default_rng(seed).uniform(0.4, 1.6, n)) + 12.3


def held(recording, column, instants, step=STEP):
    """The sample of each step: the last whose nearest step has come, the first before all."""
    values, found = recording.columns[column], []
    for t in np.ravel(instants):
        earlier = [v for s, v in zip(recording.time, values, strict=True) if s < t + 0.4995 * step]
        found.append(earlier[-1] if earlier else values[0])
    return np.array(found)


def interpolated(recording, column, instant, step=STEP):
    """A line from sample to sample, but held where the hip's target changes its sign."""
    before = held(recording, column, [instant], step)[0]
    later = recording.time > instant
    after = recording.columns[column][later][0] if later.any() else before
    if column == "hip/position_target" and abs(after - before) > 0.5:
        return before
    return np.interp(instant, recording.time, recording.columns[column])


def measured_start(recording, joint, instant):
    """Position and velocity from a cubic through 50 ms, on a uniform grid, between its points."""
    time, values = recording.time, recording.columns[f"{joint}/position"]
    step = np.median(np.diff(time))
    grid = np.arange(time[0], time[-1] + 1e-6 * step, step)
    uniform = np.interp(grid, time, values)
    half = max(7, round(0.05 / step)) // 2
    found = []
    for k in (np.searchsorted(grid, instant, side="right") - 1 + np.array([0, 1])).clip(
        0, len(grid) - 1
    ):
        middle = np.clip(k, half, len(grid) - 1 - half)
        part = slice(middle - half, middle + half + 1)
        cubic = np.polynomial.Polynomial.fit(grid[part], uniform[part], 3)
        found.append((grid[k], cubic(grid[k]), cubic.deriv()(grid[k])))
    (t0, q0, v0), (t1, q1, v1) = found
    part = 0.0 if t1 == t0 else (instant - t0) / (t1 - t0)
    return q0 + part * (q1 - q0), v0 + part * (v1 - v0)


def by_hand(model, start, commands, times, applied=None, held=True):
    """Position, velocity and effort of both joints at `times` after the start, 6 columns."""
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = np.array(start).T
    step = model.opt.timestep
    steps = int(np.ceil(times[-1] / step - 1e-6)) + 1
    states, efforts, sent = [np.r_[data.qpos, data.qvel]], [], []
    for k in range(steps):
        data.ctrl[:] = commands(k * step)
        if applied is not None:
            data.qfrc_applied[:] = applied(k * step)
        mujoco.mj_step(model, data)
        states.append(np.r_[data.qpos, data.qvel])
        efforts.append(data.qfrc_actuator + data.qfrc_applied)
        commanded = data.qfrc_applied.copy()
        commanded[model.jnt_dofadr[model.actuator_trnid[:, 0]]] += data.ctrl
        sent.append(commanded)
    grid = step * np.arange(steps + 1)
    state = np.stack([np.interp(times, grid, column) for column in np.array(states).T], axis=1)
    effort = [
        [effort_at(t, grid[:-1], *of_joint, held) for t in times]
        for of_joint in zip(np.array(efforts).T, np.array(sent).T, strict=True)
    ]
    return np.hstack([state, np.transpose(effort)])


def effort_at(instant, grid, efforts, commands, held):
    """Between two steps, but of the nearest where a held command is another at the later one."""
    k = min(int(np.searchsorted(grid, instant, side="right")) - 1, len(grid) - 2)
    part = (instant - grid[k]) / (grid[k + 1] - grid[k])
    if held and commands[k] != commands[k + 1]:
        return efforts[k + (part > 0.4995)]
    return np.interp(instant, grid, efforts)


def starts(recording, instant):
    return [measured_start(recording, joint, instant) for joint in JOINTS]


def servo_targets(recording, start, age=0.0):
    def commands(t):
        return [held(recording, f"{j}/position_target", start + t - age)[0] for j in JOINTS]

    return commands


def predict(robot, segments, trials=None, **options):
    replay = Replay(robot, segments, CHANNELS, **options)
    return replay.predict(trials or Trials(robot, 1))


class TestByHand:
    @pytest.mark.parametrize("time", [np.arange(0, 1, 0.004), irregular()], ids=["even", "uneven"])
    def test_whole_recording_of_servoed_joints(self, time):
        robot, recording = arm(), log(time)
        expected = by_hand(
            robot.model,
            starts(recording, time[0]),
            servo_targets(recording, time[0]),
            time - time[0],
        )
        (got,) = predict(robot, whole(recording))
        np.testing.assert_allclose(got, expected, **NEAR)

    @pytest.mark.parametrize("time", [np.arange(0, 1, 0.003), irregular()], ids=["even", "uneven"])
    def test_windows_start_from_the_measured_state(self, time):
        robot, recording = arm(), log(time)
        segments = windows(recording, 0.2)
        assert len(segments) >= 4
        (got,) = predict(robot, segments)
        row = 0
        for segment in segments:
            within = time[segment.first : segment.last]
            expected = by_hand(
                robot.model,
                starts(recording, within[0]),
                servo_targets(recording, within[0]),
                within - within[0],
            )
            np.testing.assert_allclose(got[row : row + len(within)], expected, **NEAR)
            row += len(within)
        assert row == len(got)

    @pytest.mark.parametrize("time", [np.arange(0, 1, 0.003), irregular()], ids=["even", "uneven"])
    def test_a_few_samples_are_as_among_all(self, time):
        robot, segments = arm(), windows(log(time), 0.2)
        of_all, few = (Replay(robot, segments, CHANNELS, every=n) for n in (1, 3))
        chosen = np.concatenate(
            [np.flatnonzero(of_all.segment_of_row == k)[::3] for k in range(len(segments))]
        )
        trials = Trials(robot, 2)
        for one in (few, few.on(robot), few.of(segments), few.of_segments(range(len(segments)))):
            np.testing.assert_array_equal(one.measured, of_all.measured[chosen])
            np.testing.assert_array_equal(one.time_of_row, of_all.time_of_row[chosen])
            np.testing.assert_array_equal(one.segment_of_row, of_all.segment_of_row[chosen])
            np.testing.assert_array_equal(one.predict(trials), of_all.predict(trials)[:, chosen])

    def test_interpolated_targets(self):
        robot, recording = arm(), log(irregular())
        time = recording.time
        expected = by_hand(
            robot.model,
            starts(recording, time[0]),
            lambda t: [
                interpolated(recording, f"{j}/position_target", time[0] + t) for j in JOINTS
            ],
            time - time[0],
            held=False,
        )
        (got,) = predict(robot, whole(recording), hold="linear")
        np.testing.assert_allclose(got, expected, **NEAR)

    def test_joints_driven_by_effort(self):
        robot = arm('<motor joint="knee" gear="-4"/><motor joint="hip" gear="0.5"/>')
        time = irregular(150)
        effort = {f"{j}/effort_target": np.sin((k + 9) * time) for k, j in enumerate(JOINTS)}
        recording = Recording(
            name="log",
            time=time,
            columns={f"{j}/position": log(time).columns[f"{j}/position"] for j in JOINTS} | effort,
        )
        assert driven_by_effort(robot, recording)
        expected = by_hand(
            robot.model,
            starts(recording, time[0]),
            lambda t: [
                held(recording, "knee/effort_target", time[0] + t)[0] / -4,
                held(recording, "hip/effort_target", time[0] + t)[0] / 0.5,
            ],
            time - time[0],
        )
        (got,) = predict(robot, whole(recording))
        np.testing.assert_allclose(got, expected, **NEAR)
        nearest = time[0] + STEP * np.round((time - time[0]) / STEP)
        np.testing.assert_allclose(
            got[:, 4], held(recording, "hip/effort_target", nearest), atol=1e-9
        )

    @pytest.mark.parametrize("more", ["", 'forcerange="-12 9"', 'delay="0.004" nsample="3"'])
    def test_efforts_that_were_read_before_the_targets_beside_them(self, more):
        robot = arm(SERVO.format("hip", 60, 2, more) + SERVO.format("knee", 25, 1, ""))
        recording = log(0.004 * np.arange(250))
        (after,) = predict(robot, whole(recording))
        (before,) = predict(replace(robot, reads_effort_first=True), whole(recording))
        np.testing.assert_array_equal(after[:, :4], before[:, :4])
        late = {"hip": 1 if "delay" in more else 0, "knee": 0}  # rows
        for k, (joint, kp) in enumerate((("hip", 60), ("knee", 25))):
            target = recording.columns[f"{joint}/position_target"]
            acting = np.concatenate([np.repeat(target[:1], late[joint]), target])[: len(target)]
            earlier = np.concatenate([acting[:1], acting[:-1]])
            expected = after[:, 4 + k] - kp * (acting - earlier)
            if "forcerange" in more and joint == "hip":
                # Where it is cut off before or after, it is what the servo's law says, cut off.
                law = kp * (earlier - after[:, 0]) - 2 * after[:, 2]
                cut = (after[:, 4] <= -12) | (after[:, 4] >= 9) | (law <= -10) | (law >= 7)
                assert 10 < cut.sum() < 240
                of_a_step_before = before[cut, 4]
                np.testing.assert_allclose(of_a_step_before, law[cut].clip(-12, 9), atol=2.0)
                expected[cut] = of_a_step_before
            np.testing.assert_allclose(before[:, 4 + k], expected, atol=1e-9)

    def test_efforts_of_the_cycle_before(self):
        robot, recording = arm(), log(STEP * np.arange(300))
        (after,) = predict(robot, whole(recording))
        first, half, cycle = (
            predict(robot.reading_earlier(part), whole(recording))[0] for part in (0.0, 0.5, 1.0)
        )
        np.testing.assert_allclose(cycle[1:, 4:], after[:-1, 4:], atol=1e-9)
        np.testing.assert_allclose(half, (first + cycle) / 2, atol=1e-9)
        (finer,) = predict(robot.reading_earlier(1.0).refined(4), whole(recording))
        (same,) = predict(robot.refined(4), whole(recording))
        np.testing.assert_allclose(finer[1:, 4:], same[:-1, 4:], atol=1e-9)

    def test_effort_is_that_of_the_command_it_is_logged_with_where_stamps_jitter(self):
        robot = arm('<motor joint="knee"/><motor joint="hip"/>')
        rng = np.random.default_rng(0)
        time = 0.004 * np.arange(200) + rng.uniform(-4e-4, 4e-4, 200)
        columns = log(time).columns
        columns = {f"{joint}/position": columns[f"{joint}/position"] for joint in JOINTS}
        commands = {f"{joint}/effort_target": rng.normal(size=200) for joint in JOINTS}
        recording = Recording(name="log", time=time, columns=columns | commands)
        (got,) = predict(robot, whole(recording))
        np.testing.assert_allclose(got[:, 4:], np.transpose(list(commands.values())), atol=1e-12)

    def test_feed_forward_effort_is_applied_beside_the_servo_and_logged_with_it(self):
        robot, time = arm(), irregular(150)
        forward = {"hip/effort_target": 3 * np.sin(9 * time)}
        recording = log(time, **forward)
        expected = by_hand(
            robot.model,
            starts(recording, time[0]),
            servo_targets(recording, time[0]),
            time - time[0],
            lambda t: [held(recording, "hip/effort_target", time[0] + t)[0], 0.0],
        )
        (got,) = predict(robot, whole(recording))
        np.testing.assert_allclose(got, expected, **NEAR)

    def test_effort_on_a_joint_without_an_actuator_is_applied_to_it(self):
        robot = arm(SERVO.format("hip", 60, 2, ""))
        time = irregular(150)
        recording = log(time, **{"knee/effort_target": np.sin(9 * time)})
        columns = {k: v for k, v in recording.columns.items() if k != "knee/position_target"}
        recording = Recording(name="log", time=time, columns=columns)
        expected = by_hand(
            robot.model,
            starts(recording, time[0]),
            lambda t: [held(recording, "hip/position_target", time[0] + t)[0]],
            time - time[0],
            lambda t: [0.0, held(recording, "knee/effort_target", time[0] + t)[0]],
        )
        (got,) = predict(robot, whole(recording))
        np.testing.assert_allclose(got, expected, **NEAR)

    @pytest.mark.parametrize(
        "hip",
        [
            # u in [-1, 1] stands for -1.2 to 0.8 rad.
            '<general joint="hip" biastype="affine" gainprm="60" biasprm="-12 -60 -2"/>',
            '<general joint="hip" gear="2" biastype="affine" gainprm="15" biasprm="6 -15 -0.5"/>',
            '<position joint="hip" gear="-2" kp="15" kv="0.5"/>',
        ],
        ids=["scaled", "scaled, geared", "geared"],
    )
    def test_scaled_and_geared_servos_take_targets_in_radians(self, hip):
        recording = log(np.arange(0, 0.6, 0.004))
        (expected,) = predict(arm(), whole(recording))
        (got,) = predict(arm(hip + SERVO.format("knee", 25, 1, "")), whole(recording))
        np.testing.assert_allclose(got, expected, **NEAR)

    def test_actuators_behind_one_with_several_inputs(self):
        more = "<pid joint='hip' kp='0' input='pos vel ff'/>"
        recording = log(np.arange(0, 0.6, 0.004))
        (expected,) = predict(arm(), whole(recording))
        (got,) = predict(arm(more + SERVOS), whole(recording))
        np.testing.assert_allclose(got, expected, **NEAR)

    def test_joints_that_are_not_recorded_hold_the_keyframe(self):
        robot = arm(more='<keyframe><key qpos="0.5 -1" ctrl="0.6 -1"/></keyframe>')
        time = np.arange(0, 0.6, 0.004)
        whole_log = log(time)
        columns = {k: v for k, v in whole_log.columns.items() if k.startswith("hip/")}
        recording = Recording(name="log", time=time, columns=columns)
        expected = by_hand(
            robot.model,
            [measured_start(recording, "hip", 0.0), (-1.0, 0.0)],
            lambda t: [held(recording, "hip/position_target", t)[0], -1.0],
            time,
        )
        (got,) = predict(robot, whole(recording))
        np.testing.assert_allclose(got[:, [0, 2, 4]], expected[:, [0, 2, 4]], **NEAR)
        assert np.isnan(got[:, [1, 3, 5]]).all()


class TestNativeDelays:
    DELAYED = SERVO.format("hip", 60, 2, 'delay="0.02" nsample="10"') + SERVO.format(
        "knee", 25, 1, 'delay="0.006" nsample="4" interp="linear"'
    )

    @pytest.mark.parametrize("length", [None, 0.2])
    def test_histories_hold_the_recorded_past(self, length):
        robot, recording = arm(self.DELAYED), log(irregular())
        plain, row = arm().model, 0
        segments = cut([recording], length)
        (got,) = predict(robot, segments)
        for segment in segments:
            within = recording.time[segment.first : segment.last]
            expected = by_hand(
                plain,
                starts(recording, within[0]),
                lambda t, at=within[0]: [
                    held(recording, "hip/position_target", at + t - 0.02)[0],
                    held(recording, "knee/position_target", at + t - 0.006)[0],
                ],
                within - within[0],
            )
            np.testing.assert_allclose(got[row : row + len(within)], expected, **NEAR)
            row += len(within)

    def test_a_joint_that_is_held_does_not_dip(self):
        robot = arm(
            SERVO.format("hip", 60, 2, 'delay="0.02" nsample="10"')
            + SERVO.format("knee", 25, 1, "")
        )
        data = mujoco.MjData(robot.model)
        data.qpos[:] = data.ctrl[:] = (0.8, -0.8)
        mujoco.mj_forward(robot.model, data)
        # Targets that hold this pose against gravity: where the servo's error makes its torque.
        targets = np.array([0.8, -0.8]) + data.qfrc_bias / [60, 25]
        time = np.arange(0, 0.4, 0.004)
        columns = {}
        for k, joint in enumerate(JOINTS):
            columns[f"{joint}/position"] = np.full(len(time), (0.8, -0.8)[k])
            columns[f"{joint}/position_target"] = np.full(len(time), targets[k])
        (got,) = predict(robot, whole(Recording(name="hold", time=time, columns=columns)))
        np.testing.assert_allclose(got[:, :2], np.tile([0.8, -0.8], (len(time), 1)), atol=1e-6)

    def test_long_histories_reach_back_as_far_as_they_need(self):
        long = SERVO.format("hip", 60, 2, 'delay="0.5" nsample="250"')
        robot, recording = arm(long + SERVO.format("knee", 25, 1, "")), log(irregular())
        segment = windows(recording, 0.6)[1]
        within = recording.time[segment.first : segment.last]
        (got,) = predict(robot, [segment])
        expected = by_hand(
            arm().model,
            starts(recording, within[0]),
            lambda t: [
                held(recording, "hip/position_target", within[0] + t - 0.5)[0],
                held(recording, "knee/position_target", within[0] + t)[0],
            ],
            within - within[0],
        )
        np.testing.assert_allclose(got, expected, **NEAR)

    @pytest.mark.parametrize("late", [0, 20], ids=["prompt", "delayed"])
    @pytest.mark.parametrize("dyntype", ["filter", "filterexact"])
    def test_filters_have_seen_the_recorded_past(self, dyntype, late):
        drive = (
            f'<general joint="hip" biastype="affine" gainprm="60" biasprm="0 -60 -2" '
            f'dyntype="{dyntype}" dynprm="0.03" ctrllimited="true" ctrlrange="-0.3 3" '
            f'delay="{late * STEP}" nsample="{late}"/>'
        )
        robot, recording = arm(drive + SERVO.format("knee", 25, 1, "")), log(irregular())
        segment = windows(recording, 0.5)[1]
        within = recording.time[segment.first : segment.last]
        (got,) = predict(robot, [segment])
        # The filter by hand, from the recording's beginning.
        part = STEP / 0.03 if dyntype == "filter" else -np.expm1(-STEP / 0.03)
        before = round((within[0] - recording.time[0]) / STEP)
        instants = within[0] + STEP * np.arange(-before - late, 400 - late)
        limited = np.maximum(held(recording, "hip/position_target", instants), -0.3)
        smooth, filtered = limited[0], {}
        for k, now in zip(range(-before, 400), limited, strict=True):
            filtered[k] = smooth
            smooth += part * (now - smooth)
        expected = by_hand(
            arm().model,
            starts(recording, within[0]),
            lambda t: [
                filtered[round(t / STEP)],
                held(recording, "knee/position_target", within[0] + t)[0],
            ],
            within - within[0],
        )
        # Ten time constants are remembered; velocities are the most sensitive to the rest.
        np.testing.assert_allclose(got[:, :4], expected[:, :4], atol=2e-4)


class TestDelays:
    @pytest.mark.parametrize("length", [None, 0.2])
    @pytest.mark.parametrize("delay", [0.002, 0.01, 0.0073, 0.0411])
    def test_command_delay_is_mujocos_own(self, delay, length):
        native = (
            f'delay="{delay}" nsample="{int(np.ceil(delay / STEP - 1e-9)) + 1}" interp="linear"'
        )
        recording = log(irregular())
        segments = cut([recording], length)
        robot = arm()
        trials = Trials(robot, 2)
        for joint in JOINTS:
            trials.command_delay[joint][1] += delay
        prompt, late = predict(robot, segments, trials)
        delayed = arm(SERVO.format("hip", 60, 2, native) + SERVO.format("knee", 25, 1, native))
        (expected,) = predict(delayed, segments)
        np.testing.assert_allclose(late, expected, **NEAR)
        assert np.abs(late - prompt).max() > 1e-3

    @pytest.mark.parametrize("more", [None, "the model's", "a drive's", "a law's"])
    def test_feed_forward_effort_is_as_late_as_the_target_beside_it(self, more):
        """A drive gets both in one command; at other joints nothing is late."""
        native = f'delay="{3 * STEP}" nsample="3"' if more == "the model's" else ""
        robot = arm(SERVO.format("hip", 60, 2, native) + SERVO.format("knee", 25, 1, ""))
        if more == "a drive's":
            (drive,) = robot.joints["hip"].drives
            hip = replace(robot.joints["hip"], drives=(replace(drive, late=3 * STEP),))
            robot = replace(robot, joints={**robot.joints, "hip": hip})
        time = STEP * np.arange(300)
        forward = {f"{joint}/effort_target": 3 * np.sin(9 * time + 1) for joint in JOINTS}
        recording, late = log(time, **forward), 8 if more else 5
        trials = Trials(robot, 1)
        trials.command_delay["hip"] += 5 * STEP
        if more == "a law's":
            trials.law(CommandDelay, "hip")["delay"][:] = 3 * STEP
        (got,) = Replay(robot, whole(recording), CHANNELS, hold="zero_order").predict(trials)

        def sent(columns):
            age = {"hip": late * STEP, "knee": 0.0}
            return lambda t: [held(recording, f"{j}/{columns}", t - age[j])[0] for j in JOINTS]

        expected = by_hand(
            arm().model,
            starts(recording, time[0]),
            sent("position_target"),
            time,
            sent("effort_target"),
        )
        np.testing.assert_allclose(got[:, :4], expected[:, :4], **NEAR)

    def test_command_delay_adds_to_the_models_own(self):
        native = 'delay="0.006" nsample="4" interp="linear"'
        robot = arm(SERVO.format("hip", 60, 2, native) + SERVO.format("knee", 25, 1, ""))
        trials = Trials(robot, 2)
        trials.command_delay["hip"] += [0.01, -0.004]
        segments = cut([log(irregular())], 0.3)
        got = predict(robot, segments, trials)
        for i, total in enumerate((0.016, 0.002)):
            plain = arm()
            reference = Trials(plain, 1)
            reference.command_delay["hip"] += total
            np.testing.assert_allclose(got[i], predict(plain, segments, reference)[0], **NEAR)

    def still_then_moving(self):
        """A recording of the simulated arm itself: it hangs at rest, then its targets move."""
        model, steps = arm().model, 600
        data = mujoco.MjData(model)
        rows = []
        for k in range(steps):
            t = k * STEP
            target = [
                0.4 * np.sin(6 * (t - 0.2)) * (t > 0.2),
                0.3 * np.sin(9 * (t - 0.2)) * (t > 0.2),
            ]
            data.ctrl[:] = target
            state = np.r_[data.qpos, data.qvel]
            mujoco.mj_step(model, data)
            rows.append(np.r_[state, data.qfrc_actuator, target])
        names = [f"{j}/{s}" for s in (*SIGNALS, "position_target") for j in JOINTS]
        columns = dict(zip(names, np.array(rows).T, strict=True))
        return Recording(name="still", time=STEP * np.arange(steps), columns=columns)

    @pytest.mark.parametrize("steps", [1, 7])
    def test_sensor_delay_is_a_time_shift_and_parts_from_command_delay_in_effort(self, steps):
        recording, robot = self.still_then_moving(), arm()
        trials = Trials(robot, 3)
        for joint in JOINTS:
            trials.command_delay[joint][1] += steps * STEP
            trials.position_delay[joint][2] += steps * STEP
        prompt, commanded, sensed = predict(robot, whole(recording), trials)
        own = np.stack([recording.columns[f"{c.joint}/{c.signal}"] for c in CHANNELS], axis=1)
        np.testing.assert_allclose(prompt, own, atol=1e-9)
        np.testing.assert_allclose(sensed[steps:, :4], own[:-steps, :4], atol=1e-9)
        np.testing.assert_allclose(sensed[:, 4:], own[:, 4:], atol=1e-9)
        np.testing.assert_allclose(commanded[:, :4], sensed[:, :4], atol=1e-9)
        np.testing.assert_allclose(commanded[steps:, 4:], own[:-steps, 4:], atol=1e-9)
        assert np.abs(commanded[:, 4:] - own[:, 4:]).max() > 0.1

    def test_sensors_of_different_age(self):
        recording, robot = self.still_then_moving(), arm()
        trials = Trials(robot, 1)
        trials.position_delay["hip"] += 3 * STEP
        trials.position_delay["knee"] += 8 * STEP
        (got,) = predict(robot, whole(recording), trials)
        for column, shift in ((0, 3), (1, 8), (2, 3), (3, 8)):
            channel = CHANNELS[column]
            own = recording.columns[f"{channel.joint}/{channel.signal}"]
            np.testing.assert_allclose(got[shift:, column], own[:-shift], atol=1e-9)

    # MuJoCo makes a whole step of a delay of less.
    @pytest.mark.parametrize(("own", "made"), [(0.02, 0.02), (0.3 * STEP, STEP)])
    def test_sensor_delay_leaves_the_models_own_command_delay_alone(self, own, made):
        native = f'delay="{own}" nsample="10"'
        actuators = SERVO.format("hip", 60, 2, native) + SERVO.format("knee", 25, 1, "")
        delayed, plain = arm(actuators), arm()
        segments = cut([log(irregular())], 0.2)
        trials = [Trials(robot, 1) for robot in (delayed, plain)]
        for one in trials:
            for joint in JOINTS:
                one.position_delay[joint] += 5 * STEP
        trials[1].command_delay["hip"] += made
        (got,), (expected,) = (
            predict(robot, segments, one)
            for robot, one in zip((delayed, plain), trials, strict=True)
        )
        np.testing.assert_allclose(got, expected, **NEAR)

    def test_what_is_known_of_the_measurement_is_where_trials_begin(self):
        from dataclasses import replace

        recording = self.still_then_moving()
        robot = replace(
            arm(),
            measurement={
                "hip": Measurement(position_delay=4 * STEP, effort_scale=0.5, effort_offset=2.0)
            },
        )
        (got,) = predict(robot, whole(recording))
        own = recording.columns
        np.testing.assert_allclose(got[4:, 0], own["hip/position"][:-4], atol=1e-9)
        np.testing.assert_allclose(got[:, 1], own["knee/position"], atol=1e-9)
        np.testing.assert_allclose(got[:, 4], 0.5 * own["hip/effort"] + 2.0, atol=1e-9)


class TestMany:
    def trials(self, robot):
        trials = Trials(robot, 4)
        trials.field("dof_damping")[:, 0] += [0.0, 0.3, 0.0, 0.1]
        trials.field("actuator_biasprm")[2, 0, 2] = 1e12
        trials.command_delay["knee"] += [0.0, 0.01, 0.0, 0.003]
        return trials

    def recordings(self):
        short = log(np.arange(0, 0.3, 0.004), name="short")
        return log(irregular()), log(irregular(200, 1), name="other"), short

    def test_threads_change_nothing(self):
        robot = arm()
        one, two = (
            predict(robot, cut(self.recordings(), 0.2), self.trials(robot), n_threads=n)
            for n in (1, 2)
        )
        np.testing.assert_array_equal(one, two)

    def test_a_trial_that_diverges_is_nan_and_disturbs_nobody(self, tmp_path, monkeypatch, capfd):
        monkeypatch.chdir(tmp_path)
        robot = arm()
        segments, trials = cut(self.recordings(), None), self.trials(robot)
        together = predict(robot, segments, trials)
        assert np.isnan(together[2]).all()
        for i in (0, 1, 3):
            alone = predict(robot, segments, trials.rows(slice(i, i + 1)))
            np.testing.assert_array_equal(together[i], alone[0])
        assert np.isfinite(together[[0, 1, 3]]).all()
        assert not list(tmp_path.iterdir())
        assert capfd.readouterr() == ("", "")

    def test_segments_of_any_length_and_order_are_each_alone(self):
        robot = arm()
        long, other, short = self.recordings()
        segments = [*whole(short), *windows(long, 0.2), *whole(other), *windows(short, 0.1)]
        replay = Replay(robot, segments, CHANNELS)
        (together,) = replay.predict(Trials(robot, 1))
        for i, segment in enumerate(segments):
            (alone,) = predict(robot, [segment])
            np.testing.assert_array_equal(together[replay.segment_of_row == i], alone)
            expected = segment.recording.time[segment.first : segment.last] - segment.start
            np.testing.assert_array_equal(replay.time_of_row[replay.segment_of_row == i], expected)

    def test_recordings_of_different_joints(self):
        robot, time = arm(), np.arange(0, 0.5, 0.004)
        both = log(time)
        knee = Recording(
            name="knee",
            time=time,
            columns={k: v for k, v in both.columns.items() if k.startswith("knee")},
        )
        replay = Replay(robot, [*whole(both), *whole(knee)], CHANNELS)
        (got,) = replay.predict(Trials(robot, 1))
        np.testing.assert_array_equal(got[: len(time)], predict(robot, whole(both))[0])
        assert np.isnan(got[len(time) :, [0, 2, 4]]).all()
        assert np.isnan(replay.measured[len(time) :, 0]).all()
        np.testing.assert_array_equal(
            replay.measured[len(time) :, 1], knee.columns["knee/position"]
        )

    def test_joined_trials_are_the_trials_one_after_the_other(self):
        robot, segments = arm(), whole(self.recordings()[0])
        first, second = self.trials(robot), Trials(robot, 2)
        second.field("dof_armature")[:, 1] += [0.0, 0.02]
        second.effort_offset["hip"] += 1.0
        joined = predict(robot, segments, Trials.joined([first, second]))
        apart = [predict(robot, segments, one) for one in (first, second)]
        np.testing.assert_array_equal(joined, np.concatenate(apart))


class TestCommands:
    def test_held_and_interpolated_between_samples(self):
        recording = log(irregular(20))
        time = recording.time
        at = np.sort(np.r_[time[0] - 1, time, 0.5 * (time[1:] + time[:-1]), time[-1] + 1])
        column = "hip/position_target"
        np.testing.assert_array_equal(
            between_samples(recording, column, at, "zero_order", 1e-3),
            held(recording, column, at, 1e-3),
        )
        np.testing.assert_allclose(
            between_samples(recording, column, at, "linear", 1e-3),
            [interpolated(recording, column, t, 1e-3) for t in at],
        )
        values = recording.columns[column]
        earlier = replace(
            recording, columns=recording.columns | {column: np.append(values[1:], values[-1])}
        )
        following = between_samples(recording, column, at, "next", 1e-3)
        since = at >= time[0]
        np.testing.assert_array_equal(following[since], held(earlier, column, at[since], 1e-3))
        assert (following[~since] == recording.columns[column][0]).all()

    def test_targets_are_taken_up_in_the_middle_of_a_log_as_from_its_beginning(self):
        # The stamp that a stretch starts with lies beside a step, as do those of its targets.
        instants = 2 * STEP * np.arange(750)
        beside = 0.1 * STEP * np.random.default_rng(0).uniform(-1, 1, len(instants))
        robot, predicted = arm(), []
        (term,) = candidate_terms([CATALOGUE["sample_and_hold"]], [robot], JOINTS)
        slow = Structure((term,), (robot,)).trials(robot, np.array([[8 * STEP]]))
        for stamps in (instants, instants + beside):
            parts = stretches(replace(log(instants), time=stamps), 0.5)
            predicted.append(Replay(robot, parts, CHANNELS).predict(slow)[0, :, :2])
        np.testing.assert_allclose(*predicted, atol=5e-3)  # as far as the start states differ

    def test_a_sample_at_a_steps_own_instant_counts_whatever_the_rounding(self):
        recording = log(0.1 * np.arange(8))
        at = 0.7 - 0.1 * np.arange(8)[::-1]
        np.testing.assert_array_equal(
            between_samples(recording, "hip/position_target", at, "zero_order", 0.1),
            recording.columns["hip/position_target"],
        )

    def test_stamps_that_jitter_do_not_move_a_target_to_another_step(self):
        rng = np.random.default_rng(0)
        even = 0.01 * np.arange(50)
        recording = log(even + 0.003 * rng.uniform(-1, 1, 50))
        np.testing.assert_array_equal(
            between_samples(recording, "hip/position_target", even, "zero_order", 0.01),
            recording.columns["hip/position_target"],
        )

    def test_targets_find_their_actuators(self):
        robot = arm('<motor joint="hip"/>' + SERVOS + '<velocity joint="knee" kv="3"/>')
        time = np.arange(0, 0.1, 0.01)
        recording = log(time, **{"knee/velocity_target": time, "knee/effort_target": time})
        found = {
            route.column: route.drive and (route.drive.actuator, route.drive.kind)
            for route in routes(robot, recording)
        }
        assert found == {
            "hip/position_target": (1, "position"),
            "knee/position_target": (2, "position"),
            "knee/velocity_target": (3, "velocity"),
            "knee/effort_target": None,
        }
        assert not driven_by_effort(robot, recording)

    @pytest.mark.parametrize(
        ("actuators", "columns", "message"),
        [
            (
                '<velocity joint="hip" kv="1"/>',
                ["hip/position_target"],
                r"log: joint 'hip' has an actuator for velocity in arm\.xml, but the recording "
                r"has no `hip/velocity_target`\. Log that target, or",
            ),
            (
                '<position joint="hip"/><motor joint="hip"/>',
                ["hip/velocity_target"],
                "has no `hip/position_target` or `hip/effort_target`",
            ),
            (
                "",
                ["hip/position_target"],
                r"column `hip/position_target` has no actuator in arm\.xml\. "
                "Add a <position> actuator to joint 'hip'",
            ),
        ],
    )
    def test_refuses_targets_that_nothing_takes(self, actuators, columns, message):
        time = np.arange(0, 0.1, 0.01)
        recording = Recording(
            name="log", time=time, columns=dict.fromkeys(["hip/position", *columns], time)
        )
        with pytest.raises(InputError, match=message):
            routes(arm(actuators), recording)

    @pytest.mark.parametrize(
        ("actuators", "source", "target", "message"),
        [
            (
                "",
                "robots/arm.urdf",
                "position",
                r"no actuator in robots/arm\.urdf, and a URDF can have none\. .*callable` that "
                r"returns MjcfWalker\.from_file\('arm\.urdf', BuiltinPdActuatorCfg\(joint_names",
            ),
            ("", "arm.urdf", "velocity", r"BuiltinVelocityActuatorCfg\(.*, damping=\.\.\.\)\)\.$"),
            (
                '<motor joint="hip"/>',
                "robots:arm",
                "position",
                r"no `hip/effort_target`\. Log that .*IdealPdActuatorCfg, .* bare motor in the "
                r"MJCF: give as the model a `package\.module:callable` that returns the walker",
            ),
            (
                '<motor joint="hip"/>',
                "arm.xml",
                "position",
                r"`walkerkit servo` .*\. An actuator whose law runs in Python, .* bare motor",
            ),
        ],
    )
    def test_says_how_a_robot_gets_the_actuator(self, actuators, source, target, message):
        time = np.arange(0, 0.1, 0.01)
        columns = dict.fromkeys(["hip/position", f"hip/{target}_target"], time)
        with pytest.raises(InputError, match=message):
            routes(
                replace(arm(actuators), source=source),
                Recording(name="log", time=time, columns=columns),
            )

    def test_refuses_joints_that_the_model_lacks(self):
        time = np.arange(0, 0.1, 0.01)
        columns = {"kne/position": time, "kne/position_target": time}
        with pytest.raises(InputError, match=r"log: joint 'kne' .*did you mean 'knee'"):
            routes(arm(), Recording(name="log", time=time, columns=columns))


def moved(time, position):
    columns = {"hip/position": position, "hip/position_target": position}
    return Recording(name="log", time=time, columns=columns)


class TestSegments:
    def test_windows_adjoin_and_have_their_length(self):
        time = irregular()
        parts = windows(moved(time, np.sin(2 * time)), 0.2)
        assert [p.first for p in parts[1:]] == [p.last for p in parts[:-1]]
        start = time[0] + 0.025  # the state is not as well known at once
        for k, part in enumerate(parts):
            inside = (time >= start + 0.2 * k) & (time < start + 0.2 * (k + 1))
            np.testing.assert_array_equal(np.flatnonzero(inside), np.arange(part.first, part.last))
        assert time[-1] - time[parts[-1].last] < 0.2

    def test_windows_of_which_nothing_is_left_begin_at_once(self):
        time = np.arange(0, 1.0001, 0.01)
        parts = windows(moved(time, np.sin(2 * time)), 0.25)
        assert [part.start for part in parts] == [0, 0.25, 0.5, 0.75]

    @pytest.mark.parametrize("around", [0.375, 0.525, 0.675])
    def test_windows_wait_until_an_impact_is_over(self, around):
        time = np.arange(0, 3, 0.004)
        after = time - around
        position = np.where(after < 0, 2 * after, -5 * after * np.exp(-np.maximum(after, 0) / 0.03))
        noise = 1e-4 * np.random.default_rng(0).standard_normal(len(time))
        parts = windows(moved(time, position + noise), 0.5)
        starts = [part.start for part in parts]
        assert all(part.duration == pytest.approx(0.496, abs=1e-6) for part in parts)
        if around == 0.525:
            assert around + 0.01 < starts[1] < around + 0.15
            assert starts[2] == pytest.approx(starts[1] + 0.5)
        else:
            assert starts == pytest.approx([0.028 + 0.5 * k for k in range(5)], abs=0.004)

    def test_a_recording_shorter_than_a_window_stays_whole(self):
        recording = log(np.arange(0, 0.2, 0.01))
        assert windows(recording, 0.5) == whole(recording)
        assert cut([recording], None) == whole(recording)
        assert whole(recording)[0].duration == pytest.approx(0.19)

    def test_gaps_in_the_log_make_no_windows(self):
        # Two or three samples of some windows are left, too few to compare.
        time = np.r_[np.arange(0, 0.145, 0.01), np.arange(2.0, 2.295, 0.01)]
        parts = windows(moved(time, np.sin(2 * time)), 0.1)
        assert all(part.last - part.first >= 4 for part in parts)
        assert [part.start for part in parts] == pytest.approx([0.03, 2.03, 2.13], abs=1e-9)
        assert all(part.duration <= 0.1 + 1e-9 for part in parts)


class TestMeasuredState:
    def test_cubic_motion_is_found_exactly(self):
        time = 5.0 + np.arange(0, 0.5, 0.004)
        motion = np.polynomial.Polynomial([0.3, -1.0, 2.0, 4.0])
        recording = Recording(
            name="log",
            time=time,
            columns={"a/position": motion(time - 5), "a/position_target": time},
        )
        qpos, qvel = MeasuredState(recording, ["a"]).at(time)
        np.testing.assert_allclose(qpos[:, 0], motion(time - 5), atol=1e-12)
        np.testing.assert_allclose(qvel[:, 0], motion.deriv()(time - 5), atol=1e-9)

    def test_noise_becomes_less_and_nothing_lags(self):
        rng = np.random.default_rng(0)
        time = np.arange(0, 4, 0.002)
        true, speed = np.sin(6 * time), 6 * np.cos(6 * time)
        noisy = true + 1e-3 * rng.normal(size=len(time))
        recording = Recording(
            name="log", time=time, columns={"a/position": noisy, "a/position_target": true}
        )
        state = MeasuredState(recording, ["a"])
        qpos, qvel = (values[50:-50, 0] for values in state.at(time))
        assert np.std(qpos - true[50:-50]) < 0.5e-3
        assert np.std(qvel - speed[50:-50]) < 0.1
        lag = np.vdot(qvel - speed[50:-50], np.gradient(speed, time)[50:-50])
        assert abs(lag / np.vdot(np.gradient(speed, time), np.gradient(speed, time))) < 2e-4
        assert state.step == pytest.approx(0.002)

    @pytest.mark.parametrize("samples", [2, 3, 5, 8, 30])
    def test_short_recordings_have_a_state_too(self, samples):
        time = 0.01 * np.arange(samples)
        recording = Recording(
            name="log", time=time, columns={"a/position": 2 * time, "a/position_target": time}
        )
        qpos, qvel = MeasuredState(recording, ["a"]).at(np.array([-1.0, 0.0, time[-1], 9.0]))
        end = 2 * time[-1]
        np.testing.assert_allclose(qpos[:, 0], [0, 0, end, end], atol=1e-12)
        np.testing.assert_allclose(qvel, 2.0, rtol=1e-9)

    def test_is_worked_out_once_while_somebody_has_it(self):
        recording = log(np.arange(0, 1, 0.01))
        state = MeasuredState.shared(recording, ["hip"])
        assert MeasuredState.shared(recording, ["hip"]) is state
        assert MeasuredState.shared(log(recording.time), ["hip"]) is not state
        kept = weakref.ref(state)
        del state
        assert kept() is None


def test_long_segments_do_not_share_a_batch_beyond_its_size():
    recording = log(np.arange(0, 10, 0.01))
    parts = windows(recording, 1.0)
    assert len(parts) == 9
    assert [len(group) for group in similar_lengths(parts, 100.0)] == [9]
    groups = similar_lengths(parts, 4.0)
    assert [len(group) for group in groups] == [4, 4, 1]
    assert sorted(i for group in groups for i in group) == list(range(9))
    assert [len(group) for group in similar_lengths(parts, 0.1)] == [1] * 9
