"""What is searched holds what an explanation leaves."""

from pathlib import Path

import mujoco
import numpy as np
import pytest

from tests.gap.servo import SERVO
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.half import Half
from walkerkit.gap.search.naming import name_effects
from walkerkit.gap.search.problem import Problem, build
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.workflow import prepare

LIMIT, JUMP = 3.0, 2.6  # N·m, s
SIGNALS = ("position", "velocity", "position_target")


def servo_of(folder: Path, text: str) -> Problem:
    """Slow waves, each with one jump of 0.4 rad, at which alone the hidden limit is met."""
    model = folder / "servo.xml"
    model.write_text(text)
    time = np.arange(0.0, 6.0, 1 / 250)
    jump = 0.4 * ((time > JUMP) & (time < JUMP + 0.3))
    targets = [(0.2 * np.sin(w * time) + jump)[:, None] for w in (1.0, 1.3, 1.7)]
    hidden = HiddenEffect(effect="effort_limit", joints=("knee",), values={"forcerange": LIMIT})
    logs = run_hardware(model, targets, rate=250.0, hidden=[hidden], seed=0)
    return prepare(load_experiments(model, logs), window=0.5, n_threads=1).problem("zero_order")


@pytest.fixture(scope="module")
def servo(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """One of which a timestep of 2 ms tells as much as its own."""
    return servo_of(tmp_path_factory.mktemp("servo"), SERVO.replace("0.002", "0.001"))


def timesteps(half: Half) -> set[float]:
    return {float(replay.robot.model.opt.timestep) for replay in half.objective.replays}


def looks_at_the_jump(problem: Problem) -> bool:
    return any(
        segment.start <= JUMP < segment.start + segment.duration
        for replay in problem.screen.objective.replays
        for segment in replay.segments
    )


def test_it_holds_what_is_rare(servo: Problem) -> None:
    assert not looks_at_the_jump(servo)
    (nothing,) = evaluate(servo.fit.objective, [(servo.nothing, np.zeros(0))])
    servo.searched.look_at(nothing.case)
    rare = servo.screen
    assert looks_at_the_jump(servo)
    servo.searched.look_at(nothing.case)
    assert servo.screen is rare


def test_what_is_rare_is_named(servo: Problem) -> None:
    effects = [CATALOGUE[name] for name in ("viscous_friction", "effort_limit", "slew_limit")]
    final = name_effects(servo, effects).fit
    assert [term.effect.name for term in final.structure.terms] == ["effort_limit"]
    assert final.values[0] == pytest.approx(LIMIT, rel=0.02)


def test_parts_take_longer_steps_where_these_tell_as_much(servo: Problem, tmp_path: Path) -> None:
    (nothing,) = evaluate(servo.fit.objective, [(servo.nothing, np.zeros(0))])
    servo.searched.look_at(nothing.case)
    assert timesteps(servo.screen) == {0.002}
    # It has no dry friction, but logs efforts.
    assert set(servo.screen.finer) == {"half", "integrator", "reading", "earlier", "quarter"}
    finer = [servo.screen.finer["half"], servo.screen.finer["quarter"]]
    assert [float(one.replays[0].robot.model.opt.timestep) for one in finer] == [
        pytest.approx(step) for step in (0.001, 0.0005)
    ]
    assert timesteps(servo.fit) == timesteps(servo.held) == {0.001}

    # A drive that shakes within a few milliseconds.
    stiff = SERVO.replace("0.002", "0.001").replace('kp="30" kv="1"', 'kp="2000" kv="2"')
    fast = servo_of(tmp_path, stiff)
    (nothing,) = evaluate(fast.fit.objective, [(fast.nothing, np.zeros(0))])
    fast.searched.look_at(nothing.case)
    assert timesteps(fast.screen) == {0.001}


def test_parts_never_take_longer_steps_than_mujoco_itself(tmp_path: Path) -> None:
    longer = servo_of(tmp_path, SERVO)
    (nothing,) = evaluate(longer.fit.objective, [(longer.nothing, np.zeros(0))])
    longer.searched.look_at(nothing.case)
    assert timesteps(longer.screen) == {0.002}


def test_what_is_no_longer_is_searched_whole(servo: Problem) -> None:
    assert servo.excerpt is servo.fit
    assert servo.screen is not servo.fit


@pytest.mark.parametrize(
    ("joints", "rate", "apart"),
    [(2, 500.0, 0.002), (40, 500.0, 0.006), (40, 125.0, 0.008), (80, 500.0, 0.01)],
)
def test_of_many_channels_fewer_samples_are_looked_at(
    joints: int, rate: float, apart: float
) -> None:
    names = [f"joint_{k}" for k in range(joints)]
    bodies = "".join(
        f'<body pos="{k} 0 0"><joint name="{name}" axis="0 1 0"/>'
        '<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".03" mass="1" contype="0"/></body>'
        for k, name in enumerate(names)
    )
    servos = "".join(f'<position name="{name}" joint="{name}" kp="20"/>' for name in names)
    robot = robot_from_spec(
        mujoco.MjSpec.from_string(
            f"<mujoco><worldbody>{bodies}</worldbody><actuator>{servos}</actuator></mujoco>"
        ),
        "many.xml",
    )
    time = np.arange(round(30 * rate)) / rate
    wave = 0.3 * np.sin(3 * time)
    columns = {f"{name}/{signal}": wave for name in names for signal in SIGNALS}
    logs = [Recording(name=name, time=time, columns=columns) for name in ("a", "b")]
    problem = build([robot], [logs[:1]], [logs[1:]], window=None, hold="zero_order", n_threads=1)
    spacing = []
    for half in (problem.screen, problem.fit):
        for objective in (half.objective, half.finer["half"]):
            (replay,) = objective.replays
            spacing.append(float(np.median(np.diff(replay.time_of_row))))
    assert spacing == pytest.approx([apart, apart, 1 / rate, 1 / rate])
