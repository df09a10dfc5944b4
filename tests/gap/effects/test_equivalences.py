"""Equivalences: the logs are the same where the table says so, and differ where it does not."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.effects.equivalences import (
    _TABLE,
    CHANGES_THE_DRIVES_EFFORT,
    carriers,
    equivalences,
    spelled_out,
    wholes,
)
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.trials import Trials

ARM = """
<mujoco><compiler angle="radian"/><option timestep="0.0005" integrator="implicitfast"/>
<worldbody><body name="arm"><joint name="knee" {joint}/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.6"/></body></worldbody>
<actuator><position name="k" joint="knee" kp="30" kv="{kv}"/></actuator></mujoco>
"""
SWINGING = 'axis="0 1 0" armature="0.01" damping="0.3"'
LEVEL = 'axis="0 0 1" armature="0.01" damping="0.3"'
CHANNELS = tuple(Channel(joint="knee", signal=s) for s in ("position", "velocity", "effort"))
TURN = 0.1
TURNED = (0.15 * np.sin(TURN), 0.15 * (1 - np.cos(TURN)))  # x and z of the centre of mass
# Per pair: the joint, the drive's damping, and the values that make the same log.
CASES = {
    ("command_delay", "sensor_delay"): (SWINGING, 1, (0.01,), (0.01,)),
    ("viscous_friction", "velocity_gain"): (SWINGING, 1, (0.4,), (0.4,)),
    ("position_gain", "torque_constant"): (SWINGING, 0, (6.0,), (0.2,)),
    ("encoder_offset", "base_tilt"): (SWINGING, 1, (TURN,), (0.0, TURN)),
    ("com_offset", "encoder_offset"): (SWINGING, 1, TURNED, (TURN,)),
    ("com_offset", "base_tilt"): (SWINGING, 1, TURNED, (0.0, TURN)),
    ("encoder_gain", "torque_constant"): (LEVEL, 1, (0.2,), (0.2,)),
    ("torque_bias", "asymmetric_friction"): (
        SWINGING + ' frictionloss="0.5"',
        1,
        (-0.3,),
        (0.3, -0.3),
    ),
    # The mass is 0.2 m from the axis.
    ("armature", "payload"): (
        LEVEL.replace('"0 0 1"', '"0 0 1" pos="0.2 0 0"'),
        1,
        (0.3 * 0.2**2,),
        (0.3,),
    ),
}


def arm(joint=SWINGING, kv=1):
    return robot_from_spec(mujoco.MjSpec.from_string(ARM.format(joint=joint, kv=kv)), "arm.xml")


# One effect, and the two that are the same together.
SPELLED_OUT = {
    "asymmetric_friction": (
        (0.5, 0.2),
        {"coulomb_friction": (0.35,), "torque_bias": (-0.15,)},
    ),
    "directional_efficiency": (
        (0.8, 1.1),
        {"load_dependent_friction": (0.15 / 0.95,), "torque_constant": (-0.05,)},
    ),
}


def logs(robot, planted, site=None):
    """What planted effects leave in the log, (rows, channels): position, velocity, effort.

    They are at a site, by default the knee or what it moves.
    """
    time = np.arange(0.0, 3.0, 0.002)
    target = 0.4 * np.sin(4 * time + time**2) * (time > 0.3)
    columns = {}
    for joint in robot.joints:
        columns[f"{joint}/position"] = 0 * time
        columns[f"{joint}/position_target"] = target if joint == "knee" else -0.7 * target
    log = Recording(name="log", time=time, columns=columns)
    channels = [replace(channel, joint=joint) for joint in robot.joints for channel in CHANNELS]
    replay = Replay(robot, whole(log), channels, n_threads=1)
    trials = Trials(robot, 1)
    for effect, values in planted.items():
        there = site or CATALOGUE[effect].sites(robot, ["knee"])[0]
        CATALOGUE[effect].apply(trials, there, np.array([values]))
    # Gravity pulls at once, also on a robot that is said to rest where it would not.
    return replay.predict(trials)[0][time > 1.5]


def apart_by(robot, first, second, site=None):
    """What parts two robots, of what the effects of the first one change, (channels,).

    Those of the second are at a site.
    """
    plain, one, other = logs(robot, {}), logs(robot, first), logs(robot, second, site)
    size = np.sqrt(np.mean((one - plain) ** 2, axis=0))
    return np.sqrt(np.mean((one - other) ** 2, axis=0)) / np.maximum(size, 1e-9)


def two_links(*, elbow='axis="0 1 0"', hand=""):
    """A leg of two links; what the hand has is carried by the second."""
    return robot_from_spec(
        mujoco.MjSpec.from_string(f"""
        <mujoco><compiler angle="radian"/><option timestep="0.0005" integrator="implicitfast"/>
        <default><joint armature="0.01" damping="0.3"/></default>
        <worldbody><body name="upper"><joint name="hip" axis="0 1 0"/>
          <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.6"/>
          <body name="arm" pos="0 0 -0.2"><joint name="knee" {elbow}/>
            <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.6"/>{hand}</body>
        </body>
        </worldbody>
        <actuator><position joint="hip" kp="30" kv="1"/><position joint="knee" kp="30" kv="1"/>
        </actuator></mujoco>"""),
        "two.xml",
    )


def test_a_last_link_in_a_plane_turns_as_its_centre_of_mass_does():
    robot, turned = two_links(), {"encoder_offset": (TURN,)}
    upper = {"com_offset": (0.1 * np.sin(TURN), 0.1 * (1 - np.cos(TURN)))}
    assert (apart_by(robot, turned, {"com_offset": TURNED}, "arm") < 0.02).all()
    assert (apart_by(robot, turned, upper, "upper") > 0.3).all()
    every = ("position", "velocity", "effort")
    assert "com_offset" in equivalences("encoder_offset", every, robot=robot, joints=("knee",))
    assert "com_offset" not in equivalences("encoder_offset", every, robot=robot, joints=("hip",))
    assert carriers(robot, ["arm"]) == ("knee",)
    assert carriers(robot, ["upper", "arm"]) == ("hip", "knee")
    for bodies, same in ((["arm"], True), (["upper"], False), (["upper", "arm"], False)):
        found = equivalences("com_offset", every, robot=robot, bodies=bodies)
        assert ("encoder_offset" in found) is same


@pytest.mark.parametrize(
    "other",
    [
        {"elbow": 'axis="1 0 0"'},  # out of the plane the inertia turns with the body
        {"elbow": 'axis="0 1 0" stiffness="1"'},  # whose spring rests elsewhere
        {"elbow": 'type="slide" axis="0 1 0"'},
        {"hand": '<body name="hand"><geom size="0.02" mass="0.1"/></body>'},
        {
            "hand": '<body name="hand"><joint name="wrist" axis="0 1 0"/>'
            '<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-9 1e-9 1e-9"/></body>'
        },
    ],
    ids=["axes cross", "spring", "slide", "two bodies", "another joint"],
)
def test_elsewhere_it_does_not(other):
    robot = two_links(**other)
    assert "com_offset" not in equivalences("encoder_offset", [], robot=robot, joints=("knee",))


@pytest.mark.parametrize("pair", CASES, ids=" ".join)
def test_equivalent_effects_leave_the_same_log(pair):
    joint, kv, *values = CASES[pair]
    robot = arm(joint, kv)
    first, second = ({effect: v} for effect, v in zip(pair, values, strict=True))
    difference = apart_by(robot, first, second)
    (entry,) = (entry for entry in _TABLE if entry.effects == pair and entry.beside is None)
    for channel, apart in zip(CHANNELS, difference, strict=True):
        if channel.signal in entry.parted_by:
            assert apart > 0.2, channel
        else:
            assert apart < 0.02, channel
    signals = [c.signal for c in CHANNELS if c.signal not in entry.parted_by]
    for one, other in (pair, pair[::-1]):
        found = equivalences(one, signals, robot=robot, joints=("knee",))
        assert found[other] == entry.reason
        if entry.parted_by:
            assert other not in equivalences(one, ("position", "effort"), robot=robot)


def test_every_entry_whose_effects_exist_is_simulated():
    wanted = {e.effects for e in _TABLE if set(e.effects) <= set(CATALOGUE) and e.beside is None}
    assert wanted <= set(CASES)


def test_without_a_robot_what_holds_on_most():
    assert set(equivalences("sensor_delay", ["position"])) == {"command_delay"}
    assert set(equivalences("viscous_friction", ["position", "velocity"])) == {"velocity_gain"}
    assert equivalences("viscous_friction", ["position", "effort"]) == {}
    assert equivalences("position_gain", ["position"]) == {}


def test_a_special_robot_is_needed():
    assert "torque_constant" in equivalences("position_gain", ["position"], robot=arm(kv=0))
    assert equivalences("position_gain", ["position"], robot=arm(kv=1)) == {}
    assert equivalences("armature", ["position"], robot=arm()) == {}
    assert equivalences("encoder_offset", ["position"], robot=arm(LEVEL)) == {}


def test_a_delay_of_one_joint_of_several_is_not_a_late_log(plain):
    robot, _ = plain
    assert equivalences("command_delay", ["position"], robot=robot, joints=("knee",)) == {}
    shared = equivalences("command_delay", ["position"], robot=robot, joints=("*",))
    assert set(shared) == {"sensor_delay"}


def test_only_the_joint_that_carries_all_turns_the_robot_as_a_tilted_base(plain):
    robot, _ = plain
    found = {j: equivalences("encoder_offset", [], robot=robot, joints=(j,)) for j in robot.joints}
    assert set(found["hip"]) == {"base_tilt"}
    assert found["knee"] == {}
    assert equivalences("base_tilt", [], robot=robot, joints=("*",)) == {}


def test_a_bias_beside_dry_friction_is_friction_of_two_sizes():
    assert equivalences("torque_bias", ["position", "effort"]) == {}
    beside = equivalences("torque_bias", ["position", "effort"], beside=["coulomb_friction"])
    assert set(beside) == {"asymmetric_friction"}
    mean = equivalences("coulomb_friction", ["position", "effort"], beside=["torque_bias"])
    assert mean == beside


@pytest.mark.parametrize("effect", SPELLED_OUT)
def test_two_effects_that_one_is_the_shorter_name_for(effect):
    values, pair = SPELLED_OUT[effect]
    assert apart_by(arm(), {effect: values}, pair).max() < 0.02
    ((names, reason),) = spelled_out(effect).items()
    assert set(names) == set(pair)
    assert reason.endswith(".")
    # With one of the two named, the other is not a pair's but its own.
    assert spelled_out(effect, beside=[names[0]]) == {}
    assert all(spelled_out(name) == {} for name in names)
    # Each of the two is what it is with the other at zero.
    assert all(wholes(name) == (effect,) for name in names)
    assert wholes(effect) == ()


def test_every_pair_that_one_effect_is_the_name_for_is_simulated():
    assert {e.effects[1] for e in _TABLE if e.whole} == set(SPELLED_OUT)


# The arm's servo has kp 30 and kv 1.
BESIDE = {
    "velocity_gain": ({"torque_constant": (0.2,)}, (0.2,)),
    "viscous_friction": ({"torque_constant": (0.2,), "viscous_friction": (0.1,)}, (0.3,)),
}


@pytest.mark.parametrize("damping", BESIDE)
def test_beside_damping_a_stronger_motor_is_a_higher_gain(damping):
    motor, own = BESIDE[damping]
    gains = {"position_gain": (6.0,), damping: own}
    *moved, effort = apart_by(arm(), motor, gains)
    assert max(moved) < 0.02
    assert effort > 0.1
    found = equivalences("position_gain", ["position"], robot=arm(), beside=[damping])
    assert set(found) == {"torque_constant"}
    assert equivalences("position_gain", ["position", "effort"], beside=[damping]) == {}
    assert spelled_out("torque_constant") == {}


@pytest.mark.parametrize("bend", [0.002, 0.02])
def test_beside_bristles_a_bias_is_friction_of_two_sizes(bend):
    bristles = {"presliding_friction": (0.5, bend)}
    bias = bristles | {"torque_bias": (-0.3,)}
    two_sizes = bristles | {"asymmetric_friction": (0.3, -0.3)}
    assert apart_by(arm(), bias, two_sizes).max() < 1e-6
    pair, signals = ("torque_bias", "asymmetric_friction"), ("position", "velocity", "effort")
    for one, other in (pair, pair[::-1]):
        assert set(equivalences(one, signals, beside=["presliding_friction"])) == {other}


DAMPINGS = ("viscous_friction", "velocity_gain")


@pytest.mark.parametrize(
    "third", [n for n in CATALOGUE if n not in DAMPINGS and CATALOGUE[n].sites(arm(), ["knee"])]
)
def test_damping_of_joint_and_drive_differ_beside_what_changes_the_drives_effort(third):
    robot, effect = arm(), CATALOGUE[third]
    (site, *_) = effect.sites(robot, ["knee"])
    starts = [parameter.starts for parameter in effect.parameters(robot, site)]
    apart = 0.0
    for k in (0, -1):
        values = tuple(own[k] for own in starts)
        planted = [{}, *({damping: (0.4,)} for damping in DAMPINGS)]
        plain, one, other = (logs(robot, {third: values, **damping}) for damping in planted)
        size, difference = (np.sqrt(np.mean(d**2, axis=0)) for d in (one - plain, one - other))
        apart = max(apart, float((difference / size)[:2].max()))  # of position and velocity
    assert (third in CHANGES_THE_DRIVES_EFFORT) is (apart > 0.02)
    one, other = DAMPINGS
    found = equivalences(one, ["position"], robot=robot, joints=["knee"], beside=[third])
    assert (other in found) is (apart < 0.02)


def test_every_pair_beside_a_third_is_simulated():
    beside = [(e.effects, e.beside) for e in _TABLE if e.beside is not None and not e.whole]
    motor = {(("position_gain", "torque_constant"), damping) for damping in BESIDE}
    assert {*beside} == {*motor, (("torque_bias", "asymmetric_friction"), "presliding_friction")}
