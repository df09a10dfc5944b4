"""The workflow on a one-joint rig: what is hidden is named, and nothing where nothing is."""

from __future__ import annotations

import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from tests.gap.progress import without_progress
from walkerkit.gap import workflow
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings import noise
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.report.diagnosis import Diagnosis, NamedEffect
from walkerkit.gap.report.result import Result
from walkerkit.gap.report.wording import basis, verdict_sentence
from walkerkit.gap.search import holds, naming
from walkerkit.gap.search.naming import Found
from walkerkit.gap.search.problem import Problem
from walkerkit.tasks.excitation import BATTERY

Array = NDArray[np.float64]

SERVO = """
<mujoco model="servo">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="knee" axis="0 1 0" armature="0.005" damping="0.1" range="-2 2" limited="true"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6"/>
    </body>
  </worldbody>
  <actuator><position joint="knee" kp="30" kv="1" forcerange="-20 20"/></actuator>
</mujoco>
"""
MOTOR = re.sub("<position.*?/>", '<motor joint="knee"/>', SERVO)
RATE, SECONDS = 250.0, 4.0
Q_ONLY = ("position_target", "position")


@pytest.fixture(scope="module")
def servo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("servo") / "servo.xml"
    path.write_text(SERVO)
    return path


@pytest.fixture(scope="module")
def logs(servo: Path) -> Callable[..., list[Recording]]:
    """Records the rig with effects hidden in it; the last of three recordings is held out."""
    known: dict[str, list[Recording]] = {}

    def record(*hidden: HiddenEffect, seed: int = 1, substeps: int = 4) -> list[Recording]:
        key = f"{hidden} {seed} {substeps}"
        if key not in known:
            known[key] = run_hardware(
                servo, targets(), rate=RATE, hidden=hidden, seed=seed, substeps=substeps
            )
        return known[key]

    return record


def targets() -> list[Array]:
    time = np.arange(0.0, SECONDS, 1 / RATE)
    rng = np.random.default_rng(0)
    return [
        BATTERY[name](
            time, lower=np.array([-0.8]), upper=np.array([0.8]), rng=rng, max_velocity=6.0
        )
        for name in ("multisine", "slow_triangle", "chirp")
    ]


def hide(effect: str, **values: float) -> HiddenEffect:
    return HiddenEffect(effect=effect, joints=("knee",), values=values)


def brief(recordings: Sequence[Recording], seconds: float = 1.5) -> list[Recording]:
    """Their beginnings, for what does not depend on how much is known."""
    return [replace(one.between(0.0, seconds), name=one.name) for one in recordings]


def seen(recordings: Sequence[Recording], *signals: str) -> list[Recording]:
    """The same recordings with some signals only."""
    return [
        Recording(
            name=recording.name,
            time=recording.time,
            columns={f"knee/{s}": recording.columns[f"knee/{s}"] for s in signals},
        )
        for recording in recordings
    ]


# What MuJoCo has natively is fast; that the whole catalogue leads to the same is the benchmark's
# and of the tests that ask for it.
# An effect has to win against what resembles it most: what acts while the joint moves, or what also
# acts while it rests.
MOVING = (
    *("viscous_friction", "coulomb_friction", "armature", "velocity_gain"),
    *("command_delay", "sensor_delay", "timestep"),
)
RESTING = (
    *("payload", "parallel_spring", "position_gain", "torque_constant", "torque_bias"),
    *("effort_limit", "encoder_offset", "base_tilt"),
)
PLAIN = (*MOVING, *RESTING)


def diagnose(model: Path, recordings: Sequence[Recording], **options: Any) -> Diagnosis:
    return workflow.diagnose(
        model, recordings, n_threads=1, **{"effects": PLAIN, **options}
    ).diagnosis


def values(named: NamedEffect) -> dict[str, float]:
    return {of.name: of.value for of in named.parameters}


# What is hidden is named


@pytest.mark.parametrize(
    ("hidden", "expected"),
    [
        (hide("viscous_friction", damping=0.2), {"damping": 0.2}),
        (hide("coulomb_friction", frictionloss=0.3), {"frictionloss": 0.3}),
        (hide("armature", armature=0.01), {"armature": 0.01}),
        (hide("command_delay", delay=0.01), {"delay": 0.01}),
        (hide("sensor_delay", delay=0.01), {"delay": 0.01}),
        (hide("position_gain", delta_kp=6.0), {"kp": 6.0}),
        (hide("velocity_gain", delta_kd=0.4), {"kd": 0.4}),
        (hide("torque_constant", alpha=0.15), {"strength": 0.15}),
        (hide("torque_bias", bias=0.3), {"bias": 0.3}),
        (hide("parallel_spring", stiffness=2.0, springref=0.3), {"stiffness": 2, "springref": 0.3}),
        (hide("effort_limit", forcerange=0.6), {"limit": 0.6}),
        (HiddenEffect(effect="payload", bodies=("arm",), values={"mass": 0.15}), {"mass": 0.15}),
    ],
    ids=lambda value: value.effect if isinstance(value, HiddenEffect) else "",
)
def test_a_hidden_effect_is_named_with_its_value(
    servo: Path,
    logs: Callable[..., list[Recording]],
    hidden: HiddenEffect,
    expected: dict[str, float],
) -> None:
    rivals = MOVING if hidden.effect in MOVING else RESTING
    found = diagnose(servo, logs(hidden), effects=rivals)
    assert [named.effect for named in found.effects] == [hidden.effect]
    (named,) = found.effects
    assert (named.joints, named.bodies) == (hidden.joints, hidden.bodies)
    assert values(named) == pytest.approx(expected, rel=0.1)
    # With an arm that is a seventh lighter the servo moves almost as with so much more torque.
    light = hidden.effect == "torque_constant"
    assert named.indistinguishable_from == (("payload",) if light else ())
    assert named.confidence > (0.85 if light else 0.9)
    assert found.verdict == "explained"
    assert found.gap.position.after < 0.9 * found.gap.position.before
    assert {of.at_bound for of in named.parameters} == {False}
    assert all(of.std is not None and of.std < 0.3 * abs(of.value) for of in named.parameters)
    assert [at.joint for at in found.locations] == ["knee"] * len(found.locations)


def test_two_hidden_effects_are_both_named(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    hidden = (hide("torque_bias", bias=0.3), hide("command_delay", delay=0.01))
    few = ("torque_bias", "encoder_offset", "command_delay", "sensor_delay", "viscous_friction")
    found = diagnose(servo, logs(*hidden), effects=few)
    named = {one.effect: one for one in found.effects}
    assert set(named) == {"torque_bias", "command_delay"}
    assert values(named["torque_bias"]) == pytest.approx({"bias": 0.3}, rel=0.1)
    assert values(named["command_delay"]) == pytest.approx({"delay": 0.01}, rel=0.1)
    assert found.verdict == "explained"
    first, second = found.effects
    assert found.gap.position.before > first.gap_after > second.gap_after
    assert second.gap_after == pytest.approx(found.gap.position.after)


LEG = SERVO.replace(
    "</body>",
    """<body name="shin" pos="0 0 -0.25">
        <joint name="ankle" axis="0 1 0" armature="0.005" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/>
      </body></body>""",
).replace("</actuator>", '<position joint="ankle" kp="20" kv="0.5"/></actuator>')


def test_the_joint_that_has_it_is_named(tmp_path: Path) -> None:
    model = tmp_path / "leg.xml"
    model.write_text(LEG)
    both = [np.hstack([one[:750], 0.7 * one[749::-1]]) for one in targets()]
    hidden = HiddenEffect(effect="torque_bias", joints=("ankle",), values={"bias": 0.3})
    recordings = run_hardware(model, both, rate=RATE, hidden=[hidden], seed=1)
    found = diagnose(model, recordings, effects=RESTING)
    (named,) = found.effects
    assert (named.effect, named.joints) == ("torque_bias", ("ankle",))
    assert values(named) == pytest.approx({"bias": 0.3}, rel=0.1)
    assert found.locations[-2].joint == "ankle"  # of the joints as a whole the first
    assert found.gap.joints["ankle"].before > found.gap.joints["knee"].before


ROOM = SERVO.replace(  # a second joint that the first does not feel
    "</worldbody>",
    """<body name="turret" pos="1 0 0">
        <joint name="yaw" axis="0 0 1" armature="0.005" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02" mass="0.6"/>
      </body></worldbody>""",
).replace("</actuator>", '<position joint="yaw" kp="30" kv="1"/></actuator>')


# Nothing is named where nothing is missing


def nothing_named(found: Diagnosis) -> None:
    assert found.verdict == "no_gap"
    assert found.effects == ()
    assert found.next_experiment is None
    assert found.gap.position.after == found.gap.position.before


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("signals", [("position_target", "position", "effort"), Q_ONLY])
def test_hardware_with_nothing_hidden_has_no_gap(
    servo: Path, logs: Callable[..., list[Recording]], seed: int, signals: Sequence[str]
) -> None:
    nothing_named(diagnose(servo, seen(logs(seed=seed), *signals)))


READ_FIRST = "Efforts were taken to be read before the targets beside them act"


@pytest.mark.parametrize(
    ("hidden", "expected"),
    [
        ([], []),
        ([hide("viscous_friction", damping=0.3)], ["viscous_friction"]),
        # Of two samples: what comes between the two cannot be told apart by efforts.
        ([hide("command_delay", delay=0.008)], ["command_delay"]),
    ],
)
def test_efforts_may_be_read_before_the_targets_beside_them_act(
    servo: Path, hidden: list[HiddenEffect], expected: list[str]
) -> None:
    """As a loop does that reads, computes and sends; they lag by a sample, but nothing is late."""
    recordings = run_hardware(servo, targets(), rate=RATE, hidden=hidden, seed=1, reads_first=True)
    found = diagnose(servo, recordings, effects=MOVING)
    assert [named.effect for named in found.effects] == expected
    assert found.verdict == ("explained" if expected else "no_gap")
    assert any(note.startswith(READ_FIRST) for note in found.notes)
    sizes = [size for one in hidden for size in one.values.values()]
    for named, value in zip(found.effects, sizes, strict=True):
        assert values(named) == pytest.approx({named.parameters[0].name: value}, rel=0.1)


def test_what_the_ordinary_bends_itself_to_follow_is_named(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    """Gains and a late command far from the model's nearly follow a late loop: a dead end."""
    hidden = hide("loop_delay", delay=0.02)
    others = ("position_gain", "actuator_lag", "velocity_filter", "asymmetric_friction")
    found = diagnose(servo, brief(logs(hidden)), effects=(*MOVING, "loop_delay", *others))
    assert found.effects[0].effect == hidden.effect
    assert values(found.effects[0]) == pytest.approx({"delay": 0.02}, rel=0.05)


def test_efforts_may_be_of_a_whole_cycle_before(servo: Path) -> None:
    """A position gain times a cycle is no damping that the servo lacks."""
    recordings = run_hardware(servo, targets(), rate=RATE, seed=1, substeps=1, reads_first=True)
    nothing_named(diagnose(servo, recordings, effects=MOVING))


def test_what_the_held_out_recording_does_not_show_is_not_missed(servo: Path) -> None:
    """The motor saturates in fast motions alone, and a slow one is held out."""
    hidden = [hide("effort_limit", forcerange=0.8)]
    fast, slow, faster = run_hardware(servo, targets(), rate=RATE, hidden=hidden, seed=1)
    told = workflow.compare(servo, [fast, faster, slow], n_threads=1)
    assert told.verdict == "unexplained"
    assert told.gap.position.before > 0.02
    assert not json.loads(told.to_json())["gap"]["held_out"]
    assert "on what was fitted" in basis(told)
    assert told.held_out == (slow.name,)
    few = ["effort_limit", "armature"]
    found = diagnose(servo, [fast, faster, slow], effects=few)
    assert [named.effect for named in found.effects] == ["effort_limit"]
    assert values(found.effects[0]) == pytest.approx({"limit": 0.8}, rel=0.02)
    # Whoever says so is told the same: what is held out takes part in no choice.
    declared = diagnose(servo, [fast, faster, slow], held_out=[slow], effects=few)
    assert (declared.effects, declared.gap) == (found.effects, found.gap)


def test_what_a_held_out_recording_alone_shows_is_fitted_in_blocks_of_time(servo: Path) -> None:
    """The motor saturates in the one recording that would be held out."""
    hidden = [hide("effort_limit", forcerange=0.8)]
    still, slow, fast = run_hardware(servo, targets(), rate=RATE, hidden=hidden, seed=1)
    few = ["effort_limit", "armature"]
    logs = [still, slow, fast]
    found = diagnose(servo, logs, effects=few)
    assert [named.effect for named in found.effects] == ["effort_limit"]
    assert values(found.effects[0]) == pytest.approx({"limit": 0.8}, rel=0.02)
    assert found.notes[0].startswith(f"{fast.name} alone shows a gap")
    # Whoever says so has it held out, and is told what remains.
    told = diagnose(servo, logs, held_out=[fast], effects=few)
    assert (told.verdict, told.effects) == ("unexplained", ())


def test_hardware_at_another_timestep_has_no_gap(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    nothing_named(diagnose(servo, logs(substeps=8)))


@pytest.mark.parametrize(
    ("timestep", "noise"),
    [(0.002, 1e-4), (0.002, 0.0), (0.0005, 1e-4)],
)
def test_the_model_itself_has_no_gap(timestep: float, noise: float, servo: Path) -> None:
    # Without noise there is no floor to stop at, and every effect would be tried.
    few = PLAIN if noise else ["viscous_friction", "command_delay"]
    found = diagnose(servo, stepped(timestep, noise), effects=few)
    nothing_named(found)
    if timestep == 0.002:
        assert found.gap.position.before <= max(1.5 * noise, 1e-6)
        assert found.gap.position.numerical_floor > 1e-4


def test_of_steps_that_are_too_long_nothing_else_is_named(tmp_path: Path) -> None:
    """What is chosen in place of one step has a numerical error of its own, like damping."""
    coarse = tmp_path / "coarse.xml"
    coarse.write_text(SERVO.replace('timestep="0.002"', 'timestep="0.01"'))
    # What shows it, the chirp, must not be held out.
    found = diagnose(coarse, stepped(1e-4, 5e-4)[::-1], effects=["timestep", *MOVING])
    assert [named.effect for named in found.effects] == ["timestep"]


def test_a_model_that_diverges_lacks_a_shorter_timestep(tmp_path: Path) -> None:
    stiff = SERVO.replace('kp="30" kv="1" forcerange="-20 20"', 'kp="300" kv="30"')
    stiff = stiff.replace(' integrator="implicitfast"', "")
    unstable = tmp_path / "unstable.xml"
    unstable.write_text(stiff)
    found = diagnose(unstable, stepped(5e-4, 1e-4, stiff), effects=["timestep", "armature"])
    assert math.isnan(found.gap.position.before)
    assert [named.effect for named in found.effects] == ["timestep"]
    assert found.verdict == "explained"
    assert "diverges with the model as it was given: " in found.notes[0]
    assert "unstable.xml at its timestep of 0.002 s" in found.notes[0]


def stepped(timestep: float, noise: float, text: str = SERVO) -> list[Recording]:
    """Logs of MuJoCo's own servo, all of it as in the model, with white noise."""
    spec = mujoco.MjSpec.from_string(text)
    spec.option.timestep = timestep
    model = spec.compile()
    recordings = []
    for k, (command,) in enumerate(one.T for one in targets()):
        random = np.random.default_rng([7, k])
        data = mujoco.MjData(model)
        data.qpos[0] = data.ctrl[0] = command[0]
        mujoco.mj_step(model, data, round(2 / timestep))
        position, effort = np.empty((2, len(command)))
        for row, target in enumerate(command):
            data.ctrl[0] = target
            position[row] = data.qpos[0]
            mujoco.mj_step(model, data)
            effort[row] = data.qfrc_actuator[0]
            mujoco.mj_step(model, data, round(1 / RATE / timestep) - 1)
        recordings.append(
            Recording(
                name=f"log_{k}",
                time=np.arange(len(command)) / RATE,
                columns={
                    "knee/position_target": command,
                    "knee/position": position + noise * random.standard_normal(len(command)),
                    "knee/effort": effort + 200 * noise * random.standard_normal(len(command)),
                },
            )
        )
    return recordings


# What is not in the catalogue is not explained by what is


def pendulum(
    seed: int, *, dead_zone: float = 0.0, push: float = 0.0, bias: float = 0.0
) -> list[Recording]:
    """The rig as a scalar equation of motion, eight steps a sample.

    Args:
        seed: of the noise and of the pushes.
        dead_zone: of the drive, rad: it does not see smaller errors.
        push: size of unrecorded pushes of 0.12 s, N·m.
        bias: constant torque that the drive does not know of, N·m.
    """
    model = mujoco.MjModel.from_xml_string(SERVO)
    inertia, lever = float(model.dof_M0[0]), 0.6 * 9.81 * 0.125
    step = 1 / RATE / 8
    recordings = []
    for k, (command,) in enumerate(one.T for one in targets()):
        random = np.random.default_rng([seed, k])
        pushed = np.zeros(len(command))
        for start in random.integers(0, len(command) - 30, 8):
            pushed[start : start + 30] += push * random.choice([-1.0, 1.0])
        q, speed = float(command[0]), 0.0
        position, effort = np.empty((2, len(command)))
        for row in range(-400, len(command)):
            target = float(command[max(row, 0)])
            for part in range(8):
                error = target - q
                error = math.copysign(max(abs(error) - dead_zone, 0.0), error)
                servo = 30 * error - speed
                if part == 0 and row >= 0:
                    position[row], effort[row] = q, servo
                torque = servo + bias - 0.1 * speed - lever * math.sin(q)
                torque += pushed[row] if row >= 0 else 0.0
                speed += step * torque / inertia
                q += step * speed
        recordings.append(
            Recording(
                name=f"log_{k}",
                time=np.arange(len(command)) / RATE,
                columns={
                    "knee/position_target": command,
                    "knee/position": position + 1e-4 * random.standard_normal(len(command)),
                    "knee/effort": effort + 0.02 * random.standard_normal(len(command)),
                },
            )
        )
    return recordings


def test_the_scalar_pendulum_is_the_rig(servo: Path) -> None:
    nothing_named(diagnose(servo, pendulum(1)))


@pytest.mark.parametrize(("missing", "size"), [("dead_zone", 0.05), ("push", 1.0)])
def test_what_the_catalogue_lacks_is_not_explained(servo: Path, missing: str, size: float) -> None:
    found = diagnose(servo, brief(pendulum(1, **{missing: size})), effects=MOVING)
    assert found.verdict in ("unexplained", "partly_explained")
    floor = found.gap.position.floor
    assert found.gap.position.after > 2 * floor
    assert found.remaining
    if missing != "dead_zone":  # which acts like a delay that grows as errors shrink
        assert found.effects == ()


@pytest.mark.parametrize(
    ("missing", "size", "expected"), [("bias", 0.3, "torque_bias"), ("", 0.0, None)]
)
def test_the_whole_catalogue(servo: Path, missing: str, size: float, expected: str | None) -> None:
    found = diagnose(servo, pendulum(1, **({missing: size} if missing else {})), effects=None)
    assert [named.effect for named in found.effects] == ([expected] if expected else [])
    for named in found.effects:
        assert values(named) == pytest.approx({"bias": size}, rel=0.1)


# What no data of these channels can part is said to be the same


def alike(found: Diagnosis, *effects: str) -> NamedEffect:
    """The one named effect, which is one of `effects` and cannot be told from the others."""
    (named,) = found.effects
    assert named.effect in effects
    assert set(effects) - {named.effect} <= set(named.indistinguishable_from)
    assert named.confidence > 0.9  # that of all of them together
    return named


def test_delays_are_alike_in_position(servo: Path, logs: Callable[..., list[Recording]]) -> None:
    of_command, of_sensor = (
        seen(logs(hide(effect, delay=0.01)), *Q_ONLY)
        for effect in ("command_delay", "sensor_delay")
    )
    for one, other in zip(of_command, of_sensor, strict=True):
        shift = np.abs(one.columns["knee/position"] - other.columns["knee/position"])
        assert shift.max() < 1e-3  # the data are the same, so the answer must be
    found = diagnose(servo, of_command, effects=MOVING)
    named = alike(found, "command_delay", "sensor_delay")
    assert values(named) == pytest.approx({"delay": 0.01}, rel=0.1)
    if found.next_experiment is not None:
        assert set(found.next_experiment.between) == {"command_delay", "sensor_delay"}
    # The effort parts them: `test_a_hidden_effect_is_named_with_its_value`.


@pytest.mark.parametrize(
    "hidden",
    [hide("viscous_friction", damping=0.2), hide("velocity_gain", delta_kd=0.4)],
)
def test_damping_is_alike_in_position(
    servo: Path, logs: Callable[..., list[Recording]], hidden: HiddenEffect
) -> None:
    found = diagnose(servo, seen(logs(hidden), *Q_ONLY), effects=MOVING)
    named = alike(found, "viscous_friction", "velocity_gain")
    assert list(values(named).values()) == pytest.approx(list(hidden.values.values()), rel=0.1)


@pytest.mark.parametrize(
    ("hidden", "size"),
    [
        (hide("encoder_offset", offset=0.05), 0.05),
        (HiddenEffect(effect="base_tilt", values={"roll": 0.0, "pitch": 0.1}), 0.1),
    ],
)
def test_tilt_and_offset_are_alike_on_one_joint(
    servo: Path, logs: Callable[..., list[Recording]], hidden: HiddenEffect, size: float
) -> None:
    found = diagnose(servo, logs(hidden), effects=RESTING)
    named = alike(found, "base_tilt", "encoder_offset")
    known = {of.name: of.value for of in named.parameters if of.std is not None}
    assert list(map(abs, known.values())) == pytest.approx([size], rel=0.1)
    # This joint does not feel a roll.
    assert known.keys() <= {"pitch", "ref"}
    assert values(named).get("roll", 0.0) == 0.0


# How recordings are used


def test_only_the_effects_asked_for_are_considered(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    recordings = logs(hide("viscous_friction", damping=0.2))
    found = diagnose(servo, recordings, effects=["torque_bias", "armature"])
    assert {one.effect for one in found.considered} <= {"torque_bias", "armature"}
    assert found.verdict == "unexplained"
    found = diagnose(servo, recordings, effects=["armature", "viscous_friction"])
    assert [named.effect for named in found.effects] == ["viscous_friction"]
    with pytest.raises(InputError, match=r"'armatur' .* catalogue \(did you mean 'armature'"):
        diagnose(servo, recordings, effects=["armatur"])


@pytest.mark.parametrize(("rows", "short"), [(150, True), (200, False)])
def test_what_short_recordings_say_is_said_with_reserve(
    servo: Path, logs: Callable[..., list[Recording]], rows: int, short: bool
) -> None:
    recordings = [
        Recording(
            name=log.name,
            time=log.time[:rows],
            columns={name: column[:rows] for name, column in log.columns.items()},
        )
        for log in logs()
    ]
    told = [note for note in workflow.compare(servo, recordings).notes if "together last" in note]
    assert bool(told) is short
    assert all("last 1.8 s" in note for note in told)


@pytest.mark.parametrize("factor", [0.5, 2.0])
def test_noise_that_is_misjudged_invents_no_effect(
    servo: Path,
    logs: Callable[..., list[Recording]],
    monkeypatch: pytest.MonkeyPatch,
    factor: float,
) -> None:
    estimate = noise.estimate

    def misjudged(signals: Sequence[Array]) -> noise.Noise:
        found = estimate(signals)
        return replace(found, std=factor * found.std)

    right = diagnose(servo, logs(), effects=[*MOVING, *RESTING])
    monkeypatch.setattr(noise, "estimate", misjudged)
    wrong = diagnose(servo, logs(), effects=[*MOVING, *RESTING])
    floors = (one.gap.position.noise_floor for one in (right, wrong))
    assert next(floors) * factor == pytest.approx(next(floors))
    assert right.effects == wrong.effects == ()


def hummed(recording: Recording) -> Recording:
    """The log with something in its effort that moves nothing."""
    effort = recording.columns["knee/effort"] + 0.4 * np.sin(19 * recording.time)
    return replace(recording, columns={**recording.columns, "knee/effort": effort})


def test_a_gap_is_explained_only_where_the_effort_is(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    damped = logs(hide("viscous_friction", damping=0.2))
    humming = [hummed(one) for one in damped]
    few = ["viscous_friction", "coulomb_friction"]
    clean, found = (diagnose(servo, some, effects=few) for some in (damped, humming))
    assert (clean.verdict, found.verdict) == ("explained", "partly_explained")
    for one in (clean, found):
        assert [named.effect for named in one.effects] == ["viscous_friction"]
        assert values(one.effects[0]) == pytest.approx({"damping": 0.2}, rel=0.1)
        assert one.gap.position.at_floor
    assert any(note.startswith("The effort error is") for note in found.notes)


def test_a_gap_of_the_effort_alone_is_a_gap(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    few = ["viscous_friction", "coulomb_friction"]
    found = diagnose(servo, [hummed(one) for one in logs()], effects=few)
    assert found.verdict == "unexplained"
    assert found.effects == ()
    assert found.gap.position.at_floor
    assert "the effort error is 0.28 N·m" in verdict_sentence(found)
    assert found.locations[0].rms == pytest.approx(0.28, rel=0.3)


def test_an_effort_that_the_drive_does_not_report_is_not_compared(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    without = seen(brief(logs(hide("torque_bias", bias=0.3))), *Q_ONLY)
    silent = [
        Recording(
            name=one.name,
            time=one.time,
            columns={**one.columns, "knee/effort": np.zeros(len(one.time))},
        )
        for one in without
    ]
    few = ["torque_bias"]
    found, expected = (diagnose(servo, some, effects=few) for some in (silent, without))
    assert set(found.gap.signals) == {"position"}
    assert (found.gap, found.effects) == (expected.gap, expected.effects)
    assert found.effects
    assert any("Columns that nothing uses: knee/effort" in note for note in found.notes)


def test_an_effort_that_repeats_its_command_is_not_compared(tmp_path: Path) -> None:
    model = tmp_path / "motor.xml"
    model.write_text(MOTOR)
    logged = jolted()
    echoing = [
        replace(one, columns={**one.columns, EFFORT: 2 * one.columns["knee/effort_target"]})
        for one in logged
    ]
    found, expected = (workflow.compare(model, some, n_threads=1) for some in (echoing, logged))
    assert found.gap == expected.gap
    assert set(found.gap.signals) == {"position"}
    told = " ".join(found.notes)
    assert "a: knee/effort is knee/effort_target times 2, so it tells nothing of the drive" in told
    assert "Columns that nothing uses: knee/effort." in told


HAND = re.sub(
    "(<geom.*/>)(.*?)<actuator>(.*)</actuator>",
    r"""\1<body name="hand" pos="0 0 -0.25"><joint name="finger" axis="0 1 0"/>
      <geom size="0.02" mass="0.01"/><body><joint name="tip" axis="0 1 0" damping="0.01"/>
      <joint name="nail" axis="1 0 0" damping="0.01"/><geom size="0.01" mass="0.01"/></body></body>
      \2<actuator>\3<position joint="finger" kp="3" kv="0.1"/>
      <motor joint="nail"/></actuator>""",
    SERVO,
    flags=re.DOTALL,
)


@pytest.mark.parametrize("key", ["", '<key qpos="0 0.2 0.1 0" ctrl="0 0.2 0.5"/>'])
def test_joints_that_the_recordings_lack_are_told_in_one_note(
    tmp_path: Path, logs: Callable[..., list[Recording]], key: str
) -> None:
    model = tmp_path / "hand.xml"
    model.write_text(HAND.replace("</actuator>", f"</actuator><keyframe>{key}</keyframe>"))
    told = [
        note
        for note in workflow.compare(model, brief(logs()), n_threads=1).notes
        if "finger" in note or "tip" in note
    ]
    what = "finger (held at 0 rad by its actuator); tip, nail (free). "
    pose = "reference pose"
    if key:
        what = (
            "finger (held at 0.2 rad by its actuator); tip (free); nail (its actuator gets the "
            "control 0.5). "
        )
        pose = "first keyframe"
    (note,) = told
    assert note.startswith(f"The recordings lack joints that the model has: {what}The simulation")
    assert f"at rest where the model's {pose} has them" in note


def test_a_joint_that_some_recordings_lack_is_told_with_their_names(tmp_path: Path) -> None:
    model = tmp_path / "hand.xml"
    model.write_text(HAND)
    time = np.arange(0.0, 1.0, 0.004)
    columns = {"knee/position": 0.1 * np.sin(5 * time), "knee/position_target": 0 * time}
    finger = {"finger/position": 0.1 * np.cos(5 * time), "finger/position_target": 0 * time}
    found = workflow.compare(
        model,
        [
            Recording(name="a", time=time, columns=columns | finger),
            Recording(name="b", time=time, columns=columns),
            Recording(name="c", time=time, columns=columns | finger),
        ],
        n_threads=1,
    )
    assert any("finger (held at 0 rad by its actuator, in b); tip" in one for one in found.notes)


def test_targets_that_the_model_clips_are_told(
    servo: Path, tmp_path: Path, logs: Callable[..., list[Recording]]
) -> None:
    def told(text: str, recordings: Sequence[Recording]) -> list[str]:
        model = tmp_path / "clips.xml"
        model.write_text(text)
        notes = workflow.compare(model, recordings, n_threads=1).notes
        return [note for note in notes if "ctrlrange" in note]

    narrow = SERVO.replace(
        "<position ", '<position name="m" ctrlrange="-1 0.3" ctrllimited="true" '
    )
    assert told(SERVO, brief(logs())) == []
    assert told(narrow.replace("0.3", "0.9"), brief(logs())) == []
    (note,) = told(narrow, logs())
    assert "clips.xml clips targets at the ctrlrange of their actuators: knee/position_tar" in note
    assert 'goes from -0.8 to 0.8 rad, and m, ctrlrange="-1 0.3", takes -1 to 0.3 rad.' in note
    assert "Widen the ctrlrange" in note
    motor = '<motor joint="knee" gear="2" ctrlrange="-0.5 0.5" ctrllimited="true"/>'
    (note,) = told(MOTOR.replace('<motor joint="knee"/>', motor), jolted())
    assert "knee/effort_target goes from " in note
    assert 'N·m, and its actuator, ctrlrange="-0.5 0.5", takes -1 to 1 N·m.' in note


def test_a_joint_that_never_moves_does_not_hide_the_others(tmp_path: Path) -> None:
    model = tmp_path / "room.xml"
    model.write_text(ROOM)
    recordings = [
        Recording(
            name=one.name,
            time=one.time,
            columns={
                **one.columns,
                "yaw/position": np.zeros(len(one.time)),
                "yaw/position_target": np.zeros(len(one.time)),
            },
        )
        for one in pendulum(1, bias=0.3)
    ]
    found = diagnose(model, recordings, effects=["torque_bias", "viscous_friction"])
    (named,) = found.effects
    assert (named.effect, named.joints) == ("torque_bias", ("knee",))
    assert values(named) == pytest.approx({"bias": 0.3}, rel=0.1)


def test_a_log_that_shows_what_was_commanded_before_has_no_gap(servo: Path) -> None:
    """As of a script that sets the control, steps, and logs: what was commanded until then."""
    late = [
        replace(
            one,
            columns={
                **one.columns,
                "knee/position_target": np.roll(one.columns["knee/position_target"], 1),
            },
        ).between(0.1, 3.9)
        for one in stepped(5e-4, 1e-4)
    ]
    found = diagnose(servo, late, effects=[*MOVING, "clock_skew"])
    nothing_named(found)
    assert any("move the targets up by a row" in note for note in found.notes), found.notes


def test_an_offset_of_the_log_alone_is_told(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    """A wave that is too long to be one would follow it as well, and is no explanation."""
    shifted = [
        replace(one, columns={**one.columns, "knee/position": one.columns["knee/position"] + 0.03})
        for one in logs()
    ]
    found = diagnose(servo, shifted, effects=["kinematic_error", "encoder_offset", "torque_bias"])
    assert (found.verdict, found.effects) == ("unexplained", ())
    (note,) = [one for one in found.notes if "have the same zero" in one]
    assert note.startswith("knee/position is 30 mrad more than the simulation's in every motion")
    whole = diagnose(servo, logs(), effects=["encoder_offset"])
    assert not any("have the same zero" in one for one in whole.notes)


def test_compare_measures_the_gap_that_diagnose_starts_from(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    recordings = brief(logs(hide("viscous_friction", damping=0.2)))
    compared = workflow.compare(servo, recordings, n_threads=1)
    found = diagnose(servo, recordings, effects=["viscous_friction"])
    assert compared.gap.position.before == found.gap.position.before
    assert compared.gap.position.after == compared.gap.position.before
    assert compared.locations == found.locations
    assert compared.effects == compared.considered == ()


def test_the_gap_is_that_of_the_recordings_held_out(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    good, bad = logs(), logs(hide("torque_bias", bias=0.3))
    mixed = [bad[0], good[1], bad[2]]
    found = workflow.compare(servo, mixed, held_out=[good[1]], n_threads=1)
    assert found.gap.position.before < 0.003
    found = workflow.compare(servo, mixed, held_out=["experiment_2"], n_threads=1)
    assert found.gap.position.before > 0.009
    assert set(found.recordings) == {"experiment_0", "experiment_1", "experiment_2"}


def test_targets_between_samples_are_read_as_the_log_wants(servo: Path) -> None:
    """A log of every fifth command is better interpolated than held."""
    model = mujoco.MjModel.from_xml_string(SERVO)
    recordings = []
    for k, frequency in enumerate((1.0, 2.0, 3.0)):
        time = np.arange(0.0, SECONDS, model.opt.timestep)
        command = 0.5 * np.sin(frequency * time)
        data, position = mujoco.MjData(model), np.empty(len(time))
        random = np.random.default_rng(k)
        for row, target in enumerate(command):
            data.ctrl[0] = target
            position[row] = data.qpos[0] + 1e-4 * random.standard_normal()
            mujoco.mj_step(model, data)
        columns = {"knee/position_target": command[::5], "knee/position": position[::5]}
        recordings.append(Recording(name=f"log_{k}", time=time[::5], columns=columns))
    few = ["viscous_friction", "command_delay"]
    result = workflow.diagnose(servo, recordings, effects=few, n_threads=1)
    nothing_named(result.diagnosis)
    assert result.problem.hold == "linear"
    assert any("interpolated" in note for note in result.diagnosis.notes)


def test_other_readings_of_targets_are_searched_only_where_they_promise_more(
    servo: Path, logs: Callable[..., list[Recording]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The hardware's friction leaves a gap beside dry friction, whatever the targets are."""
    searched = []

    def search(problem: Problem, *rest: Any, **options: Any) -> Found:
        searched.append(problem.hold)
        return naming.search(problem, *rest, **options)

    monkeypatch.setattr(holds, "search", search)
    found = diagnose(servo, logs(hide("coulomb_friction", frictionloss=0.3)), effects=MOVING)
    assert [named.effect for named in found.effects] == ["coulomb_friction"]
    assert found.gap.position.after > 3 * found.gap.position.noise_floor
    assert searched == ["zero_order"]


def test_targets_may_be_shown_after_the_period_that_they_were_for(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    """As by a loop that commands, steps and then logs what it has commanded."""

    def shown_late(recording: Recording) -> Recording:
        columns = dict(recording.columns)
        target = columns["knee/position_target"]
        columns["knee/position_target"] = np.append(target[:1], target[:-1])
        return replace(recording, columns=columns)

    hidden = hide("viscous_friction", damping=0.3)
    for recordings, expected in ((logs(), []), (logs(hidden), ["viscous_friction"])):
        late = [shown_late(one) for one in recordings]
        result = workflow.diagnose(servo, late, effects=MOVING, n_threads=1)
        found = result.diagnosis
        assert result.problem.hold == "next"
        assert [named.effect for named in found.effects] == expected
        assert found.verdict == ("explained" if expected else "no_gap")
        assert any("from the row before" in note for note in found.notes)


def test_joints_driven_by_effort_are_compared_over_windows(tmp_path: Path) -> None:
    model = tmp_path / "motor.xml"
    model.write_text(MOTOR)
    recordings = []
    for recording in pendulum(1):
        columns = dict(recording.columns)
        # What the drive made is what the motor is told to make.
        columns["knee/effort_target"] = columns.pop("knee/effort")
        del columns["knee/position_target"]
        recordings.append(Recording(name=recording.name, time=recording.time, columns=columns))
    found = workflow.compare(model, recordings, window=0.25, n_threads=1)
    assert found.gap.horizon == 0.25
    assert any("every 0.25 s" in note for note in found.notes)
    whole = workflow.compare(model, recordings, window=math.inf, n_threads=1)
    assert whole.gap.position.before > 2 * found.gap.position.before


def test_the_noise_of_the_states_that_replays_restart_from_is_no_gap(tmp_path: Path) -> None:
    motor = MOTOR.replace('damping="0.1" ', "")
    path = tmp_path / "motor.xml"
    path.write_text(motor)
    model = mujoco.MjModel.from_xml_string(motor.replace('timestep="0.002"', 'timestep="0.0005"'))
    rng, std = np.random.default_rng(0), 5e-4
    recordings = []
    for name in ("a", "b"):
        data = mujoco.MjData(model)
        data.qpos = 0.5
        time = np.arange(0, 12, 1 / RATE)
        columns = {"knee/position": np.empty(len(time)), "knee/effort_target": np.empty(len(time))}
        phase = rng.uniform(0, 6)
        for k, now in enumerate(time):
            data.ctrl = 0.3 * np.sin(4 * now + phase)
            columns["knee/effort_target"][k] = data.ctrl[0]
            columns["knee/position"][k] = data.qpos[0] + std * rng.standard_normal()
            mujoco.mj_step(model, data, nstep=round(1 / RATE / model.opt.timestep))
        recordings.append(Recording(name=name, time=time, columns=columns))
    found = workflow.compare(path, recordings, n_threads=1)
    size = found.gap.position
    assert size.noise_floor > 1.5 * std
    assert size.before == pytest.approx(size.floor, rel=0.3)
    assert found.verdict == "no_gap"


def jolted(*, frictionloss: float = 0.0) -> list[Recording]:
    """A leg's joint driven by torque, which is asked for a pose from the first sample on."""
    model = mujoco.MjModel.from_xml_string(MOTOR.replace('timestep="0.002"', 'timestep="0.0005"'))
    model.dof_frictionloss = frictionloss
    # Soft friction pushes on where a torque slows a joint faster than it would; no real one does.
    model.dof_solref, model.dof_solimp[:, :2] = (2 * model.opt.timestep, 1.0), 0.99
    rng = np.random.default_rng(0)
    recordings = []
    for name, pose in (("a", 0.9), ("b", -0.7), ("c", 0.6)):
        data, time = mujoco.MjData(model), np.arange(0.0, 3.0, 1 / RATE)
        columns = {"knee/position": np.empty(len(time)), "knee/effort_target": np.empty(len(time))}
        for k, now in enumerate(time):
            target = pose * np.cos(3 * now)
            data.ctrl = np.clip(60 * (target - data.qpos) - 1.5 * data.qvel, -18, 18)
            columns["knee/effort_target"][k] = data.ctrl[0]
            columns["knee/position"][k] = data.qpos[0] + 1e-4 * rng.standard_normal()
            mujoco.mj_step(model, data, nstep=round(1 / RATE / model.opt.timestep))
        recordings.append(Recording(name=name, time=time, columns=columns))
    return recordings


@pytest.mark.parametrize("frictionloss", [0.0, 0.3])
def test_a_log_may_begin_with_a_jolt(tmp_path: Path, frictionloss: float) -> None:
    path = tmp_path / "motor.xml"
    path.write_text(MOTOR)
    found = diagnose(path, jolted(frictionloss=frictionloss))
    if not frictionloss:
        nothing_named(found)
        return
    (named,) = found.effects
    assert named.effect == "coulomb_friction"
    assert values(named)["frictionloss"] == pytest.approx(frictionloss, rel=0.03)


EFFORT = "knee/effort"


def test_effort_in_another_unit_is_told_of(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    known = logs(hide("coulomb_friction", frictionloss=0.3))

    def told(factor: float) -> list[str]:
        scaled = [
            replace(one, columns={**one.columns, EFFORT: factor * one.columns[EFFORT]})
            for one in known
        ]
        notes = diagnose(servo, scaled, effects=["coulomb_friction"]).notes
        return [note for note in notes if "The logged effort is" in note]

    (note,) = told(1.4)
    factor = float(note.split("same motion, ")[1].split(" times at knee")[0])
    assert factor == pytest.approx(1.4, rel=0.05)
    assert told(1.0) == []


WHEEL = """
<mujoco><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body><joint name="wheel" axis="0 0 1" damping="0.2" armature="0.05"/>
  <inertial pos="0 0 0" mass="1" diaginertia="0.15 0.15 0.15"/></body></worldbody>
<actuator><velocity joint="wheel" kv="8"/></actuator></mujoco>
"""


def test_a_late_command_is_a_late_log_whatever_the_timestep_makes_of_it(tmp_path: Path) -> None:
    path = tmp_path / "wheel.xml"
    path.write_text(WHEEL)
    rng, late, step, rows = np.random.default_rng(0), 0.0175, 1e-4, 600
    recordings = []
    for name in ("a", "b", "c"):
        target = np.repeat(rng.uniform(-3, 3, rows // 20), 20)
        target[:50] = 0.0
        q, speed, position, velocity = 0.0, 0.0, np.empty(rows), np.empty(rows)
        for k in range(100 * rows):
            if k % 100 == 0:
                position[k // 100], velocity[k // 100] = q, speed
            sent = target[max(0, math.floor((k * step - late) * 100))]
            speed += step * (8 * (sent - speed) - 0.2 * speed) / 0.2
            q += step * speed
        columns = {
            "wheel/velocity_target": target,
            "wheel/position": position + 1e-4 * rng.standard_normal(rows),
            "wheel/velocity": velocity + 2e-3 * rng.standard_normal(rows),
        }
        recordings.append(Recording(name=name, time=np.arange(rows) / 100, columns=columns))
    (named,) = diagnose(path, recordings, effects=["command_delay", "sensor_delay"]).effects
    assert {named.effect, *named.indistinguishable_from} == {"command_delay", "sensor_delay"}
    assert named.parameters[0].value == pytest.approx(late, abs=1e-3)


def test_progress_goes_from_0_to_1_in_every_stage(
    servo: Path, logs: Callable[..., list[Recording]]
) -> None:
    told: list[tuple[str, float]] = []
    workflow.diagnose(
        servo,
        brief(logs(hide("torque_bias", bias=0.3))),
        effects=["torque_bias", "payload"],
        n_threads=1,
        progress=lambda stage, done: told.append((stage, done)),
    )
    assert told[-1][0] == "writing up"
    assert all(stage and 0 <= done <= 1 for stage, done in told)


def test_a_result_prints_its_verdict(servo: Path, logs: Callable[..., list[Recording]]) -> None:
    hidden = hide("torque_bias", bias=0.3)
    logged = brief(logs(hidden))
    result = workflow.diagnose(servo, logged, effects=["torque_bias"], n_threads=1)
    assert isinstance(result, Result)
    assert "torque_bias" in str(result)
    assert "knee" in str(result)


# The same input gives the same bytes


def test_results_depend_neither_on_threads_nor_on_hashes(
    servo: Path, logs: Callable[..., list[Recording]], tmp_path: Path
) -> None:
    files = []
    for recording in seen(brief(logs(hide("viscous_friction", damping=0.2))), *Q_ONLY):
        files.append(tmp_path / f"{recording.name}.csv")
        recording.save(files[-1])
    few = ("viscous_friction", "velocity_gain")
    command = ["diagnose", servo, *files, "--out", tmp_path / "one", "--threads", 2]
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "walkerkit.gap",
            *map(str, command),
            *map("--effect={}".format, few),
        ],
        capture_output=True,
        env={**os.environ, "PYTHONHASHSEED": "1"},  # here it is drawn
        timeout=100,
        check=False,
    )
    assert (done.returncode, without_progress(done.stderr.decode())) == (0, "")
    workflow.diagnose(servo, files, effects=few, n_threads=1, out=tmp_path / "two")
    first, other = (content(tmp_path / name) for name in ("one", "two"))
    assert "next_experiment.csv" in first  # there is a confusion set, so that order can matter
    assert other == first


def content(folder: Path) -> dict[str, bytes]:
    """Every file of a folder, but for the seconds that the run took."""
    found = {path.name: path.read_bytes() for path in sorted(folder.iterdir())}
    diagnosis = json.loads(found["diagnosis.json"])
    seconds = json.dumps(diagnosis["seconds"])
    found["diagnosis.json"] = found["diagnosis.json"].replace(seconds.encode(), b"")
    del found["report.html"]  # says the seconds in words; has its own test
    return found
