"""The next experiment parts the members of a confusion set, and is safe."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.report import planner
from walkerkit.gap.report.planner import next_experiment
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.structure import Fit, Structure, Term
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.workflow import prepare
from walkerkit.tasks.excitation import BATTERY

Array = NDArray[np.float64]
EFFORT = Channel(joint="knee", signal="effort")

SERVO = """
<mujoco model="servo">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="knee" axis="0 1 0" armature="0.005" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6"/>
    </body>
  </worldbody>
  <actuator><position joint="knee" kp="30" kv="1"/></actuator>
</mujoco>
"""


@pytest.fixture(scope="module")
def servo(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    folder = tmp_path_factory.mktemp("servo")
    (folder / "servo.xml").write_text(SERVO)
    time = np.arange(0.0, 2.0, 0.004)
    # They begin at rest.
    targets = [0.25 * (1 - np.cos(5 * time))[:, None], 0.15 * (1 - np.cos(7 * time))[:, None]]
    damped = HiddenEffect(effect="viscous_friction", joints=("knee",), values={"damping": 0.2})
    recordings = run_hardware(folder / "servo.xml", targets, rate=250.0, seed=1, hidden=[damped])
    return problem(folder / "servo.xml", recordings)


def problem(model: Path, recordings: list[Recording]) -> Problem:
    experiments = load_experiments(model, recordings)
    return prepare(experiments, window=0.5, n_threads=1).problem("zero_order")


def member(problem: Problem, effect: str, *values: float) -> Fit:
    structure = Structure((Term(effect=CATALOGUE[effect], sites=("knee",)),), problem.robots)
    return Fit(structure=structure, values=np.array(values), score=0.0, mean_square=np.zeros(2))


def test_it_names_the_excitation_the_effects_and_the_file(servo: Problem) -> None:
    members = [member(servo, "viscous_friction", 0.2), member(servo, "coulomb_friction", 0.2)]
    planned = next_experiment(servo, members)
    assert planned is not None
    experiment, log = planned.experiment, planned.targets
    assert experiment.excitation in BATTERY
    assert experiment.between == ("viscous_friction", "coulomb_friction")
    assert experiment.separation > 10
    assert experiment.file == "next_experiment.csv"
    # What the robot as it is tells well enough needs no more trouble.
    assert (experiment.set_up, experiment.instruction, experiment.model) == ("as_it_is", "", None)
    assert planned.robot is None
    assert log.joints == ("knee",)
    assert log.duration == pytest.approx(10.0, abs=0.01)
    assert log.rate == pytest.approx(250.0)


def test_it_stays_within_what_the_recordings_have_reached(servo: Problem) -> None:
    members = [member(servo, "viscous_friction", 0.2), member(servo, "armature", 0.01)]
    planned = next_experiment(servo, members)
    assert planned is not None
    target = planned.targets.columns["knee/position_target"]
    reached = servo.robots[0].excursion("knee")
    assert reached.lower - 1e-9 <= target.min() < target.max() <= reached.upper + 1e-9
    speed = np.abs(np.diff(target)) * planned.targets.rate
    if planned.experiment.excitation != "steps":
        assert speed.max() <= 1.01 * reached.velocity


def test_the_same_set_gives_the_same_experiment(servo: Problem) -> None:
    members = [member(servo, "viscous_friction", 0.2), member(servo, "armature", 0.01)]
    one, other = next_experiment(servo, members), next_experiment(servo, members)
    assert one is not None
    assert other is not None
    assert one.experiment == other.experiment
    for name, column in one.targets.columns.items():
        np.testing.assert_array_equal(column, other.targets.columns[name])


def waving(frequency: float, reach: float = 1.0) -> Callable[..., Array]:
    def excite(time: Array, *, lower: Array, upper: Array, **limits: Any) -> Array:
        wave: Array = 0.5 * (1 + reach * np.sin(2 * np.pi * frequency * time))[:, None]
        return lower + (upper - lower) * wave

    return excite


def test_the_excitation_that_parts_them_best_is_chosen(
    servo: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    battery = {"rest": waving(0.0), "slow": waving(0.2), "fast": waving(0.8)}
    # Damping shows at speed.
    for names in (("rest", "slow", "fast"), ("fast", "slow", "rest"), ("rest", "slow")):
        monkeypatch.setattr(planner, "BATTERY", {name: battery[name] for name in names})
        members = [member(servo, "viscous_friction", 0.2), member(servo, "viscous_friction", 0.05)]
        planned = next_experiment(servo, members)
        assert planned is not None
        assert planned.experiment.excitation == ("fast" if "fast" in names else "slow")
        assert planned.experiment.between == ("viscous_friction",)


def test_what_asks_for_too_much_effort_is_made_smaller_or_left_out(
    servo: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    members = [member(servo, "viscous_friction", 0.2), member(servo, "viscous_friction", 0.0)]
    peak = servo.robots[0].excursion("knee").effort
    monkeypatch.setattr(planner, "BATTERY", {"wild": waving(1.2)})
    planned = next_experiment(servo, members)
    assert planned is not None
    assert planned.experiment.excitation == "wild"
    target = planned.targets.columns["knee/position_target"]
    reached = servo.robots[0].excursion("knee")
    assert np.ptp(target) < 0.7 * reached.range
    bench = planner._Bench(servo, members)
    (as_it_is, *_) = planner.set_ups(
        bench.robot, ["knee"], concerned=["knee"], efforts=True, excitations=["wild"]
    )
    efforts = bench.predict([planned.targets], [as_it_is])[0][..., bench.channels.index(EFFORT)]
    assert np.abs(efforts).max() < 1.25 * peak
    # At any size too much for the drive: something else is done with the robot.
    monkeypatch.setattr(planner, "BATTERY", {"wild": waving(8.0)})
    planned = next_experiment(servo, members)
    assert planned is not None
    assert planned.experiment.excitation != "wild"


def test_the_nearest_two_decide(servo: Problem) -> None:
    far = [member(servo, "viscous_friction", 0.2), member(servo, "coulomb_friction", 0.2)]
    near = [*far, member(servo, "viscous_friction", 0.15)]
    two, three = next_experiment(servo, far), next_experiment(servo, near)
    assert two is not None
    assert three is not None
    assert three.experiment.separation < 0.5 * two.experiment.separation


def test_there_is_none_where_nothing_parts_them(servo: Problem) -> None:
    same = [member(servo, "viscous_friction", 0.2), member(servo, "viscous_friction", 0.2)]
    assert next_experiment(servo, same) is None
    assert next_experiment(servo, same[:1]) is None
    assert next_experiment(servo, []) is None


def test_a_member_that_diverges_parts_nothing(servo: Problem) -> None:
    members = [member(servo, "viscous_friction", 0.2), member(servo, "armature", -0.03)]
    planned = next_experiment(servo, members)
    assert planned is None or np.isfinite(planned.experiment.separation)


DRIVE = '<position joint="knee" kp="30" kv="1"/>'


def driven(folder: Path, kind: str, *, lift: bool = False) -> Problem:
    """An arm whose motor takes `kind` targets; its joint is damped by 0.05 more than modelled.

    With `lift` the joint slides up and down.
    """
    text = SERVO.replace(DRIVE, f"<{kind}/>")
    if lift:
        text = text.replace('axis="0 1 0"', 'type="slide" axis="0 0 1"')
    (folder / "arm.xml").write_text(text)
    model = mujoco.MjModel.from_xml_string(text)
    model.dof_damping[:] += 0.05
    data = mujoco.MjData(model)
    rng = np.random.default_rng(0)
    rows = []
    for _ in range(1000):
        data.ctrl[:] = 0.5 * np.sin(5 * data.time) + lift * 9.81 * model.body_mass.sum()
        position = data.qpos[0] + 1e-4 * rng.standard_normal()
        effort = data.ctrl[0] + 1e-2 * rng.standard_normal()
        rows.append((data.time, position, effort, data.ctrl[0]))
        mujoco.mj_step(model, data)
    time, position, effort, sent = np.array(rows).T
    target = "velocity_target" if kind.startswith("velocity") else "effort_target"
    columns = {"knee/position": position, "knee/effort": effort, f"knee/{target}": sent}
    log = Recording(name="log", time=time, columns=columns)
    return problem(folder / "arm.xml", [log])


def test_what_would_fall_is_not_let_go(tmp_path: Path) -> None:
    motor = driven(tmp_path, 'motor joint="knee"', lift=True)
    members = [member(motor, "viscous_friction", 0.05), member(motor, "coulomb_friction", 0.05)]
    planned = next_experiment(motor, members)
    assert planned is None or planned.experiment.set_up != "motor_off"


@pytest.mark.parametrize(
    ("lift", "limited", "beyond", "safe"),
    [
        (False, False, 0.2, True),
        (False, False, 0.3, False),
        (True, False, 0.0, True),
        (True, False, 0.01, False),
        (True, True, 0.2, True),
        (True, True, 0.24, False),
    ],
)
def test_a_slide_goes_beyond_where_it_has_been_only_within_its_range(
    tmp_path: Path, lift: bool, limited: bool, beyond: float, safe: bool
) -> None:
    moved = driven(tmp_path, 'velocity joint="knee" kv="1"', lift=lift)
    bench = planner._Bench(moved, [member(moved, "viscous_friction", 0.1)] * 2)
    (as_it_is, *_) = planner.set_ups(
        bench.robot, ["knee"], concerned=["knee"], efforts=True, excitations=["steps"]
    )
    reached = bench.robot.excursion("knee")
    bench.robot.model.jnt_limited[:] = limited
    bench.robot.model.jnt_range[:] = reached.lower, reached.upper + 0.22 * reached.range
    position = bench.channels.index(Channel(joint="knee", signal="position"))
    predicted = np.zeros((2, 5, len(bench.channels)))
    predicted[..., position] = reached.upper + beyond * reached.range
    assert bench.is_safe(predicted, as_it_is) is safe


def test_a_motor_that_takes_effort_is_switched_off_to_tell_its_joint_s_frictions(
    tmp_path: Path,
) -> None:
    motor = driven(tmp_path, 'motor joint="knee"')
    members = [member(motor, "viscous_friction", 0.05), member(motor, "coulomb_friction", 0.05)]
    planned = next_experiment(motor, members)
    assert planned is not None
    experiment, columns = planned.experiment, planned.targets.columns
    assert (experiment.excitation, experiment.set_up) == ("release", "motor_off")
    assert experiment.instruction == (
        "Switch the motor of knee off. Hold the joint at the first position, start the log, and "
        "let go."
    )
    # It hangs as its model has it: nothing is sent, and from where it has been.
    assert (experiment.model, planned.robot) == (None, None)
    assert set(columns) == {"knee/position", "knee/effort_target"}
    assert not columns["knee/effort_target"].any()
    assert 0.1 < columns["knee/position"][0] < 1.5


def test_what_a_motor_makes_of_its_command_shows_against_a_clamp(tmp_path: Path) -> None:
    motor = driven(tmp_path, 'motor joint="knee"')
    members = [member(motor, "effort_limit", 0.45), member(motor, "effort_limit", 0.3)]
    planned = next_experiment(motor, members)
    assert planned is not None
    experiment, columns = planned.experiment, planned.targets.columns
    assert experiment.set_up == "held_link"
    assert experiment.instruction == "Clamp the link behind joint knee at the first position."
    assert experiment.excitation in ("steps", "chirp")
    # What the motor has made already, and no more.
    assert 0.2 < np.abs(columns["knee/effort_target"]).max() <= 0.52
    assert np.ptp(columns["knee/position"]) == 0
    assert planned.robot is not None
    assert planned.robot.model.dof_armature[0] > 1e6


def test_joints_that_take_velocities_are_moved_through_their_room(tmp_path: Path) -> None:
    wheel = driven(tmp_path, 'velocity joint="knee" kv="1"')
    members = [member(wheel, "viscous_friction", 0.2), member(wheel, "coulomb_friction", 0.1)]
    planned = next_experiment(wheel, members)
    assert planned is not None
    experiment, log = planned.experiment, planned.targets
    assert (experiment.set_up, experiment.model) == ("as_it_is", None)
    assert experiment.separation > 5
    assert set(log.columns) == {"knee/position", "knee/velocity_target"}
    sent, reached = log.columns["knee/velocity_target"], wheel.robots[0].excursion("knee")
    assert 0.2 * reached.velocity < np.abs(sent).max() <= 1.01 * reached.velocity
    # What is sent leads back to where it began, which is in the middle of the room.
    moved = log.columns["knee/position"][0] + np.cumsum(sent) / log.rate
    assert 0.3 * reached.range < np.ptp(moved) < 1.05 * reached.range
    assert abs(moved[-1] - moved[0]) < 0.1 * reached.range


@pytest.mark.parametrize("set_up", ["held_link", "motor_off", "reduced_gain"])
def test_what_is_done_with_a_joint_that_takes_velocities(tmp_path: Path, set_up: str) -> None:
    wheel = driven(tmp_path, 'velocity joint="knee" kv="1"')
    members = [member(wheel, "torque_constant", 1.1), member(wheel, "torque_constant", 0.9)]
    bench = planner._Bench(wheel, members)
    changes = planner.set_ups(
        wheel.robots[0], ["knee"], concerned=["knee"], efforts=True, excitations=list(BATTERY)
    )
    change = next(one for one in changes if one.name == set_up)
    log = planner._targets(bench, change, change.excitations[0], 1.0)
    sent, position = log.columns["knee/velocity_target"], log.columns["knee/position"]
    effort = bench.predict([log], [change])[0][..., bench.channels.index(EFFORT)]
    peak = wheel.robots[0].excursion("knee").effort
    if set_up == "held_link":  # no more than the drive has made already, for the gain of 1
        assert "where its first position is" in change.instruction
        assert np.ptp(position) == 0
        assert 0.5 * peak < np.abs(sent).max() <= 1.01 * peak
        assert 0.5 * peak < np.abs(effort).max() <= 1.15 * peak
    elif set_up == "motor_off":
        assert "at the first position" in change.instruction
        assert not sent.any()
        assert not effort.any()
    elif set_up == "reduced_gain":
        assert change.instruction == "Set the velocity gain of every drive to 0.3 of what it is."
        robot = change.changed(wheel.robots[0])
        assert robot.model.actuator_gainprm[0, 0] == pytest.approx(0.3)
        assert robot.model.actuator_biasprm[0, :3] == pytest.approx([0.0, 0.0, -0.3])


def test_there_is_none_for_joints_of_which_some_take_no_targets(tmp_path: Path) -> None:
    shin = '<body pos="0 0 -0.25"><joint name="ankle" axis="0 1 0"/><geom size="0.03"/></body>'
    text = SERVO.replace("</body>", f"{shin}</body>")
    text = text.replace(DRIVE, f'{DRIVE}<motor joint="ankle"/>')
    (tmp_path / "mixed.xml").write_text(text)
    time = np.arange(0.0, 2.0, 0.004)
    columns = {f"{joint}/position": 0.3 * np.cos(5 * time) for joint in ("knee", "ankle")}
    columns |= {"knee/position_target": 0.31 * np.cos(5 * time), "ankle/effort_target": 0 * time}
    mixed = problem(tmp_path / "mixed.xml", [Recording(name="log", time=time, columns=columns)])
    members = [member(mixed, "viscous_friction", 0.2), member(mixed, "coulomb_friction", 0.1)]
    assert next_experiment(mixed, members) is None
    assert "all sent positions, all velocities, or all efforts" in planner.obstacle(mixed)


@pytest.mark.parametrize("joints", [2, 3])
def test_nobody_holds_three_joints_that_take_effort(tmp_path: Path, joints: int) -> None:
    names = [f"joint_{k}" for k in range(joints)]
    inner = ""
    for name in reversed(names):
        link = f'<joint name="{name}" axis="0 1 0"/><geom size="0.03" pos="0 0 -0.1"/>{inner}'
        inner = f'<body pos="0 0 -0.2">{link}</body>'
    motors = "".join(f'<motor joint="{name}"/>' for name in names)
    text = f"<mujoco><worldbody>{inner}</worldbody><actuator>{motors}</actuator></mujoco>"
    (tmp_path / "chain.xml").write_text(text)
    time = np.arange(0.0, 2.0, 0.004)
    columns = {f"{name}/position": 0.3 * np.cos(5 * time) for name in names}
    columns |= {f"{name}/effort_target": 0.1 * np.sin(5 * time) for name in names}
    chain = problem(tmp_path / "chain.xml", [Recording(name="log", time=time, columns=columns)])
    told = planner.obstacle(chain)
    assert ("one or two joints on a base that stands still" in told) == (joints > 2)
    assert bool(told) == (joints > 2)


@pytest.mark.parametrize("pushed", [False, True])
def test_a_joint_that_nothing_drives_has_no_motor_to_switch_off(
    tmp_path: Path, pushed: bool
) -> None:
    hanging = '<body pos="0 0 -0.25"><joint name="ankle" axis="0 1 0"/><geom size="0.03"/></body>'
    text = SERVO.replace(DRIVE, '<motor joint="knee"/>')
    (tmp_path / "two.xml").write_text(text.replace("</body>", f"{hanging}</body>"))
    time = np.arange(0.0, 2.0, 0.004)
    columns = {f"{joint}/position": 0.3 * np.cos(5 * time) for joint in ("knee", "ankle")}
    sent = ("knee", "ankle") if pushed else ("knee",)
    columns |= {f"{joint}/effort_target": np.sin(5 * time) for joint in sent}
    two = problem(tmp_path / "two.xml", [Recording(name="log", time=time, columns=columns)])
    assert planner.is_driven(two, "knee")
    assert planner.is_driven(two, "ankle") is pushed
    if not pushed:
        members = [member(two, "viscous_friction", 0.2), member(two, "viscous_friction", 0.1)]
        assert next_experiment(two, members) is None
