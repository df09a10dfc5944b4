"""Waves over the positions, found in what the model does not explain of a simulated robot."""

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.waves import nominal_effort, waves

STEP = 0.002
ARM = """
<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body><joint name="j" axis="0 1 0" damping="0.1" armature="0.01"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/></body></worldbody>
<actuator>{actuator}</actuator></mujoco>
"""
SERVO = '<position name="j" joint="j" kp="40" kv="1.5" forcerange="-8 8"/>'


def arm(actuator=SERVO):
    return robot_from_spec(mujoco.MjSpec.from_string(ARM.format(actuator=actuator)), "arm.xml")


def log(hidden, signals=("position", "effort"), seconds=6.0, heavier=0.0, seed=3):
    """An arm that swings about, with a hidden effort of (q, q̇, τ) and maybe a heavier link."""
    model = arm().model
    model.body_mass[1] += heavier
    data = mujoco.MjData(model)
    model.dof_solref[0], model.dof_solimp[0] = (2 * STEP, 1), (0.99, 0.99, 0.001, 0.5, 2)
    time = STEP * np.arange(round(seconds / STEP))
    targets = 0.8 * np.sin(1.7 * time) + 0.3 * np.sin(5.3 * time)
    rows = []
    for target in targets:
        data.ctrl[0] = target
        q, qd = float(data.qpos[0]), float(data.qvel[0])
        effort = float(np.clip(40 * (target - q) - 1.5 * qd, -8, 8))
        data.qfrc_applied[0], model.dof_frictionloss[0] = hidden(q, qd, effort)
        mujoco.mj_step(model, data)
        rows.append((q, effort))
    rng = np.random.default_rng(seed)
    position, effort = (np.array(rows) + rng.normal(size=(len(rows), 2)) * (1e-4, 0.01)).T
    columns = {"j/position": position, "j/effort": effort}
    columns = {name: values for name, values in columns.items() if name[2:] in signals}
    return Recording(name="log", time=time, columns=columns | {"j/position_target": targets})


def found(form, recordings, robot=None):
    (first, *_) = [w for w in waves(robot or arm(), recordings, ["j"])["j"] if w.form == form]
    return first


def apart(phase, other):
    return abs(math.remainder(phase - other, 2 * math.pi))


HIDDEN = {
    "pose": lambda n: lambda q, qd, tau: (0.3 * math.sin(n * q + 0.6), 0.0),
    "friction": lambda n: lambda q, qd, tau: (0.0, 0.5 + 0.3 * math.sin(n * q + 0.6)),
    "effort": lambda n: lambda q, qd, tau: (0.2 * tau * math.sin(n * q + 0.6), 0.0),
}


@pytest.mark.parametrize("signals", [("position", "effort"), ("position",)], ids=["effort", "q"])
@pytest.mark.parametrize("periods", [9.0, 37.0])
@pytest.mark.parametrize("form", HIDDEN)
def test_the_planted_wave_is_the_most_prominent(form, periods, signals):
    recording = log(HIDDEN[form](periods), signals)
    wave = found(form, [recording])
    reach = np.ptp(recording.columns["j/position"])
    # A fit finds the rest of the way from within a quarter of a period over the range.
    assert abs(wave.periods - periods) * reach < 0.25 * 2 * math.pi
    middle = 0.5 * (recording.columns["j/position"].max() + recording.columns["j/position"].min())
    assert apart(wave.periods * middle + wave.phase, periods * middle + 0.6) < 0.3
    assert wave.amplitude == pytest.approx(0.2 if form == "effort" else 0.3, rel=0.25)
    if form == "friction":
        assert wave.mean == pytest.approx(0.5, rel=0.1)


def test_it_is_found_beside_a_payload_and_other_friction():
    def hidden(q, qd, tau):
        return 0.1 * math.sin(25 * q - 2) - 0.2 * qd, 0.4

    recording = log(hidden, heavier=0.4)
    assert found("pose", [recording]).periods == pytest.approx(25, abs=0.5)


def test_recordings_are_put_together_and_thinned_out():
    recordings = [log(HIDDEN["pose"](14.0), seconds=20.0, seed=k) for k in (1, 2)]
    assert sum(len(r.time) for r in recordings) > 2 * 8000
    assert found("pose", recordings).periods == pytest.approx(14.0, abs=0.1)


def test_each_form_has_several_waves_in_the_order_of_their_prominence():
    def hidden(q, qd, tau):
        return 0.3 * math.sin(9 * q) + 0.2 * math.sin(21 * q), 0.0

    first, second = (w for w in waves(arm(), [log(hidden)], ["j"])["j"] if w.form == "pose")
    assert first.periods == pytest.approx(9, abs=0.6)
    assert second.periods == pytest.approx(21, abs=0.6)


WRONG = {
    "servo, effort": (SERVO, ("position", "effort")),
    "servo": (SERVO, ("position",)),
    "motor": ('<motor joint="j"/>', ("position", "effort")),
}


@pytest.mark.parametrize("drive", WRONG)
@pytest.mark.parametrize("periods", [7.0, 15.0, 37.0])
def test_a_wave_of_the_log_alone_is_found(drive, periods):
    actuator, signals = WRONG[drive]
    recording = log(lambda q, qd, tau: (0.0, 0.0), signals)
    columns = dict(recording.columns)
    q = columns["j/position"]
    columns["j/position"] = q + 0.004 * np.sin(periods * q + 0.6)
    if "motor" in actuator:
        columns["j/effort_target"] = columns["j/effort"]
        del columns["j/position_target"]
    wrong = Recording(name="log", time=recording.time, columns=columns)
    wave = found("position", [wrong], arm(actuator))
    assert abs(wave.periods - periods) * np.ptp(q) < 0.25 * 2 * math.pi
    middle = 0.5 * (q.max() + q.min())
    assert apart(wave.periods * middle + wave.phase, periods * middle + 0.6) < 0.3
    # Smoothing takes some of what changes fast.
    assert wave.amplitude == pytest.approx(0.004, rel=0.4)


def test_a_joint_that_hardly_moves_shows_none():
    time = STEP * np.arange(500)
    still = {"j/position": np.zeros(500), "j/position_target": np.zeros(500)}
    assert waves(arm(), [Recording(name="log", time=time, columns=still)], ["j"]) == {"j": ()}


def test_an_effort_of_next_to_nothing_has_no_waves():
    recording = log(HIDDEN["pose"](9.0))
    columns = recording.columns | {"j/effort": 1e-300 * np.arange(3000)}
    tiny = replace(recording, columns=columns)
    assert "effort" not in {wave.form for wave in waves(arm(), [tiny], ["j"])["j"]}


@pytest.mark.parametrize("signals", [("position", "effort"), ("position",)], ids=["effort", "q"])
def test_a_joint_without_an_actuator_shows_what_its_bearing_does(signals):
    columns = log(lambda q, qd, tau: (tau, 0.0), signals).columns
    columns = {name.replace("j/position_t", "k/position_t"): c for name, c in columns.items()}
    columns["k/position"] = columns["j/position"]
    recording = Recording(name="log", time=STEP * np.arange(3000), columns=columns)
    passive = replace(arm(""), source="passive")
    forms = {wave.form for wave in waves(passive, [recording], ["j"])["j"]}
    assert forms >= {"pose", "friction"}
    assert ("effort" in forms) == ("effort" in signals)


@pytest.mark.parametrize(
    ("actuator", "kind", "expected"),
    [
        (SERVO, "position", lambda u, q, qd: np.clip(40 * (u - q) - 1.5 * qd, -8, 8)),
        (
            '<velocity name="j" joint="j" gear="-2" kv="0.5"/>',
            "velocity",
            lambda u, q, qd: 2 * (u - qd),
        ),
        ('<motor name="j" joint="j" gear="5"/>', "effort", lambda u, q, qd: u),
    ],
)
def test_nominal_effort_is_that_of_the_model_s_drive(actuator, kind, expected):
    rng = np.random.default_rng(4)
    time = STEP * np.arange(50)
    u, q, qd = rng.uniform(-1, 1, (3, 50))
    robot = arm(actuator)
    recording = Recording(name="l", time=time, columns={"j/position": q, f"j/{kind}_target": u})
    effort = nominal_effort(robot, recording, "j", q, qd)
    np.testing.assert_allclose(effort, expected(u, q, qd), atol=1e-12)
    data, drive = mujoco.MjData(robot.model), robot.joints["j"].drives[0]
    for k in range(5):
        data.qpos[0], data.qvel[0] = q[k], qd[k]
        data.ctrl[0] = drive.control(float(u[k]))
        mujoco.mj_forward(robot.model, data)
        assert effort[k] == pytest.approx(data.qfrc_actuator[0], abs=1e-9)


def test_feed_forward_effort_is_part_of_the_nominal_effort():
    time, q = STEP * np.arange(9), np.full(9, 0.1)
    columns = {"j/position": q, "j/position_target": q + 0.1, "j/effort_target": np.full(9, 2.0)}
    recording = Recording(name="log", time=time, columns=columns)
    np.testing.assert_allclose(nominal_effort(arm(), recording, "j", q, 0 * q), 6.0)
    columns = {"j/position": q, "k/position": q, "k/position_target": q}
    without = Recording(name="log", time=time, columns=columns)
    assert nominal_effort(arm(), without, "j", q, 0 * q) is None
