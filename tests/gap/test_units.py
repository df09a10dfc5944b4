"""Columns of one joint in different units are refused; machines that do little are not."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import lfilter

from walkerkit.gap import InputError, compare
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.simulation.load_robot import load_robot, robot_from_spec
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.units import (
    velocity_likeness,
    with_checked_angles,
    with_checked_extent,
    with_checked_velocities,
)

FloatArray = NDArray[np.float64]

MODEL = """
<mujoco model="arm">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="elbow" axis="0 1 0" armature="0.005" damping="0.05" {}/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/>
    </body>
  </worldbody>
  <actuator><position joint="elbow" kp="20" kv="0.6"/></actuator>
</mujoco>
"""
RANGE = 'limited="true" range="-2 2"'
NARROW = 'limited="true" range="-0.3 0.3"'
POSITION, TARGET, VELOCITY = (f"elbow/{s}" for s in ("position", "position_target", "velocity"))
TIME = np.arange(1500) / 500
Motion = tuple[FloatArray, FloatArray]


def robot(limits: str = RANGE) -> Robot:
    return robot_from_spec(mujoco.MjSpec.from_string(MODEL.format(limits)), "arm.xml")


def log(position: FloatArray, target: FloatArray | None = None, **more: FloatArray) -> Recording:
    noise = 1e-4 * np.random.default_rng(0).standard_normal(len(TIME))
    columns = {POSITION: position + noise, TARGET: target}
    columns |= {f"elbow/{name}": values for name, values in more.items()}
    kept = {name: values for name, values in columns.items() if values is not None}
    return Recording(name="log", time=TIME, columns=kept)


def times(recording: Recording, column: str, factor: float) -> Recording:
    columns = {**recording.columns, column: factor * recording.columns[column]}
    return replace(recording, columns=columns)


def late(values: FloatArray, rows: int) -> FloatArray:
    return np.concatenate([np.full(rows, values[0]), values[:-rows]])


def chirp(amplitude: float = 0.7) -> FloatArray:
    return amplitude * np.sin(2 * TIME + 3 * TIME**2)


def steps() -> FloatArray:
    return 0.6 * np.sign(np.sin(5 * TIME))


def lagging(
    target: FloatArray, gain: float = 1.0, offset: float = 0.0, tau: float = 0.03
) -> Motion:
    """A servo of the first order, a little late."""
    share = 0.002 / (tau + 0.002)
    reached, _ = lfilter([share], [1, share - 1], target, zi=[(1 - share) * target[0]])
    return gain * late(reached, 5) + offset, target


SERVOS: dict[str, Motion] = {
    "follows": lagging(chirp()),
    "steps": lagging(steps()),
    "late": lagging(chirp(), tau=0.1),
    "weak": lagging(chirp(), gain=0.4),
    "off by a constant": lagging(chirp(0.4), offset=0.3),
    "a small motion": lagging(chirp(0.15)),
    "turned round": lagging(chirp(), gain=-1.0),
}


@pytest.mark.parametrize("limits", [RANGE, ""], ids=["range", "no range"])
@pytest.mark.parametrize("column", [POSITION, TARGET])
@pytest.mark.parametrize("name", SERVOS)
def test_one_column_in_degrees_is_refused(name: str, column: str, limits: str) -> None:
    proper = log(*SERVOS[name])
    assert with_checked_angles(robot(limits), proper) is proper
    wrong = times(proper, column, 180 / np.pi)
    if (name, column, limits) == ("weak", TARGET, ""):
        checked = with_checked_angles(robot(limits), wrong)  # what a servo so weak would do
        assert "or the target is in degrees" in checked.notes[0]
        return
    peak = np.abs(wrong.columns[column]).max()
    with pytest.raises(
        InputError, match=rf"^log: column '{column}' reaches {peak:.4g}.* degrees; .* pi/180"
    ) as refusal:
        with_checked_angles(robot(limits), wrong)
    assert ("arm.xml ends at 2 rad" in str(refusal.value)) == bool(limits)


def test_a_pose_that_is_held_says_it_too() -> None:
    held = log(np.full(len(TIME), 0.51), np.full(len(TIME), 0.5))
    for column in (POSITION, TARGET):
        with pytest.raises(InputError, match=f"'{column}' reaches"):
            with_checked_angles(robot(), times(held, column, 180 / np.pi))


def test_a_position_that_follows_nothing_may_be_in_degrees() -> None:
    swings = log(np.rad2deg(chirp(0.6)), np.zeros(len(TIME)))
    with pytest.raises(InputError, match=f"'{POSITION}' reaches 34.*{TARGET}.*in radians"):
        with_checked_angles(robot(), swings)


def test_a_position_without_a_target_is_held_against_its_range() -> None:
    swings = log(np.rad2deg(chirp(0.6)), effort_target=np.sin(TIME))
    with pytest.raises(InputError, match=f"'{POSITION}' reaches 34.*multiply it by pi/180"):
        with_checked_angles(robot(), swings)


def test_both_in_degrees_are_refused_by_the_range() -> None:
    both = times(times(log(*SERVOS["follows"]), POSITION, 180 / np.pi), TARGET, 180 / np.pi)
    with pytest.raises(InputError, match="both look like degrees; multiply both by pi/180"):
        with_checked_angles(robot(), both)


def test_both_in_degrees_are_told_of_together_where_one_of_them_is_clearly_beyond() -> None:
    """At a resonance the position is far beyond the range, and its target is not."""
    swings = log(14.0 * np.sin(20 * TIME), 7.5 * np.sin(20 * TIME + 1.0))
    with pytest.raises(InputError) as refusal:
        with_checked_angles(robot(), swings)
    assert f"column '{POSITION}' reaches 14 and '{TARGET}' 7.5, where" in str(refusal.value)
    assert "both look like degrees; multiply both by pi/180" in str(refusal.value)


def walk(size: float) -> FloatArray:
    """A joint that is pushed about."""
    noise = np.random.default_rng(1).standard_normal(len(TIME))
    smooth: FloatArray = lfilter(np.ones(100) / 100, 1, noise)
    return size * smooth / np.abs(smooth).max()


HARMLESS: dict[str, tuple[str, FloatArray, FloatArray]] = {
    "unpowered": ("", walk(0.01), chirp()),
    "unpowered and swinging": ("", walk(2.0), chirp(0.03)),
    "stuck": (RANGE, np.full(len(TIME), 0.2), chirp()),
    "stuck beside a small command": (RANGE, np.full(len(TIME), 1.5), chirp(0.02)),
    "saturated": (RANGE, np.clip(lagging(chirp(1.9))[0], -0.2, 0.2), chirp(1.9)),
    "asked to go beyond its stops": (NARROW, np.clip(chirp(2.5), -0.3, 0.3), chirp(2.5)),
    "many turns": ("", 14 * TIME, 14 * TIME + 0.1),
    "wrapped": ("", np.angle(np.exp(14j * TIME)), 14 * TIME),
    "whole turns from its target": (NARROW, lagging(chirp(0.1))[0] + 2 * np.pi, chirp(0.1)),
    "held whole turns away": (NARROW, np.full(len(TIME), 6.38), np.full(len(TIME), 0.1)),
    "pushed while it is held": ("", walk(1.0), np.full(len(TIME), 0.3)),
}


@pytest.mark.parametrize("name", HARMLESS)
def test_a_machine_that_does_little_is_not_refused(name: str) -> None:
    limits, position, target = HARMLESS[name]
    assert with_checked_angles(robot(limits), log(position, target)).notes == ()


def test_a_joint_that_moves_by_as_little_as_if_is_told_of() -> None:
    (note,) = with_checked_angles(robot(), log(*lagging(chirp(), gain=0.02))).notes
    assert note.startswith(f"{POSITION} moves by 0.019 of what its target does: the joint hardly")


def test_metres_are_no_angles() -> None:
    slide = robot_from_spec(
        mujoco.MjSpec.from_string(MODEL.format('type="slide" limited="true" range="-0.5 0.5"')),
        "lift.xml",
    )
    recording = times(log(*SERVOS["follows"]), POSITION, 57.3)
    assert with_checked_angles(slide, recording) is recording


def moving() -> tuple[FloatArray, FloatArray]:
    return chirp(), np.gradient(chirp(), TIME)


@pytest.mark.parametrize(
    ("factor", "message"),
    [
        (
            180 / np.pi,
            rf"'{VELOCITY}' is 5[67].* times .*degrees per second; .* pi/180",
        ),
        (-180 / np.pi, rf"'{VELOCITY}' is 5[67].* times .*degrees per second"),
        (30 / np.pi, rf"'{VELOCITY}' is 9\.[345]\d times .*revolutions per minute; .* by pi/30"),
        (np.pi / 30, r"is 0.10. times .*rpm that were converted twice; multiply it by 30/pi"),
        (0.5 / np.pi, r"is 0.15. times .*revolutions per second; multiply it by 2 pi"),
        (np.pi / 180, rf"is 0.017\d times .*'{POSITION}' looks like degrees; multiply it and its"),
    ],
)
@pytest.mark.parametrize("kind", ["as it is", "noisy", "filtered", "quantised"])
def test_a_velocity_in_another_unit_is_refused(factor: float, message: str, kind: str) -> None:
    position, velocity = moving()
    recording = log(position, velocity=factor * READ[kind](velocity), effort_target=velocity)
    with pytest.raises(InputError, match=f"^log: column {message}" if factor > 1 else message):
        with_checked_velocities(robot(""), recording)


def filtered(velocity: FloatArray, hertz: float = 15.0) -> FloatArray:
    share = 1 / (1 + 500 / (2 * np.pi * hertz))
    values: FloatArray = lfilter([share], [1, share - 1], velocity)
    return values


READ: dict[str, Callable[[FloatArray], FloatArray]] = {
    "as it is": lambda velocity: velocity,
    "noisy": lambda v: v + 0.5 * np.random.default_rng(2).standard_normal(len(v)),
    "filtered": filtered,
    "heavily filtered": lambda velocity: filtered(velocity, 5.0),
    "quantised": lambda velocity: 0.5 * np.round(velocity / 0.5),
    "of an encoder's steps": lambda _: np.gradient(0.0015 * np.round(chirp() / 0.0015), TIME),
    "noise": lambda v: np.random.default_rng(3).standard_normal(len(v)),
}


@pytest.mark.parametrize("kind", READ)
def test_velocities_as_drives_report_them_pass(kind: str) -> None:
    position, velocity = moving()
    recording = log(position, velocity=READ[kind](velocity), effort_target=velocity)
    assert with_checked_velocities(robot(), recording) is recording


def test_a_wheel_at_one_speed_has_a_velocity() -> None:
    wheel = log(14 * TIME, velocity=np.full(len(TIME), 14 * 57.3), effort_target=TIME)
    with pytest.raises(InputError, match=r"57\.3 times"):
        with_checked_velocities(robot(""), wheel)


def test_a_joint_that_stands_has_none() -> None:
    still = log(np.zeros(len(TIME)), velocity=chirp(), effort_target=TIME)
    assert with_checked_velocities(robot(), still) is still
    assert velocity_likeness(log(chirp(), effort_target=TIME), "elbow") is None


def test_a_velocity_before_the_gear_is_told_of() -> None:
    position, velocity = moving()
    recording = log(position, velocity=20 * velocity, effort_target=velocity)
    (note,) = with_checked_velocities(robot(), recording).notes
    assert note.startswith(f"{VELOCITY} is 20 times the slope of {POSITION}, with a correlation of")


TURNED = 25 * TIME + np.sin(5 * TIME)
"""Of a wheel, 75 rad."""
SPEED = np.gradient(TURNED, TIME)


@pytest.mark.parametrize(
    "more",
    [
        {"velocity": SPEED, "position_target": TURNED},
        {"velocity": -SPEED, "velocity_target": SPEED},  # a wiring error, which is found later
        {"velocity": 60 / (2 * np.pi) * SPEED, "velocity_target": SPEED},  # rpm, too
        {"velocity_target": 1.5 * SPEED},
        {"velocity": 0 * SPEED, "position_target": TURNED},
    ],
    ids=["velocity", "sign", "rpm", "target", "winds up"],
)
def test_a_wheel_may_turn_as_far_as_it_goes(more: dict[str, FloatArray]) -> None:
    notes = with_checked_extent(robot(""), log(TURNED, **more)).notes
    assert notes[0].startswith(f"{POSITION} goes as far as 75.6")
    assert "which was taken for 12 turns of a wheel" in notes[0]


def test_a_wheel_may_turn_back() -> None:
    turned = 60 * np.sin(4 * TIME)
    back = log(turned, velocity=np.gradient(turned, TIME), velocity_target=0 * TIME)
    assert len(with_checked_extent(robot(""), back).notes) == 1


@pytest.mark.parametrize(
    ("column", "recording"),
    [
        (POSITION, log(60 * np.sin(4 * TIME), 0.1 + 60 * np.sin(4 * TIME))),
        (POSITION, log(np.rad2deg(TURNED), velocity_target=SPEED)),
        (POSITION, log(np.rad2deg(TURNED), velocity=np.rad2deg(SPEED), velocity_target=SPEED)),
        (TARGET, log(TURNED / 75, np.rad2deg(TURNED))),
    ],
    ids=["swings", "beside a target", "both beside a target", "the target alone"],
)
def test_a_hinge_without_a_range_that_may_be_in_degrees_is_refused(
    column: str, recording: Recording
) -> None:
    message = f"'{column}' has .* at row .*, over 50 rad: looks like degrees; .*elbow/velocity"
    with pytest.raises(InputError, match=message):
        with_checked_extent(robot(""), recording)


def test_a_joint_may_be_as_far_as_its_range() -> None:
    recording = log(TURNED, velocity_target=SPEED)
    assert with_checked_extent(robot('limited="true" range="-80 80"'), recording) is recording
    message = r"'elbow/position' has 50.0\d* at row \d+, over 50 rad.* of arm.xml ends at 2 rad\.$"
    with pytest.raises(InputError, match=message):
        with_checked_extent(robot(), recording)


def test_a_slide_is_in_millimetres() -> None:
    lift = MODEL.replace('name="elbow"', 'name="elbow" type="slide"')
    message = "over 50 m: looks like millimetres; divide it by 1000. "
    for limits, remedy in (("", "Where it goes so far, give"), (RANGE, "The joint .* ends at 2 m")):
        slide = robot_from_spec(mujoco.MjSpec.from_string(lift.format(limits)), "arm.xml")
        with pytest.raises(InputError, match=message + remedy):
            with_checked_extent(slide, log(TURNED, velocity=SPEED, velocity_target=SPEED))


class TestCompare:
    @pytest.fixture
    def arm(self, tmp_path: Path) -> Path:
        path = tmp_path / "arm.xml"
        path.write_text(MODEL.format(RANGE), encoding="utf-8")
        return path

    @pytest.mark.parametrize("column", [POSITION, TARGET, VELOCITY])
    def test_refuses_them(self, arm: Path, column: str) -> None:
        position, target = lagging(chirp())
        proper = log(position, target, velocity=np.gradient(position, TIME))
        with pytest.raises(InputError, match=f"'{column}'.*looks like degrees"):
            compare(arm, [times(proper, column, 180 / np.pi)])

    def test_takes_a_wheel(self, arm: Path) -> None:
        text = MODEL.format("").replace("<position", "<velocity").replace('kp="20" ', "")
        arm.write_text(text, encoding="utf-8")
        wheel = log(TURNED, velocity=SPEED, velocity_target=SPEED)
        wrapped = np.arctan2(np.sin(TURNED), np.cos(TURNED))
        for recording in (wheel, replace(wheel, columns={**wheel.columns, POSITION: wrapped})):
            assert compare(arm, [recording]).gap.position.before < 2.0

    def test_tells_of_a_gear_and_of_a_sign(self, arm: Path) -> None:
        position, target = lagging(chirp())
        velocity = np.gradient(position, TIME)
        found = compare(arm, [log(position, target, velocity=20 * velocity)])
        assert any("of the motor before its gear" in note for note in found.notes)
        found = compare(arm, [log(position, target, velocity=-filtered(velocity, 5.0))])
        assert found.notes[0].startswith("The sign of elbow is flipped: elbow/velocity.")


def test_logs_of_real_hardware_pass(real_logs: Path) -> None:
    for model, pattern in (
        *((f"xl330/kp{gain}.xml", f"xl330/kp{gain}_*.csv") for gain in (100, 200, 400, 800)),
        ("emps/emps.xml", "emps/*.csv"),
        ("double_pendulum/double_pendulum.xml", "double_pendulum/*.csv"),
    ):
        real = load_robot(real_logs / model)
        for path in sorted(real_logs.glob(pattern)):
            recording = Recording.load(path)
            assert with_checked_extent(real, recording) is recording
            assert with_checked_angles(real, recording) is recording
            assert with_checked_velocities(real, recording) is recording


def test_a_position_in_ticks_beside_a_target_in_radians_is_told_so() -> None:
    angle = 0.6 * np.sin(4 * TIME)
    read = {POSITION: np.rint(2048 + angle * 4096 / (2 * np.pi))}
    recording = log(angle, angle)
    ticks = replace(recording, columns={**recording.columns, **read})
    message = r"'elbow/position'.*looks like ticks of an encoder, 4096 a turn; make it \(n - 2048\)"
    with pytest.raises(InputError, match=message):
        with_checked_extent(robot(), ticks)
