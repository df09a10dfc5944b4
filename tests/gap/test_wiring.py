"""Signs that are flipped and joints that are swapped are named as such; effects never are."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from walkerkit.gap import compare
from walkerkit.gap.experiments.experiment import Experiment
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.wiring_errors import Kind, WiringError, exchanged, named_errors
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.wiring import rewired_experiments

# Two legs that are alike, as a biped's are.
LEG = """
<body name="{0}" pos="0 {1} 0">
  <joint name="{0}_hip" axis="0 1 0" armature="0.01" damping="0.1"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.8" contype="0"/>
  <body pos="0 0 -0.2">
    <joint name="{0}_knee" axis="0 1 0" armature="0.01" damping="0.1" range="-2.5 0.2"/>
    <geom type="capsule" fromto="0 0 0 0.02 0 -0.2" size="0.02" mass="0.4" contype="0"/>
  </body>
</body>
"""
SERVO = '<position joint="{0}_hip" kp="40" kv="1"/><position joint="{0}_knee" kp="30" kv="0.8"/>'
MODEL = f"""
<mujoco model="biped">
  <compiler angle="radian" autolimits="true"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>{LEG.format("left", 0.1)}{LEG.format("right", -0.1)}</worldbody>
  <actuator>{SERVO.format("left")}{SERVO.format("right")}</actuator>
</mujoco>
"""
MOTOR = """
<mujoco model="motor">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body>
    <joint name="shaft" axis="0 1 0" armature="0.01" damping="0.05"/>
    <geom type="capsule" fromto="0 0 0 0.1 0 -0.2" size="0.02" mass="0.4"/>
  </body></worldbody>
  <actuator><motor joint="shaft"/></actuator>
</mujoco>
"""
JOINTS = ("left_hip", "left_knee", "right_hip", "right_knee")
Change = Callable[[mujoco.MjSpec], object]


def simulated(
    path: Path, change: Change | None = None, *, seed: int = 0, alike: bool = False
) -> Recording:
    """Two seconds and a half of the model, or of one that somebody has changed."""
    spec = mujoco.MjSpec.from_file(str(path))
    if change is not None:
        change(spec)
    model = spec.compile()
    data = mujoco.MjData(model)
    names = [model.joint(j).name for j in range(model.njnt)]
    motor = model.nu == 1
    rng = np.random.default_rng(seed)
    time = np.arange(1250) * model.opt.timestep
    rate, phase = rng.uniform(3, 9, model.nu), rng.uniform(0, 6, model.nu)
    if alike:
        rate[2:], phase[2:] = rate[:2], phase[:2]
    targets = 0.4 * np.sin(rate * time[:, None] + phase * (time[:, None] > 0.2))
    if not motor:
        targets[:, 1::2] -= 1.0
        data.qpos[:] = targets[0]
    rows = []
    for target in targets:
        data.ctrl[:] = target
        mujoco.mj_step1(model, data)
        state = np.concatenate([data.qpos, data.qvel])
        mujoco.mj_step2(model, data)
        rows.append(np.concatenate([state, data.qfrc_actuator, target]))
    log = np.array(rows) + 1e-4 * rng.standard_normal((len(rows), 4 * model.nv))
    signals = ("position", "velocity", "effort", "effort_target" if motor else "position_target")
    columns = [f"{name}/{signal}" for signal in signals for name in names]
    return Recording(name=f"log{seed}", time=time, columns=dict(zip(columns, log.T, strict=True)))


@pytest.fixture(scope="module")
def biped(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("wiring") / "biped.xml"
    path.write_text(MODEL)
    return path


@pytest.fixture(scope="module")
def walk(biped: Path) -> Recording:
    return simulated(biped, lambda spec: set_all(spec, "frictionloss", 0.1))


def set_all(spec: mujoco.MjSpec, name: str, value: object) -> None:
    for joint in spec.joints:
        setattr(joint, name, value)


def found(path: Path, *recordings: Recording, window: float | None = None) -> list[WiringError]:
    experiment = Experiment(model=str(path), recordings=recordings)
    (mended,) = rewired_experiments([load_robot(path)], [experiment], window=window, n_threads=1)
    return [*named_errors(mended.recordings)]


def without(recording: Recording, *signals: str) -> Recording:
    kept = {n: v for n, v in recording.columns.items() if n.rpartition("/")[2] not in signals}
    return replace(recording, columns=kept)


FLIPS = [
    ("position", "velocity"),
    ("position", "velocity", "effort"),
    ("position_target",),
    ("effort",),
    ("velocity",),
    ("position", "velocity", "position_target", "effort"),
]


@pytest.mark.parametrize("signals", FLIPS, ids="+".join)
def test_a_flipped_sign_is_named(biped: Path, walk: Recording, signals: Sequence[str]) -> None:
    joint = JOINTS[len("+".join(signals)) % 4]
    columns = tuple(f"{joint}/{signal}" for signal in signals)
    (error,) = found(biped, exchanged(walk, "sign_flip", columns))
    assert (error.kind, error.joints) == ("sign_flip", (joint,))
    assert set(error.columns) == set(columns)
    assert error.gap_after < 0.3 * error.gap_before


def test_an_effort_that_no_sign_explains_chooses_none(biped: Path, walk: Recording) -> None:
    """As a current that was filtered beyond recognition; what is nearer is nearer by chance."""
    effort = walk.columns["left_knee/effort"]
    noise = np.random.default_rng(0).standard_normal(len(effort))
    unlike = 0.4 * np.std(effort) * noise - 0.2 * effort
    log = replace(walk, columns={**walk.columns, "left_knee/effort": unlike})
    flipped = ("left_knee/position", "left_knee/velocity")
    (error,) = found(biped, exchanged(log, "sign_flip", flipped))
    assert error.columns == flipped


@pytest.mark.parametrize("signals", [s for s in FLIPS if s != ("velocity",)], ids="+".join)
def test_swapped_joints_are_named(biped: Path, walk: Recording, signals: Sequence[str]) -> None:
    # Of legs that are alike, either name is right where all columns are exchanged.
    pair = ("left_knee", "right_knee") if len(signals) < 4 else ("left_hip", "left_knee")
    columns = tuple(f"{joint}/{signal}" for signal in signals for joint in pair)
    (error,) = found(biped, exchanged(walk, "joint_swap", columns))
    assert (error.kind, set(error.joints)) == ("joint_swap", set(pair))
    assert set(error.columns) == set(columns)


def test_two_errors_are_both_named(biped: Path, walk: Recording) -> None:
    log = exchanged(walk, "sign_flip", ["left_hip/position_target"])
    log = exchanged(log, "joint_swap", ["left_knee/effort", "right_knee/effort"])
    assert {error.kind for error in found(biped, log)} == {"sign_flip", "joint_swap"}


@pytest.mark.parametrize("column", ["shaft/effort_target", "shaft/position"])
def test_a_motor_that_turns_the_other_way_is_named(tmp_path: Path, column: str) -> None:
    path = tmp_path / "motor.xml"
    path.write_text(MOTOR)
    log = without(simulated(path), "velocity", "effort")
    assert found(path, log, window=0.5) == []
    (error,) = found(path, exchanged(log, "sign_flip", [column]), window=0.5)
    assert error.kind == "sign_flip"
    assert column in (*error.columns, *error.or_else)


def all_gains(spec: mujoco.MjSpec, factor: float) -> None:
    for actuator in spec.actuators:
        actuator.gainprm[0] *= factor
        actuator.biasprm[1] *= factor


def heavier(spec: mujoco.MjSpec) -> None:
    spec.geoms[1].mass = 3.0


CHANGES: dict[str, Change] = {
    "nothing": lambda spec: None,
    "dry friction": lambda spec: set_all(spec, "frictionloss", 1.5),
    "viscous friction": lambda spec: set_all(spec, "damping", [4.0, 0, 0]),
    "a stuck joint": lambda spec: setattr(spec.joints[1], "frictionloss", 50.0),
    "armature": lambda spec: set_all(spec, "armature", 0.2),
    "weak gains": lambda spec: all_gains(spec, 0.3),
    "a payload": heavier,
    "zero gravity": lambda spec: setattr(spec.option, "gravity", [0, 0, 0]),
    "gravity upwards": lambda spec: setattr(spec.option, "gravity", [0, 0, 9.81]),
    "springs": lambda spec: set_all(spec, "stiffness", [20.0, 0, 0]),
    "encoder offset": lambda spec: setattr(spec.joints[0], "ref", 0.4),
}


@pytest.mark.parametrize("name", CHANGES)
def test_no_effect_is_taken_for_an_error(biped: Path, name: str) -> None:
    log = simulated(biped, CHANGES[name], alike=len(name) % 2 == 0, seed=3)
    assert found(biped, log) == []
    assert found(biped, without(log, "effort", "velocity")) == []


def test_only_the_recordings_that_have_it_are_mended(biped: Path, walk: Recording) -> None:
    other = simulated(biped, seed=1)
    (error,) = found(biped, walk, exchanged(other, "sign_flip", ["left_hip/position_target"]))
    assert error.recordings == ("log1",)


def test_the_diagnosis_goes_on_with_the_log_as_corrected(biped: Path, walk: Recording) -> None:
    straight, flipped = (
        compare(biped, [log], n_threads=1)
        for log in (walk, exchanged(walk, "sign_flip", ["left_hip/position_target"]))
    )
    assert straight.wiring == ()
    assert "wiring" not in straight.to_dict()
    assert flipped.gap == straight.gap
    (error,) = flipped.to_dict()["wiring"]
    assert error["kind"] == "sign_flip"
    assert error["joints"] == ["left_hip"]
    assert error["columns"] == ["left_hip/position_target"]
    assert error["gap_before"] > 10 * error["gap_after"]
    assert flipped.notes[0].startswith(
        "The sign of left_hip is flipped: left_hip/position_target. With them negated"
    )
    assert "the mended model too, is for the log as corrected" in flipped.notes[0]
    assert flipped.notes[1:] == straight.notes


def test_the_report_and_the_terminal_begin_with_it(
    biped: Path, walk: Recording, tmp_path: Path
) -> None:
    from walkerkit.gap.report.console import as_text
    from walkerkit.gap.report.page import write_report

    columns = [f"{j}/{s}" for s in ("position", "velocity") for j in JOINTS[:2]]
    diagnosis = compare(biped, [exchanged(walk, "joint_swap", columns)], n_threads=1)
    assert as_text(diagnosis).startswith("Wiring: Joints left_hip and left_knee are swapped")
    write_report(diagnosis, tmp_path / "report.html", title="biped")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.index('<p class="wiring"') < page.index('<section class="verdict"')


@pytest.mark.parametrize(
    ("model", "log", "column", "window"),
    [
        ("xl330/kp400.xml", "xl330/kp400_sin_sin.csv", "servo/position_target", None),
        ("emps/emps.xml", "emps/pulses.csv", "carriage/position", 0.5),
        (
            "double_pendulum/double_pendulum.xml",
            "double_pendulum/20230629-143524.csv",
            "shoulder/effort_target",
            0.5,
        ),
    ],
)
def test_logs_of_real_hardware(
    real_logs: Path, model: str, log: str, column: str, window: float | None
) -> None:
    recording = Recording.load(real_logs / log)
    assert found(real_logs / model, recording, window=window) == []
    flipped = exchanged(recording, "sign_flip", [column])
    (error,) = found(real_logs / model, flipped, window=window)
    assert error.kind == "sign_flip"
    assert column in (*error.columns, *error.or_else)


def test_the_worst_half_second_of_a_chaotic_robot_is_no_swap(
    real_logs: Path, tmp_path: Path
) -> None:
    """Exchanging the joints of a double pendulum comes near some half second by chance."""
    logs = real_logs / "double_pendulum"
    spec = mujoco.MjSpec.from_file(str(logs / "double_pendulum.xml"))
    for name, frictionloss, armature in (("shoulder", 0.25, 0.0055), ("elbow", 0.19, 0.004)):
        spec.joint(name).frictionloss, spec.joint(name).armature = frictionloss, armature
    spec.body("lower").mass *= 0.6
    model = tmp_path / "light.xml"
    model.write_text(spec.to_xml())
    recordings = [Recording.load(path) for path in sorted(logs.glob("*.csv"))]
    assert found(model, *recordings, window=0.5) == []


@pytest.mark.parametrize("gain", [100, 200])
def test_a_servo_far_from_its_simulation_turns_the_other_way(real_logs: Path, gain: int) -> None:
    """What its model lacks, and not the sign, is most of the gap of a servo of little gain."""
    model = real_logs / f"xl330/kp{gain}.xml"
    recordings = [
        Recording.load(real_logs / f"xl330/kp{gain}_{name}.csv")
        for name in ("sin_time_square", "up_and_down", "lift_and_drop")
    ]
    assert found(model, *recordings) == []
    columns = ["servo/position", "servo/velocity"]
    (error,) = found(model, *(exchanged(r, "sign_flip", columns) for r in recordings))
    assert (error.kind, list(error.columns)) == ("sign_flip", columns)
    assert error.recordings == tuple(recording.name for recording in recordings)


@pytest.mark.parametrize("kind", ["sign_flip", "joint_swap"])
def test_an_exchange_twice_is_none(walk: Recording, kind: Kind) -> None:
    columns = ["left_hip/effort", "right_hip/effort"]
    once = exchanged(walk, kind, columns)
    assert not np.array_equal(once.columns[columns[0]], walk.columns[columns[0]])
    twice = exchanged(once, kind, columns)
    for name in walk.columns:
        np.testing.assert_array_equal(twice.columns[name], walk.columns[name])
