"""Which target goes to which actuator, and what is said where one is missing."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from benchmarks.robots.written import WRITTEN
from tests.gap.simulation.own_log import gaps, own_log
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.simulation.commands import by_effort_alone, routes
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.untaken import before_gear, check_memory
from walkerkit.gap.units import with_checked_angles

TIME = np.arange(100) * 0.01
WAVE = 0.2 * np.sin(9 * TIME)


def robot(name):
    return robot_from_spec(mujoco.MjSpec.from_string(WRITTEN.get(name, name)), "arm.xml")


def log(*targets, joints=("shoulder", "elbow"), **columns):
    positions = {f"{joint}/position": 0.9 * WAVE for joint in joints}
    return Recording(
        name="log", time=TIME, columns={**positions, **dict.fromkeys(targets, WAVE), **columns}
    )


GRIPPER = ("shoulder/position_target", "elbow/position_target")
FINGERS = ("shoulder", "elbow", "left_finger", "right_finger")


def test_a_tendons_target_goes_by_the_name_of_its_actuator():
    found = routes(robot("gripper_on_a_tendon"), log(*GRIPPER, "grip/position_target"))
    assert [(r.joint and r.joint.name, r.drive.actuator) for r in found] == [
        ("shoulder", 0),
        ("elbow", 1),
        (None, 2),
    ]


@pytest.mark.parametrize(
    ("name", "recording", "message"),
    [
        (
            "gripper_on_a_tendon",
            log(*GRIPPER, joints=FINGERS),
            r"the actuator 'grip' of arm\.xml drives the tendon 'split', which moves 'left_finger',"
            r" 'right_finger', and the recording has no column for it; it would be held as the "
            r"model starts\. Log what it was sent as `grip/position_target`, or leave",
        ),
        (
            "gripper_on_a_tendon",
            log(*GRIPPER, "left_finger/position_target", joints=FINGERS),
            r"column `left_finger/position_target`: joint 'left_finger' has no actuator of its own "
            r"in arm\.xml; 'grip' moves it through the tendon 'split'\. Rename the column to "
            r"`grip/position_target`",
        ),
        (
            "gripper_on_a_tendon",
            log(*GRIPPER, "grip/velocity_target", joints=FINGERS),
            r"the actuator 'grip' of arm\.xml takes `grip/position_target`\. Rename",
        ),
        (
            "gripper_on_a_tendon",
            log(*GRIPPER, "gripp/position_target"),
            r"'gripp/position_target' is the target of nothing.*did you mean 'grip'",
        ),
        (
            "gripper_on_a_tendon",
            log(*GRIPPER, "left_finger/position_target", joints=("shoulder", "elbow")),
            r"joint 'left_finger' has 'left_finger/position_target' but no position",
        ),
        (
            "muscle",
            log("shoulder/position_target"),
            r"the actuator 'biceps' of arm\.xml, which moves 'elbow', is a muscle",
        ),
        (
            "muscle",
            log("shoulder/position_target", "elbow/position_target"),
            r"the actuator 'biceps' of joint 'elbow' in arm\.xml is a muscle.*no such target",
        ),
        (
            "dc_motors",
            log("shoulder/position_target", "elbow/voltage_target", "elbow/effort_target"),
            r"both `elbow/voltage_target` and `elbow/effort_target`, and its motor takes one",
        ),
        (
            "dc_motors",
            log("shoulder/position_target"),
            r"'elbow' has an actuator for voltage in arm\.xml.*no `elbow/voltage_target`",
        ),
        (
            "pair",
            log(*GRIPPER, "p/position_target"),
            r"column `p/position_target` is what a column of its joint says, too",
        ),
        (
            "site",
            log("elbow/position_target"),
            r"'pull' of arm\.xml drives the site 'pin', which moves 'shoulder'",
        ),
        (
            "slidercrank",
            log("elbow/position_target"),
            r"'piston' of arm\.xml drives the slider-crank 'pin', which moves 'shoulder'",
        ),
    ],
)
def test_what_is_missing_is_said(name, recording, message):
    if "left_finger" in message and "no position" in message:
        # A follower alone may go without.
        name = WRITTEN[name].partition("<equality>")[0] + (
            "<actuator>" + WRITTEN[name].partition("<actuator>")[2]
        )
    with pytest.raises(InputError, match=message):
        routes(robot(name), recording)


def test_an_actuator_without_a_name_is_asked_to_have_one():
    text = WRITTEN["gripper_on_a_tendon"].replace('name="grip" ', "")
    with pytest.raises(InputError, match=r"has no name by which.*Name it in the model"):
        routes(robot(text), log(*GRIPPER, joints=FINGERS))


def test_the_second_actuator_of_a_kind_goes_by_its_name():
    found = routes(robot("two_servos"), log(*GRIPPER, "elbow_2/position_target"))
    assert [(r.joint.name, r.drive.actuator) for r in found] == [
        ("shoulder", 0),
        ("elbow", 1),
        ("elbow", 2),
    ]


def test_all_of_them_may_go_by_their_names():
    names = ("shoulder/position_target", "p/position_target", "v/velocity_target")
    found = routes(robot("pair"), log(*names))
    assert [(r.column, r.joint.name, r.drive.kind) for r in found] == [
        ("shoulder/position_target", "shoulder", "position"),
        ("p/position_target", "elbow", "position"),
        ("v/velocity_target", "elbow", "velocity"),
    ]


def test_volts_may_be_called_an_effort():
    arm = robot("dc_motors")
    for column in ("elbow/effort_target", "elbow/voltage_target"):
        (_, route) = routes(arm, log("shoulder/position_target", column))
        assert (route.column, route.drive.kind, route.drive.slope) == (column, "voltage", 1.0)


def test_nothing_holds_a_motor_under_voltage():
    recording = log("shoulder/position_target", "elbow/voltage_target")
    assert by_effort_alone(robot("dc_motors"), recording) == ("elbow",)


@pytest.mark.parametrize(
    ("name", "targets", "joints"),
    [
        ("gripper_on_a_tendon", (*GRIPPER, "grip/position_target"), FINGERS),
        ("mimic", (*GRIPPER, "left_finger/position_target"), FINGERS),
        ("four_bar", ("crank/position_target",), ("crank", "coupler", "rocker")),
        ("many_inputs", GRIPPER, ("shoulder", "elbow")),
    ],
)
def test_tendons_and_loops_hold_joints(name, targets, joints):
    assert by_effort_alone(robot(name), log(*targets, joints=joints)) == ()


@pytest.mark.parametrize("name", ["cable", "site", "slidercrank", "joint_in_parent", "dc_motors"])
def test_own_logs_of_written_files_leave_no_gap(name):
    columns = own_log(mujoco.MjModel.from_xml_string(WRITTEN[name]), scale=0.3)
    assert max(gaps(WRITTEN[name], columns).values()) < 1e-4


def test_a_target_in_front_of_the_gear_is_found():
    arm = robot("dc_motors")
    assert not before_gear(arm, arm.joints["shoulder"], 0.9)
    assert not before_gear(arm, arm.joints["elbow"], 1 / 9)  # it takes volts
    recording = log("elbow/voltage_target", **{"shoulder/position_target": 8.5 * WAVE})
    with pytest.raises(InputError, match=r"control of shoulder.*its gear of 9.*Divide.*by 9"):
        with_checked_angles(arm, recording)


@pytest.mark.parametrize(
    ("actuator", "what"),
    [
        ('<pid name="m" joint="elbow" kp="9" kv="1" ki="2"/>', "an integral of its position error"),
        (
            '<dcmotor name="m" joint="elbow" motorconst=".1 .1" resistance=".5" '
            'thermal="1 1 0 .004 25 25"/>',
            "the temperature of its winding",
        ),
    ],
)
def test_what_remembers_for_long_is_not_restarted(actuator, what):
    text = WRITTEN["pair"].replace(
        '<position name="p" joint="elbow" kp="25"/><velocity name="v" joint="elbow" kv="1"/>',
        actuator,
    )
    arm = robot(text)
    with pytest.raises(InputError, match=f"joint 'elbow' is a .* that remembers {what}"):
        check_memory(arm, [log("shoulder/position_target")])
    check_memory(arm, [log("shoulder/position_target", joints=("shoulder",))])
