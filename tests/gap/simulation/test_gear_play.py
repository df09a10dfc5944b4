"""Play between motors and links, against the equations of two masses and what it has to keep."""

import functools
import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from dm_control import composer

from tests.gap.simulation.follow import Follow
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.gear_play import with_play
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.mended import Mended
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.trials import Trials

ROTOR, WEIGHT = 0.004, 0.5 * 9.81 * 0.1  # kg·m²; N·m
ROD = """
<mujoco><compiler angle="radian"/><option timestep="{step}" integrator="implicitfast"/>
<worldbody><body name="rod"><joint name="j" axis="0 1 0" armature="0.004" damping="0.05"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.5"/></body></worldbody>
<actuator>{actuator}</actuator></mujoco>"""
MOTOR, SERVO = '<motor joint="j"/>', '<position joint="j" kp="30" kv="1"/>'
CHANNELS = [Channel(joint="j", signal=signal) for signal in ("position", "effort")]


def rod(step=0.002, actuator=MOTOR):
    return robot_from_spec(
        mujoco.MjSpec.from_string(ROD.format(step=step, actuator=actuator)), "rod"
    )


def variant(robot, joint="j", **play):
    trials = Trials(robot, 1)
    for name, value in play.items():
        trials.play(joint)[name][:] = value
    return trials


def replayed(robot, recording, trials, channels=CHANNELS):
    return Replay(robot, whole(recording), channels).predict(trials)


def pushed(seconds=1.0, step=0.002):
    """A log of efforts that hang, swing and reverse; the rod hangs still at its start."""
    time = step * np.arange(round(seconds / step))
    effort = 0.6 * np.sign(np.sin(9 * time)) * (time > 0.1)
    return Recording(
        name="log", time=time, columns={"j/position": 0 * time, "j/effort_target": effort}
    )


def two_masses(recording, passed, substeps=100):
    """Rotor and rod as two equations, in steps of twenty microseconds."""
    step = float(recording.time[1]) / substeps
    inertia = float(rod().model.dof_M0[0]) - ROTOR
    motor = link = speed = link_speed = 0.0
    shown = []
    for effort in recording.columns["j/effort_target"].tolist():
        shown.append(motor)
        for _ in range(substeps):
            through = passed(motor - link, speed - link_speed)
            speed += step * (effort - 0.05 * speed - through) / ROTOR
            link_speed += step * (through - WEIGHT * math.sin(link)) / inertia
            motor, link = motor + step * speed, link + step * link_speed
    return np.array(shown)


@functools.cache
def reduced():
    return 1 / (1 / ROTOR + 1 / (float(rod().model.dof_M0[0]) - ROTOR))


def spring(twist, rate, stiffness=40.0, ratio=0.1):
    return stiffness * twist + 2 * ratio * math.sqrt(stiffness * reduced()) * rate


def toothed(twist, rate, half, law):
    if abs(twist) <= half:
        return 0.0
    side = math.copysign(1.0, twist)
    return side * max(0.0, side * law(twist - side * half, rate))


def teeth(twist, rate):
    return spring(twist, rate, 3e4, 1.0)


@pytest.mark.parametrize(
    ("play", "law"),
    [
        ({"compliance": 1 / 40, "damping_ratio": 0.1}, spring),
        ({"width": 0.06}, lambda *at: toothed(*at, 0.03, teeth)),
        (
            {"width": 0.06, "compliance": 1 / 40, "damping_ratio": 0.1},
            lambda *at: toothed(*at, 0.03, spring),
        ),
    ],
    ids=["spring", "gap", "both"],
)
def test_moves_as_two_masses_do(play, law):
    recording = pushed()
    robot = rod(step=0.0001)
    expected = two_masses(recording, law)
    rigid = replayed(robot, recording, Trials(robot, 1))[0, :, 0]
    got = replayed(robot, recording, variant(robot, **play))[0, :, 0]
    effect = np.sqrt(np.mean((rigid - expected) ** 2))
    assert effect > 0.003
    assert np.sqrt(np.mean((got - expected) ** 2)) < 0.08 * effect


@pytest.mark.parametrize("axis", ["1 0 0", "0 0 1", "0.6 0 0.8"])
def test_a_carriage_is_moved_by_its_motor(axis):
    xml = f"""
    <mujoco><option timestep="0.001" gravity="0 0 0"/>
    <worldbody><body><joint name="j" type="slide" axis="{axis}" armature="0.3"/>
      <geom type="box" size="0.1 0.1 0.05" mass="2"/></body></worldbody>
    <actuator><motor joint="j"/></actuator></mujoco>"""
    robot = with_play(robot_from_spec(mujoco.MjSpec.from_string(xml), "carriage"), ["j"])
    motor, play = robot.joints["j"], robot.joints["j"].play
    for model in (robot.model, mujoco.MjModel.from_xml_string(robot.spec.to_xml())):
        model.jnt_stiffness[play.id] = 100.0
        data = mujoco.MjData(model)
        data.ctrl[:] = 5.0
        mujoco.mj_step(model, data, 200)
        speed = data.qvel[motor.dof]
        momentum = 0.3 * speed + 2 * (speed + data.qvel[play.dof])
        assert momentum == pytest.approx(5.0 * 0.2, rel=1e-6)
        assert abs(data.qvel[play.dof]) > 0.1


def test_a_gap_of_nothing_and_a_stiff_gear_are_no_play():
    recording, robot = pushed(), rod()
    rigid = replayed(robot, recording, Trials(robot, 1))[0, :, 0]
    for play in ({"width": 1e-6}, {"compliance": 1e-9, "damping_ratio": 0.1}):
        got = replayed(robot, recording, variant(robot, **play))[0, :, 0]
        np.testing.assert_allclose(got, rigid, atol=0.01 * np.ptp(rigid))


@pytest.mark.parametrize("angle", [-0.9, 0.7])
@pytest.mark.parametrize(
    "play", [{"width": 0.05}, {"compliance": 0.02}, {"width": 0.05, "compliance": 0.02}], ids=str
)
def test_what_is_held_still_starts_still(play, angle):
    time = 0.002 * np.arange(200)
    robot = rod(actuator=SERVO)
    trials = variant(robot, damping_ratio=0.2, **play)
    # The motor stands where the log says; the rod hangs away from it, where its weight takes it.
    bent = angle
    for _ in range(50):
        through = WEIGHT * np.sin(bent)
        gap = 0.5 * play.get("width", 0) * np.sign(through)
        bent = angle - gap - play.get("compliance", 0) * through
    target = angle + WEIGHT * np.sin(bent) / 30
    recording = Recording(
        name="log",
        time=time,
        columns={"j/position": angle + 0 * time, "j/position_target": target + 0 * time},
    )
    got = replayed(robot, recording, trials)[0]
    np.testing.assert_allclose(got[:, 0], angle, atol=1e-3)
    np.testing.assert_allclose(got[-1, 1], WEIGHT * np.sin(bent), rtol=0.02)


COUPLED = """
<mujoco><compiler angle="radian"/><option timestep="0.0001" integrator="implicitfast"/>
<worldbody><body name="rotor"><inertial pos="0 0 0" mass="1e-9" diaginertia="1e-9 1e-9 1e-9"/>
    <joint name="motor" axis="0 1 0" armature="0.004" damping="0.05"/></body>
  <body name="rod"><joint name="j" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.5"/></body></worldbody>
<tendon><fixed stiffness="80" damping="0.2" springlength="0"><joint joint="j" coef="1"/>
  <joint joint="motor" coef="-1"/></fixed></tendon></mujoco>"""


def test_a_drive_with_its_encoder_on_the_link_is_fed_back_the_link():
    time = 0.0001 * np.arange(10000)
    target = 0.3 * np.sign(np.sin(8 * time)) * (time > 0.1)
    model = mujoco.MjModel.from_xml_string(COUPLED)
    data, shown = mujoco.MjData(model), []
    for u in target:
        link = float(data.joint("j").qpos[0])
        effort = float(np.clip(4 * (u - link), -1, 1))
        shown.append((link, effort))
        data.qfrc_applied[model.joint("motor").dofadr] = effort
        mujoco.mj_step(model, data)
    expected = np.array(shown)
    recording = Recording(
        name="log", time=time, columns={"j/position": 0 * time, "j/position_target": target}
    )
    robot = rod(0.0001, '<position joint="j" kp="4" forcerange="-1 1"/>')
    ratio = 0.2 / (2 * np.sqrt(80 * reduced()))
    trials = variant(robot, compliance=1 / 80, damping_ratio=ratio)
    on_motor = replayed(robot, recording, trials)[0]
    trials.load_side["j"][:] = 1
    got = replayed(robot, recording, trials)[0]
    apart = np.sqrt(np.mean((on_motor - expected) ** 2, axis=0))
    np.testing.assert_array_less(np.sqrt(np.mean((got - expected) ** 2, axis=0)), 0.25 * apart)

    alone = mend(trials)
    np.testing.assert_array_equal(replayed(alone, recording, Trials(alone, 1))[0], got)


def test_an_encoder_on_the_link_shows_it_where_a_drive_only_pushes():
    recording, robot = pushed(), rod(step=0.0005)
    trials = variant(robot, width=0.06)
    trials.load_side["j"][:] = 1
    signals = [Channel(joint="j", signal=signal) for signal in ("position", "velocity")]
    got = replayed(robot, recording, trials, signals)[0]
    inside = got[:, 0] - replayed(robot, recording, variant(robot, width=0.06))[0, :, 0]
    assert 0.05 < np.ptp(inside) < 0.07
    # Velocities are those of the positions; both are averaged over the teeth's impacts.
    kernel = np.ones(9) / 9
    slope = np.convolve(np.gradient(got[:, 0], 0.002), kernel, "valid")
    np.testing.assert_allclose(np.convolve(got[:, 1], kernel, "valid"), slope, atol=0.2)


SEVERAL = """
<mujoco><compiler angle="degree"/><default><joint damping="0.3" frictionloss="0.1"/>
<default class="hips"><joint armature="0.02" stiffness="2" springref="20"/></default></default>
<worldbody><body name="thigh" pos="0.1 0 0"><frame euler="20 0 30" pos="0 0.02 0">
  <joint name="roll" class="hips" axis="1 0 0" ref="7" range="-40 50"/></frame>
  <joint name="pitch" axis="0 1 0" pos="0 0 0.03"/><joint name="reach" type="slide" axis="0 0 1"/>
  <geom type="capsule" fromto="0 0 0 0.05 0 -0.3" size="0.03" mass="1"/>
  <body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0"/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.5"/></body></body></worldbody>
<actuator><position name="pitch" joint="pitch" kp="9"/><motor name="roll" joint="roll"/>
  <motor name="reach" joint="reach"/><motor name="knee" joint="knee"/></actuator>
<sensor><jointpos joint="pitch"/></sensor>
<keyframe><key name="home" qpos="0.1 0.2 0.01 0.3" qvel="1 2 3 4"/></keyframe></mujoco>"""
NAMES = ("roll", "pitch", "reach", "knee")


def several():
    return robot_from_spec(mujoco.MjSpec.from_string(SEVERAL), "leg")


def test_the_link_goes_where_motor_and_play_add_up():
    before, after = several(), with_play(several(), ("roll", "pitch", "reach"))
    joints, model = after.joints, after.model
    assert tuple(joints) == (
        "roll",
        "roll_play",
        "pitch",
        "pitch_play",
        "reach",
        "reach_play",
        "knee",
    )
    data, expected = mujoco.MjData(model), mujoco.MjData(before.model)
    for k, name in enumerate(NAMES):
        at = 0.3 + 0.1 * k
        data.qpos[joints[name].qpos] = at
        expected.qpos[before.joints[name].qpos] = at
        if name != "knee":
            assert joints[name].play.name == f"{name}_play"
            data.qpos[joints[name].play.qpos] = 0.01 * (k + 1)
            expected.qpos[before.joints[name].qpos] += 0.01 * (k + 1)
    for d, m in ((data, model), (expected, before.model)):
        mujoco.mj_forward(m, d)
    np.testing.assert_allclose(data.xipos, expected.xipos, atol=1e-12)
    np.testing.assert_allclose(data.xmat, expected.xmat, atol=1e-12)


def test_everything_else_stays_with_the_motor():
    before, after = several(), with_play(several(), ("roll", "pitch", "knee"))
    for name in NAMES:
        one, other = before.model.joint(name), after.model.joint(name)
        for field in ("type", "axis", "pos", "range", "limited", "stiffness", "qposadr", "dofadr"):
            if not field.endswith("adr"):
                np.testing.assert_array_equal(getattr(one, field), getattr(other, field), field)
        dofs = before.joints[name].dof, after.joints[name].dof
        for field in ("dof_damping", "dof_frictionloss"):
            values = (
                getattr(r.model, field)[dof] for r, dof in zip((before, after), dofs, strict=True)
            )
            assert len(set(values)) == 1
        assert before.joints[name].drives == after.joints[name].drives
        assert before.model.actuator(name).trnid[0] == before.joints[name].id
        assert after.model.actuator(name).trnid[0] == after.joints[name].id
        places = before.joints[name].qpos, after.joints[name].qpos
        for field in ("qpos0", "qpos_spring"):
            a, b = (
                getattr(r.model, field)[at] for r, at in zip((before, after), places, strict=True)
            )
            assert a == b
        key = [r.model.key_qpos[0][at] for r, at in zip((before, after), places, strict=True)]
        assert key[0] == key[1]
    for name in ("roll", "pitch", "knee"):
        play = after.joints[f"{name}_play"]
        assert not after.joints[f"{name}_play"].drives
        model = after.model
        lost = model.dof_damping, model.dof_frictionloss, model.dof_armature
        assert [values[play.dof] for values in lost] == [0, 0, 0]
        assert model.jnt_stiffness[play.id] == model.key_qvel[0][play.dof] == 0
    assert after.model.sensor_objid[0] == after.joints["pitch"].id


def test_a_name_that_is_taken_is_refused():
    robot = with_play(several(), ("knee",))
    with pytest.raises(ValueError, match="there is a joint 'knee_play' already"):
        with_play(robot, ("knee",))


def test_variants_do_not_disturb_each_other():
    recording, robot = pushed(0.4), rod()
    alone = [
        variant(robot, width=0.03),
        Trials(robot, 1),
        variant(robot, compliance=0.03, damping_ratio=0.1),
        variant(robot, width=0.02, compliance=0.03, damping_ratio=0.1, armature=0.002),
    ]
    alone[3].field("dof_damping")[:, 0] += 0.1
    together = replayed(robot, recording, Trials.joined(alone))
    each = np.concatenate([replayed(robot, recording, one) for one in alone])
    np.testing.assert_array_equal(together, each)
    assert len({row.tobytes() for row in each}) == 4


@pytest.mark.parametrize(
    ("play", "load_side"),
    [({"width": 0.04}, 0), ({"compliance": 0.03}, 0), ({"compliance": 0.002}, 1)],
    ids=["gap", "spring", "encoder on the link"],
)
def test_a_walker_of_the_mended_model_moves_as_the_replay_did(play, load_side):
    time = 0.002 * np.arange(400)
    target = 0.5 * np.sign(np.sin(8 * time))
    recording = Recording(
        name="log", time=time, columns={"j/position": 0 * time, "j/position_target": target}
    )
    robot = rod(actuator=SERVO)
    trials = variant(robot, damping_ratio=0.1, **play)
    trials.load_side["j"][:] = load_side
    mended = mend(trials)
    np.testing.assert_array_equal(
        replayed(mended, recording, Trials(mended, 1)), replayed(robot, recording, trials)
    )
    # A walker has no log; its joint is the motor's.
    bare = replace(mended, measurement={})
    expected = replayed(bare, recording, Trials(bare, 1))[0, :, 0]
    walker = Mended(bare).walker(name="rod")
    task = Follow(walker, target[:, None], 0.002)
    environment = composer.Environment(task, random_state=0, legacy_step=False)
    environment.reset()
    joint = environment.physics.bind(walker.mjcf_model.find("joint", "j"))
    shown = []
    for _ in target[1:]:
        shown.append(float(joint.qpos[0]))
        environment.step(np.zeros(1))
    np.testing.assert_allclose(shown, expected[:-1], atol=1e-6)
    assert len(walker.actuators) == 1
