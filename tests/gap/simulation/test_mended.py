"""Mended robots as walkers: the same trajectory as the replay, step for step."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from dm_control import composer

from tests.gap.effects.machine import AWKWARD, JOINTS, PLAIN, commands, robot_of
from tests.gap.simulation.follow import Follow
from walkerkit.actuators.drivetrain import LAWS
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.search.structure import Structure, candidate_terms
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.mended import Mended
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.trials import Trials

ROWS = 250
CHANNELS = [Channel(joint=joint, signal="position") for joint in JOINTS]
NATIVE = [
    "viscous_friction",
    "coulomb_friction",
    "armature",
    "payload",
    "parallel_spring",
    "position_gain",
    "velocity_gain",
    "torque_constant",
    "torque_bias",
    "effort_limit",
    "command_delay",
    "encoder_offset",
    "base_tilt",
]


def log(step, rows):
    time = step * np.arange(rows)
    targets = commands(time)
    columns = {}
    for k, joint in enumerate(JOINTS):
        columns[f"{joint}/position"] = np.full(rows, targets[0, k])
        columns[f"{joint}/velocity"] = np.zeros(rows)
        columns[f"{joint}/position_target"] = targets[:, k]
    return Recording(name="log", time=time, columns=columns), targets


@cache
def arm(name):
    """The machine's robot, made once: nothing here changes it."""
    return robot_of({"plain": PLAIN, "awkward": AWKWARD}[name])[0]


CONTROLLERS = [name for name, law in LAWS.items() if law.stage == "controller"]
OWN_DELAY = "<position delay='0.013' nsample='9' interp='linear'"
ELSEWHERE = {
    # `test_gear_play` steps their walkers.
    *("backlash", "series_elasticity"),
    # A replay begins on a mount that the robot's weight has bent, an episode on a straight one.
    "mount_compliance",
    # The machine stands on nothing.
    *("ground_friction", "ground_compliance", "foot_offset"),
    # A replay begins when the integrator has settled, an episode with an empty one.
    "integral_action",
}


def mended(robot, names, laws=(), share=0.3):
    terms = candidate_terms([CATALOGUE[name] for name in names], [robot], JOINTS)
    structure = Structure(terms, (robot,))
    starts = np.array([slot.parameter.starts[-1] for slot in structure.slots])
    values = structure.zero + share * (starts - structure.zero)
    trials = structure.trials(robot, np.clip(values, *structure.bounds)[None])
    for name, parameters in laws:
        given = trials.law(LAWS[name], "knee")
        for parameter, value in parameters.items():
            given[parameter][:] = value
    # A walker has no log, so that nothing lies between it and its joints.
    return replace(mend(trials), measurement={})


@pytest.mark.parametrize("variant", ["plain", "awkward"])
@pytest.mark.parametrize(
    ("names", "laws"),
    [
        ([], []),
        (NATIVE, []),
        (
            ["command_delay", "position_gain"],
            [
                ("setpoint_filter", {"time_constant": 0.02}),
                ("stribeck_friction", {"breakaway": 0.4, "velocity": 0.1}),
                ("cogging", {"amplitude": 0.3, "periods": 9.0}),
            ],
        ),
    ],
    ids=["nothing", "native", "laws"],
)
def test_the_walker_moves_as_the_replay_does(variant, names, laws):
    assert moved_alike(mended(arm(variant), names, laws)).min() > 0.25


@pytest.mark.parametrize("variant", ["plain", "awkward"])
@pytest.mark.parametrize("name", [name for name in CATALOGUE if name not in ELSEWHERE])
def test_the_walker_has_each_effect(variant, name):
    moved = moved_alike(mended(arm(variant), [name], share=1.0))
    # In steps of a tenth the log ends where the motion begins.
    assert moved.max() > 0.001 if name == "timestep" else moved.min() > 0.05


@pytest.mark.parametrize("variant", ["plain", "awkward"])
@pytest.mark.parametrize("name", [name for name in CONTROLLERS if name not in ELSEWHERE])
def test_a_controller_gets_what_comes_late(variant, name):
    names = dict.fromkeys(["command_delay", name])
    assert moved_alike(mended(arm(variant), names, share=1.0)).min() > 0.05


def test_a_controller_gets_what_the_models_own_delay_lets_through():
    variant = {**PLAIN, "actuators": PLAIN["actuators"].replace("<position", OWN_DELAY)}
    robot = mended(robot_of(variant)[0], ["sample_and_hold"], share=1.0)
    assert moved_alike(robot).min() > 0.25


def test_a_limit_of_one_joint_is_seen_beside_one_that_has_none():
    limited = PLAIN["actuators"].replace(' forcerange="-20 20"', "")
    limited = limited.replace("<position", "<position forcerange='-4 4'", 1)
    robot = mended(robot_of({**PLAIN, "actuators": limited})[0], ["supply_sag"], share=1.0)
    assert moved_alike(robot, rows=400).min() > 0.25


def moved_alike(robot, rows=ROWS):
    """How far each joint moves, (2,) rad, where the walker moves as the replay does."""
    step = robot.model.opt.timestep
    recording, targets = log(step, rows)
    predicted = Replay(robot, whole(recording), CHANNELS).predict(Trials(robot, 1))[0]
    walker = Mended(robot).walker(name="arm")
    # legacy_step takes up dry friction of laws one step late.
    environment = composer.Environment(
        Follow(walker, targets, step), random_state=0, legacy_step=False
    )
    environment.reset()
    for _ in range(20):  # what an episode leaves behind would show in the next
        environment.step(np.zeros(2))
    environment.reset()
    joints = environment.physics.bind(walker.observable_joints)
    path = [np.array(joints.qpos)]
    for _ in range(rows - 1):
        environment.step(np.zeros(2))
        path.append(np.array(joints.qpos))
    np.testing.assert_allclose(path, predicted, atol=1e-7)
    return np.ptp(predicted, axis=0)


def test_actuators_say_what_mjcf_cannot():
    robot = mended(arm("plain"), ["position_gain"], [("cogging", {"amplitude": 0.3})])
    made = Mended(robot)
    (servos,), (cogging,) = made.actuators.actuators, made.actuators.laws
    assert servos.slope == {"hip": 1.0, "knee": 1.0}
    assert cogging.amplitude == {"knee": 0.3}
    model = made.model
    model.opt.timestep = 0.1
    assert robot.model.opt.timestep != 0.1
    assert model.actuator_gainprm[0, 0] != 60.0
