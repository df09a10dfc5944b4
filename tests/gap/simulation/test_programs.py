"""Walkers whose actuators' laws run in Python, as the gap workflow replays them."""

from __future__ import annotations

import importlib
import sys
import textwrap
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import mujoco
import numpy as np
import pytest
from dm_control import mjcf

from walkerkit.actuators import ActuatorCmd, BuiltinMotorActuatorCfg
from walkerkit.actuators.explicit import ExplicitActuator
from walkerkit.actuators.networks import Lstm, Mlp
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import Segment
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.mended import Mended
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.sidecar import with_sidecar
from walkerkit.gap.simulation.start import state_offset
from walkerkit.gap.simulation.trials import Trials
from walkerkit.walkers import MjcfWalker
from walkerkit.walkers.saved import saved_actuators

ARM = """
<mujoco model="arm">
  <option timestep="0.002" integrator="implicitfast"/>
  <compiler angle="radian"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 1 0" armature="0.02" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.8"/>
      <body name="lower" pos="0 0 -0.3">
        <joint name="elbow" axis="0 1 0" armature="0.01" damping="0.05"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/>
      </body>
    </body>
  </worldbody>
</mujoco>
"""
USERS = """
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from walkerkit.actuators import (
    DcMotorActuatorCfg, DelayedActuatorCfg, IdealPdActuatorCfg, LearnedMlpActuatorCfg,
    LstmActuatorCfg, Numbers, PdLaw, RemotizedPdActuatorCfg, number, pd_parameters,
)
from walkerkit.actuators.drivetrain import SetpointFilter
from walkerkit.walkers import MjcfWalker

HERE = Path(__file__).parent
ALL = (".*",)


class CompensatedLaw(PdLaw):
    def effort(self, position, velocity, effort, q, qd):
        computed, _ = super().effort(position, velocity, effort, q, qd)
        computed = computed + self.get("coulomb") * np.tanh((position - q) / 0.02)
        return computed, self._limited(computed, q, qd)


@dataclass(frozen=True, kw_only=True)
class CompensatedCfg(IdealPdActuatorCfg):
    coulomb: Numbers = number(at_least=0)

    def law(self, numbers):
        return CompensatedLaw({**pd_parameters(numbers), "coulomb": numbers["coulomb"]})


PD = dict(joint_names_expr=ALL, stiffness={"shoulder": 40.0, "elbow": 25.0}, damping=1.5)
MOTOR = dict(saturation_effort=9.0, velocity_limit=8.0, effort_limit=7.0)
NET = dict(pos_scale=1.0, vel_scale=0.1, torque_scale=5.0, **MOTOR)
ideal = IdealPdActuatorCfg(**PD, effort_limit=6.0)
dc = DcMotorActuatorCfg(**PD, **MOTOR)
remotized = RemotizedPdActuatorCfg(**PD, effort_lookup=((-1.0, 3.0), (0.0, 9.0), (1.0, 4.0)))
own = CompensatedCfg(**PD, effort_limit=30.0, coulomb={"shoulder": 0.5, "elbow": 0.2})
late = DelayedActuatorCfg(base_cfg=own, delay_min_lag=3, delay_max_lag=3)


def mlp():
    return LearnedMlpActuatorCfg(
        joint_names_expr=ALL, network_file=HERE / "mlp.npz", history_length=3, **NET
    )


def lstm():
    return LstmActuatorCfg(joint_names_expr=ALL, network_file=HERE / "lstm.npz", **NET)


def walker(actuators, **more):
    return MjcfWalker.from_file(HERE / "arm.xml", actuators, **more)


def make_ideal(): return walker(ideal)
def make_dc(): return walker(dc)
def make_remotized(): return walker(remotized)
def make_own(): return walker(own)
def make_late(): return walker(late)
def make_mlp(): return walker(mlp())
def make_lstm(): return walker(lstm())
def make_random(): return walker(
    DelayedActuatorCfg(base_cfg=ideal, delay_min_lag=1, delay_max_lag=4))
def make_lawful(): return walker(
    own, laws=(SetpointFilter(joint_names_expr=("elbow",), time_constant=0.03),))
"""
KINDS = ("ideal", "dc", "remotized", "own", "late", "mlp", "lstm")


@pytest.fixture
def users(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """A user's own module, in a folder of the user's own."""
    rng = np.random.default_rng(0)
    (tmp_path / "arm.xml").write_text(ARM)
    (tmp_path / "users_arm.py").write_text(textwrap.dedent(USERS))
    Mlp(
        weights=[rng.normal(size=(8, 6)), rng.normal(size=(1, 8)) * [[1.0]]],
        biases=[np.zeros(8), np.zeros(1)],
        activations=["softsign", "identity"],
    ).save(tmp_path / "mlp.npz")
    Lstm(
        weights_ih=[rng.normal(size=(16, 2))],
        weights_hh=[0.3 * rng.normal(size=(16, 4))],
        biases_ih=[np.zeros(16)],
        biases_hh=[np.zeros(16)],
        head_weight=rng.normal(size=(1, 4)),
        head_bias=np.zeros(1),
    ).save(tmp_path / "lstm.npz")
    monkeypatch.syspath_prepend(tmp_path)
    yield importlib.import_module("users_arm")
    del sys.modules["users_arm"]


def target(time: float) -> np.ndarray:
    return np.array([0.5, 0.4]) * np.sin(np.array([6.0, 9.0]) * time) * min(time / 0.1, 1.0)


def run(walker: MjcfWalker, n_steps: int = 200, every: int = 1) -> Recording:
    """The log of a walker's own model, whose laws run before each step."""
    physics = mjcf.Physics.from_mjcf_model(walker.mjcf_model)
    walker.drivetrain.initialize(physics)
    walker.drivetrain.reset(np.random.RandomState(0))
    names = walker.actuator_group.joint_names
    step = physics.timestep()
    rows: dict[str, list[float]] = {f"{n}/{s}": [] for n in names for s in SIGNALS}
    for k in range(n_steps):
        if k % every == 0:
            asked = target(k * step)
            walker.command = ActuatorCmd(position_target=asked)
            for name, value in zip(names, asked, strict=True):
                rows[f"{name}/position"].append(float(physics.named.data.qpos[name][0]))
                rows[f"{name}/velocity"].append(float(physics.named.data.qvel[name][0]))
                rows[f"{name}/position_target"].append(value)
        walker.drivetrain.run()
        physics.step()
        if k % every == 0:
            changed = walker.drivetrain.changed_effort
            for i, (name, dof) in enumerate(zip(names, range(len(names)), strict=True)):
                rows[f"{name}/effort"].append(float(physics.data.qfrc_actuator[dof] + changed[i]))
    time = step * every * np.arange(len(rows[f"{names[0]}/position"]))
    return Recording(name="run", time=time, columns={n: np.array(v) for n, v in rows.items()})


SIGNALS = ("position", "velocity", "position_target", "effort")


def replay_of(robot: Robot, recording: Recording) -> Replay:
    channels = [Channel(joint=j, signal=s) for s in ("position", "effort") for j in robot.joints]
    segment = Segment(recording=recording, first=0, last=len(recording.time))
    return Replay(robot, [segment], channels, n_threads=1)


def gap(robot: Robot, recording: Recording, trials: Trials | None = None) -> float:
    """Root-mean-square error of the positions [rad]."""
    replay = replay_of(robot, recording)
    predicted = replay.predict(Trials(robot, 1) if trials is None else trials)[-1]
    return float(np.sqrt(np.mean((predicted - replay.measured)[:, :2] ** 2)))


@pytest.mark.parametrize("kind", KINDS)
def test_a_replay_is_bit_for_bit_what_the_walker_did(kind: str, users: ModuleType) -> None:
    recording = run(getattr(users, f"make_{kind}")())
    robot = load_robot(f"users_arm:make_{kind}")
    (_, running), *others = replay_of(robot, recording).predicting(Trials(robot, 3))
    assert not others
    asked = next(running)
    state = asked.state.copy()  # the log's start is estimated: take what it really was
    for signal, component in (("position", "QPOS"), ("velocity", "QVEL")):
        first = state_offset(robot.model, getattr(mujoco.mjtState, f"mjSTATE_{component}"))
        for name, joint in robot.joints.items():
            at = joint.qpos if signal == "position" else joint.dof
            state[:, first + at] = recording.columns[f"{name}/{signal}"][0]
    rollout, _ = replace(asked, state=state).done()
    n = len(recording.time)
    assert np.ptp(recording.columns["elbow/position"]) > 0.05
    for name, joint in robot.joints.items():
        for sim in range(3):
            np.testing.assert_array_equal(
                rollout.records["qpos"][sim, : n - 1, joint.qpos],
                recording.columns[f"{name}/position"][1:],
            )
            np.testing.assert_array_equal(
                rollout.records["qfrc_actuator"][sim, :n, joint.dof],
                recording.columns[f"{name}/effort"],
            )


def test_the_middle_of_a_log_goes_on_with_what_the_law_remembers(users: ModuleType) -> None:
    recording = run(users.make_lstm(), n_steps=700, every=1)
    robot = load_robot("users_arm:make_lstm")
    channels = [Channel(joint=j, signal="effort") for j in robot.joints]
    replay = Replay(robot, [Segment(recording=recording, first=600, last=640)], channels)
    predicted = replay.predict(Trials(robot, 1))[0]
    largest = np.abs(recording.columns["shoulder/effort"]).max()
    assert np.abs(predicted - replay.measured).max() < 2e-3 * largest


def test_drivetrain_laws_of_a_walker_are_replayed(users: ModuleType) -> None:
    recording = run(users.make_lawful())
    robot = load_robot("users_arm:make_lawful")
    assert robot.laws == {"elbow": {"setpoint_filter": {"time_constant": 0.03}}}
    assert gap(robot, recording) < 0.02 * gap(load_robot("users_arm:make_own"), recording)


def test_random_lags_are_replayed_by_their_mean_and_told(users: ModuleType) -> None:
    robot = load_robot("users_arm:make_random")
    assert robot.joints["elbow"].drives[0].late == pytest.approx(0.005)
    (note,) = robot.notes
    assert "drawn at random from 1 to 4 steps" in note


CHANGES: dict[str, tuple[tuple[float, ...], Callable[[ModuleType], MjcfWalker]]] = {
    "position_gain": (
        (8.0,),
        lambda users: users.walker(replace(users.own, stiffness={"shoulder": 40.0, "elbow": 33.0})),
    ),
    "velocity_gain": (
        (0.7,),
        lambda users: users.walker(replace(users.own, damping={"shoulder": 1.5, "elbow": 2.2})),
    ),
    "effort_limit": (
        (1.0,),
        lambda users: users.walker(
            replace(users.own, effort_limit={"shoulder": 30.0, "elbow": 1.0})
        ),
    ),
    "viscous_friction": (
        (0.3,),
        lambda users: users.walker(
            (
                replace(users.own, joint_names_expr=("shoulder",), stiffness=40.0, coulomb=0.5),
                replace(
                    users.own,
                    joint_names_expr=("elbow",),
                    stiffness=25.0,
                    coulomb=0.2,
                    viscous_damping=0.35,
                ),
            )
        ),
    ),
}


@pytest.mark.parametrize("effect", CHANGES)
def test_effects_reach_the_law_and_the_mended_walker(effect: str, users: ModuleType) -> None:
    values, hardware = CHANGES[effect]
    recording = run(hardware(users))
    robot = load_robot("users_arm:make_own")
    trials = Trials(robot, 2)
    CATALOGUE[effect].apply(
        trials, "elbow", np.array([[p.zero for p in _parameters(effect, robot)], values])
    )
    predicted = replay_of(robot, recording).predict(trials)
    untouched = replay_of(robot, recording).predict(Trials(robot, 1))
    np.testing.assert_array_equal(predicted[0], untouched[0])
    before = gap(robot, recording)
    assert before > 1e-3
    assert gap(robot, recording, trials) < 0.02 * before
    mended = mend(trials.rows(np.array([1])))
    assert gap(mended, recording) < 0.02 * before
    again = run(Mended(mended).walker())
    for name, column in recording.columns.items():
        np.testing.assert_allclose(again.columns[name], column, atol=1e-9)


def _parameters(effect: str, robot: Robot) -> tuple[object, ...]:
    return CATALOGUE[effect].parameters(robot, "elbow")


def test_a_command_delay_is_found_in_front_of_the_law(users: ModuleType) -> None:
    recording = run(users.make_late(), every=1)
    robot = load_robot("users_arm:make_own")
    trials = Trials(robot, 1)
    CATALOGUE["command_delay"].apply(trials, "elbow", np.array([[0.006]]))
    CATALOGUE["command_delay"].apply(trials, "shoulder", np.array([[0.006]]))
    assert gap(robot, recording, trials) < 0.02 * gap(robot, recording)
    walker = Mended(mend(trials)).walker()
    assert {cfg.delay_max_lag for cfg in walker.actuator_group.cfgs} == {3}
    again = run(walker)
    np.testing.assert_allclose(
        again.columns["elbow/position"], recording.columns["elbow/position"], atol=1e-9
    )


def test_motors_keep_what_was_found_of_them(users: ModuleType) -> None:
    robot = load_robot("users_arm:make_own")
    trials = Trials(robot, 1)
    CATALOGUE["torque_constant"].apply(trials, "elbow", np.array([[0.2]]))
    CATALOGUE["torque_bias"].apply(trials, "elbow", np.array([[0.3]]))
    mended = mend(trials)
    recording = run(Mended(mended).walker())
    assert gap(mended, recording) < 0.05 * gap(robot, recording)


def test_a_saved_folder_says_which_config_it_needs(users: ModuleType, tmp_path: Path) -> None:
    robot = load_robot("users_arm:make_late")
    trials = Trials(robot, 1)
    CATALOGUE["position_gain"].apply(trials, "elbow", np.array([[8.0]]))
    mended = Mended(mend(trials))
    folder = tmp_path / "out"
    folder.mkdir()
    path = mended._written(folder)
    with pytest.raises(ValueError, match=r"runs in Python \('CompensatedCfg'\).*in_python="):
        MjcfWalker.from_file(path)
    with pytest.raises(InputError, match=r"runs in Python.*package\.module:callable"):
        with_sidecar(robot, path)
    native = BuiltinMotorActuatorCfg(joint_names_expr=(".*",))
    with pytest.raises(ValueError, match="whose law does not run in Python"):
        saved_actuators(path, in_python=[native])
    saved = saved_actuators(path, in_python=[users.late])
    again = run(MjcfWalker.from_file(path, saved.actuators, laws=saved.laws))
    expected = run(mended.walker())
    np.testing.assert_array_equal(
        again.columns["elbow/position"], expected.columns["elbow/position"]
    )


def test_the_bare_model_says_that_the_walker_is_needed(users: ModuleType, tmp_path: Path) -> None:
    recording = run(users.make_ideal())
    path = tmp_path / "bare.xml"
    path.write_text(users.make_ideal().mjcf_model.to_xml_string())
    robot = load_robot(path)
    with pytest.raises(InputError, match="returns the walker itself"):
        replay_of(robot, recording)


def test_what_no_replay_can_run_is_refused(users: ModuleType) -> None:
    class Odd(ExplicitActuator):
        def control(self, *targets):
            return super().control(*targets)

    class OddCfg(users.CompensatedCfg):
        def build(self):
            return Odd(self)

    users.make_odd = lambda: users.walker(OddCfg(**users.PD, coulomb=0.1))
    with pytest.raises(InputError, match=r"Odd of .* makes its controls itself.*as a Law"):
        load_robot("users_arm:make_odd")
