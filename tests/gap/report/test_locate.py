"""Locating a gap that was put where it should be found, and how far joints went."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole, windows
from walkerkit.gap.report.locate import gap_map, locate, standing_out
from walkerkit.gap.report.regimes import EVERYWHERE, regimes
from walkerkit.gap.simulation.excursion import excursions
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Channel, Replay

LEG = """
<mujoco><compiler angle="radian"/><option gravity="0 0 0"/>
<worldbody><body><joint name="hip" axis="0 1 0" armature="0.3"/><geom size="0.01" mass="0.001"/>
  <body pos="0 0 -0.3"><joint name="knee" axis="0 1 0"/><geom size="0.1"/></body></body></worldbody>
<actuator>
  <position joint="hip" kp="{kp}" kv="2" {limit}/><position joint="knee" kp="20" kv="1"/>
</actuator></mujoco>
"""
JOINTS = ("hip", "knee")
CHANNELS = tuple(Channel(joint=joint, signal="position") for joint in JOINTS)
TIME = np.arange(0, 12, 0.004)
# Frequencies without a common period, so that no two regimes are the same samples.
TONES = {"hip": [(0.5, 2.1, 0.3), (0.1, 13.7, 1.0)], "knee": [(0.4, 3.3, 2.0), (0.08, 17.9, 0.1)]}


def motion(joint, order=0, time=TIME):
    """The joint's position or a derivative of it, from the formula."""
    return sum(
        a * w**order * np.sin(w * time + phase + order * np.pi / 2) for a, w, phase in TONES[joint]
    )


def leg(kp=50, limit=""):
    text = LEG.format(kp=kp, limit=limit)
    return robot_from_spec(mujoco.MjSpec.from_string(text), "leg.xml")


def log(name="log", time=TIME, joints=JOINTS, **more):
    columns = {}
    for joint in joints:
        columns[f"{joint}/position"] = motion(joint, time=time)
        columns[f"{joint}/position_target"] = motion(joint, time=time)
    return Recording(name=name, time=time, columns=columns | more)


def near_turn(joint):
    """Samples within 50 ms of a change of direction, from the formula."""
    fine = np.arange(-0.1, 12.1, 1e-4)
    turns = fine[1:][np.diff(np.sign(motion(joint, 1, fine))) != 0]
    return np.abs(TIME[:, None] - turns).min(axis=1) < 0.05


def place(where, joint="knee", size=0.01, more=()):
    """Locations of a gap of `size` in a part of the samples of one joint, and small noise."""
    recording = log(**dict(more))
    robot = leg()
    robot = replace(robot, excursions=excursions(robot, [recording], JOINTS))
    replay = Replay(robot, whole(recording), CHANNELS)
    residual = 1e-4 * np.random.default_rng(0).normal(size=replay.measured.shape)
    residual[where, JOINTS.index(joint)] += size
    return locate([replay], [residual], JOINTS)


def high(values, part):
    return np.abs(values) > part * np.percentile(np.abs(values), 99.5)


REGIMES = {
    "velocity_reversal": near_turn("knee"),
    "high_speed": high(motion("knee", 1), 0.6),
    "high_acceleration": high(motion("knee", 2), 0.6),
    "forward": motion("knee", 1) > 0.05 * np.abs(motion("knee", 1)).max(),
    "backward": motion("knee", 1) < -0.05 * np.abs(motion("knee", 1)).max(),
    "pose_low": motion("knee") < motion("knee").min() + np.ptp(motion("knee")) / 3,
    "pose_high": motion("knee") > motion("knee").max() - np.ptp(motion("knee")) / 3,
    "late": TIME > 8,
    "resting": np.abs(motion("knee", 1)) < 0.05 * np.abs(motion("knee", 1)).max(),
}


@pytest.mark.parametrize("regime", REGIMES)
def test_a_gap_is_found_in_its_regime(regime):
    where = REGIMES[regime]
    assert 0.05 < where.mean() < 0.6
    first = place(where)[0]
    assert (first.joint, first.regime) == ("knee", regime)
    assert first.share > 0.85
    # Half of all samples are the knee's.
    assert first.lift == pytest.approx(2 / where.mean(), rel=0.12)


def test_a_gap_in_both_directions_is_in_none():
    moving = REGIMES["forward"] | REGIMES["backward"]
    assert not {"forward", "backward"} & {at.regime for at in place(moving)}


def test_a_gap_at_high_effort_is_found_where_effort_was_logged():
    effort = np.sin(0.9 * TIME) ** 3
    where = np.abs(effort) > 0.6
    more = {"knee/effort": effort}
    first = place(where, more=[*more.items()])[0]
    assert (first.joint, first.regime) == ("knee", "high_effort")
    assert all(at.regime != "high_effort" for at in place(where))


def test_a_joint_is_found_and_every_joint_is_listed():
    found = place(np.ones(len(TIME), dtype=bool))
    assert all(at.joint == "knee" for at in found if at.regime != EVERYWHERE)
    whole_joints = [at for at in found if at.regime == EVERYWHERE]
    assert [at.joint for at in whole_joints] == ["knee", "hip"]
    assert found[-2:] == tuple(whole_joints)
    assert whole_joints[0].share == pytest.approx(1.0, abs=1e-3)
    assert whole_joints[0].lift == pytest.approx(2.0, abs=1e-2)
    assert sum(at.share for at in whole_joints) == pytest.approx(1.0)


def test_an_even_gap_is_nowhere_in_particular():
    found = place(np.zeros(len(TIME), dtype=bool))
    assert [at.regime for at in found] == [EVERYWHERE, EVERYWHERE]
    np.testing.assert_allclose([at.lift for at in found], 1.0, atol=0.1)
    recording, robot = log(), leg()
    replay = Replay(robot, whole(recording), CHANNELS)
    assert locate([replay], [np.zeros_like(replay.measured)], JOINTS) == ()


def test_the_map_has_every_regime_of_every_joint_that_occurs():
    recording = log()
    robot = leg()
    robot = replace(robot, excursions=excursions(robot, [recording], JOINTS))
    replay = Replay(robot, whole(recording), CHANNELS)
    residual = np.zeros_like(replay.measured)
    residual[:, 0], residual[:, 1] = 0.03, 0.01
    masks = [regimes(replay, JOINTS)]
    cells = gap_map(masks, [replay], [residual], JOINTS)
    named = {(at.joint, at.regime): at for at in cells}
    assert named.keys() == {(j, r) for j in JOINTS for r in (*REGIMES, EVERYWHERE)}
    for (joint, _), at in named.items():
        assert at.rms == pytest.approx({"hip": 0.03, "knee": 0.01}[joint])
        assert at.lift == pytest.approx({"hip": 1.8, "knee": 0.2}[joint])
    assert all(at.joint == "hip" for at in standing_out(cells) if at.regime != EVERYWHERE)
    # Radians and meters are not alike; how far above their noise they are, is.
    of = {"hip": 0.3, "knee": 0.01}
    shares = {
        at.joint: at.share
        for at in gap_map(masks, [replay], [residual], JOINTS, per=of)
        if at.regime == EVERYWHERE
    }
    assert shares == pytest.approx({"hip": 1 / 101, "knee": 100 / 101})
    # Nobody logged the effort.
    assert gap_map(masks, [replay], [residual], JOINTS, "effort") == ()


def test_an_effort_gap_has_its_own_map():
    effort = np.sin(0.9 * TIME) ** 3
    recording = log(**{"knee/effort": effort})
    robot = leg()
    robot = replace(robot, excursions=excursions(robot, [recording], JOINTS))
    channels = (*CHANNELS, Channel(joint="knee", signal="effort"))
    replay = Replay(robot, whole(recording), channels)
    residual = np.zeros_like(replay.measured)
    residual[np.abs(effort) > 0.6, 2] = 0.5
    cells = gap_map([regimes(replay, JOINTS)], [replay], [residual], JOINTS, "effort")
    assert {at.joint for at in cells} == {"knee"}
    first = standing_out(cells)[0]
    assert (first.signal, first.regime) == ("effort", "high_effort")
    assert first.rms == pytest.approx(0.5)


PENDULUM = """
<mujoco><compiler angle="radian"/>
<worldbody>{floor}<body pos="0 0 1"><joint name="hip" axis="0 1 0" armature="0.3"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.9" size="0.04" mass="1"/></body></worldbody>
<actuator><position joint="hip" kp="50"/></actuator></mujoco>
"""
FLOOR = '<geom type="plane" size="5 5 0.1" pos="0 0 0.1"/>'


@pytest.mark.parametrize("floor", ["", FLOOR], ids=["in the air", "over a floor"])
def test_load_and_contact_are_those_of_the_measured_pose(floor):
    spec = mujoco.MjSpec.from_string(PENDULUM.format(floor=floor))
    recording = log(joints=("hip",))
    robot = robot_from_spec(spec, "pendulum.xml")
    robot = replace(robot, excursions=excursions(robot, [recording], ["hip"]))
    found = regimes(Replay(robot, whole(recording), CHANNELS[:1]), ["hip"])["hip"]
    load = np.abs(np.sin(motion("hip")))  # m g l sin q
    high = load > 0.6 * load.max()
    assert np.mean(found["high_load"] != high) < 0.01
    # The foot's sphere of 4 cm hangs 0.9 m below the hip, and 2 mm above the floor it touches.
    near = 0.9 * np.cos(motion("hip")) + 0.04 > 0.9 - 0.002
    assert 0.1 < near.mean() < 0.9
    assert np.mean(found["contact"] != (near & bool(floor))) < 0.01


def test_resting_between_two_directions_belongs_to_the_reversal():
    time = np.arange(0, 4, 0.004)
    # Up for a second, a rest of 0.8 s, down again.
    position = np.interp(time, [0.5, 1.5, 2.3, 3.3], [0, 1, 1, 0])
    columns = {"hip/position": position, "hip/position_target": position}
    recording, robot = Recording(name="log", time=time, columns=columns), leg()
    robot = replace(robot, excursions=excursions(robot, [recording], ["hip"]))
    replay = Replay(robot, whole(recording), CHANNELS[:1])
    rest = (time > 1.5) & (time < 2.3)
    first = locate([replay], [rest[:, None] * 0.01], ["hip"])[0]
    assert first.regime == "velocity_reversal"
    assert first.share == pytest.approx(1.0)


def test_windows_of_a_recording_are_the_recording():
    recording, robot = log(), leg()
    robot = replace(robot, excursions=excursions(robot, [recording], JOINTS))
    found = []
    for segments in (whole(recording), windows(recording, 1.0)):
        replay = Replay(robot, segments, CHANNELS)
        residual = np.zeros_like(replay.measured)
        rows = slice(segments[0].first, segments[-1].last)
        residual[:, 1] = 0.01 * (motion("knee", 1) > 1.0)[rows]
        found.append(
            {(at.joint, at.regime): at.share for at in locate([replay], [residual], JOINTS)}
        )
    shared = found[0].keys() & found[1].keys()
    assert ("knee", "high_speed") in shared
    for key in shared:
        assert found[0][key] == pytest.approx(found[1][key], abs=0.06)


def test_joints_that_a_recording_lacks_take_no_part():
    robot = leg()
    both, hip = log(), log("hip", joints=("hip",))
    robot = replace(robot, excursions=excursions(robot, [both, hip], JOINTS))
    replay = Replay(robot, [*whole(both), *whole(hip)], CHANNELS)
    residual = np.where(np.isfinite(replay.measured), 0.01, np.nan)
    found = locate([replay], [residual], JOINTS)
    assert {at.joint: at.share for at in found if at.regime == EVERYWHERE} == {
        "hip": pytest.approx(2 / 3),
        "knee": pytest.approx(1 / 3),
    }
    # The gap is the same everywhere, so that no place has more than its part.
    assert all(at.regime == EVERYWHERE for at in found)
    np.testing.assert_allclose([at.lift for at in found], 1.0)


def test_several_robots_are_located_together():
    replays, residuals = [], []
    for size in (0.01, 0.03):
        recording, robot = log(), leg()
        robot = replace(robot, excursions=excursions(robot, [recording], JOINTS))
        replays.append(Replay(robot, whole(recording), CHANNELS))
        residuals.append(np.full_like(replays[-1].measured, size) * [0, 1])
    found = locate(replays, residuals, JOINTS)
    assert {at.joint: at.share for at in found if at.regime == EVERYWHERE} == {"knee": 1, "hip": 0}


class TestExcursions:
    def sine(self, amplitude=0.4, omega=5.0, **more):
        wave = amplitude * np.sin(omega * TIME)
        columns = {"hip/position": wave, "hip/position_target": 0 * TIME}
        return Recording(name="sine", time=TIME, columns=columns | more)

    def test_of_a_sine(self):
        found = excursions(leg(kp=1), [self.sine()], ["hip"])["hip"]
        assert found.lower == pytest.approx(-0.4, rel=1e-3)
        assert found.upper == pytest.approx(0.4, rel=1e-3)
        assert found.range == pytest.approx(0.8, rel=1e-3)
        assert found.velocity == pytest.approx(0.4 * 5, rel=0.01)
        assert found.acceleration == pytest.approx(0.4 * 25, rel=0.01)

    def test_effort_is_what_was_measured_or_else_the_largest_guess(self):
        robot = leg(kp=1)
        inertia = float(robot.model.dof_M0[0])
        # What accelerates the joint.
        found = excursions(robot, [self.sine()], ["hip"])["hip"]
        assert found.effort == pytest.approx(inertia * 0.4 * 25, rel=0.01)
        # What its servo would do.
        found = excursions(leg(kp=500), [self.sine()], ["hip"])["hip"]
        assert found.effort == pytest.approx(np.hypot(500 * 0.4, 2 * 0.4 * 5), rel=0.01)
        limited = leg(kp=500, limit='forcerange="-20 7" gear="1"')
        found = excursions(limited, [self.sine()], ["hip"])["hip"]
        assert found.effort == pytest.approx(20)
        # What was asked for.
        asked = self.sine(**{"hip/effort_target": 300 * np.cos(TIME)})
        found = excursions(robot, [asked], ["hip"])["hip"]
        assert found.effort == pytest.approx(300, rel=1e-3)
        # What was measured decides, in whatever recording it is the largest.
        logs = [self.sine(**{"hip/effort": size * np.cos(TIME)}) for size in (1.3, 0.7)]
        found = excursions(leg(kp=500), [*logs, asked], ["hip"])["hip"]
        assert found.effort == pytest.approx(1.3, rel=1e-3)

    def test_limits_of_geared_drives_are_at_the_joint(self):
        geared = leg(kp=500, limit='forcerange="-2 2" gear="-9"')
        found = excursions(geared, [self.sine()], ["hip"])["hip"]
        assert found.effort == pytest.approx(18)

    def test_all_recordings_count_and_missing_joints_are_left_out(self):
        robot = leg(kp=1)
        small, large = self.sine(0.1), self.sine(0.7)
        found = excursions(robot, [small, large], ["hip", "knee"])
        assert found.keys() == {"hip"}
        assert found["hip"].upper == pytest.approx(0.7, rel=1e-3)

    def test_a_joint_that_never_moves_has_a_size_still(self):
        columns = {"hip/position": 0 * TIME + 0.3, "hip/position_target": 0 * TIME + 0.3}
        still = Recording(name="still", time=TIME, columns=columns)
        found = excursions(leg(), [still], ["hip"])["hip"]
        assert min(found.range, found.velocity, found.acceleration, found.effort) > 0
        assert found.lower == 0.3
