"""Dry friction that knows a direction, a speed, a load or a memory."""

import math

import mujoco
import numpy as np
import pytest

from tests.gap.effects.contract import EffectContract, replayed
from tests.gap.effects.machine import LEG, PLAIN, STEP
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.effects.equivalences import equivalences
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.trials import Trials


def stiffened(machine, name):
    """Dry friction that hardly creeps; the joint's number among hip and knee."""
    joint = machine.model.joint(name)
    machine.model.dof_solref[joint.dofadr] = (2 * STEP, 1)
    machine.model.dof_solimp[joint.dofadr] = (0.99, 0.99, 0.001, 0.5, 2)
    return ("hip", "knee").index(name)


class TestQuadraticDrag(EffectContract):
    name = "quadratic_drag"
    seconds = 2.0

    def plant(self, machine):
        def gear(now):
            now.extra[1] -= 0.13 * now.qd[1] * abs(now.qd[1])

        machine.gear = gear
        return {"knee": [0.13]}


class TestAsymmetricFriction(EffectContract):
    name = "asymmetric_friction"
    seconds = 2.0

    def plant(self, machine):
        knee = stiffened(machine, "knee")

        def gear(now):
            # A ratchet: a preload that the joint has to lift one way and is held against the other.
            now.friction[knee] += 0.24
            now.extra[knee] -= 0.17

        machine.gear = gear
        return {"knee": [0.41, 0.07]}


class TestStribeckFriction(EffectContract):
    name = "stribeck_friction"
    seconds = 2.0
    idle = ("velocity", "exponent")

    def plant(self, machine):
        knee = stiffened(machine, "knee")

        def gear(now):
            now.friction[knee] += 0.52 * math.exp(-((abs(now.qd[knee]) / 0.31) ** 1.4))

        machine.gear = gear
        return {"knee": [0.52, 0.31, 1.4]}


class TestLoadDependentFriction(EffectContract):
    name = "load_dependent_friction"
    seconds = 2.0

    def plant(self, machine):
        hip = stiffened(machine, "hip")

        def gear(now):
            now.friction[hip] += 0.23 * abs(now.effort[hip])

        machine.gear = gear
        return {"hip": [0.23]}


class TestDirectionalEfficiency(EffectContract):
    name = "directional_efficiency"
    seconds = 2.0

    def plant(self, machine):
        hip = stiffened(machine, "hip")

        def gear(now):
            # Lost when it drives: a quarter of the effort less than what the gear holds.
            now.friction[hip] += 0.125 * abs(now.effort[hip])
            now.extra[hip] -= 0.125 * now.effort[hip]

        machine.gear = gear
        return {"hip": [0.75, 1.0]}


class TestPreslidingFriction(EffectContract):
    name = "presliding_friction"
    seconds = 2.0
    idle = ("bend",)

    def plant(self, machine):
        bent = 0.0

        def gear(now):
            nonlocal bent
            for _ in range(200):
                speed = now.qd[1]
                bent += STEP / 200 * (speed - 45.0 * abs(speed) * bent / 0.4)
            now.extra[1] -= 45.0 * bent

        machine.gear = gear
        return {"knee": [0.4, 0.4 / 45.0]}


def with_effects(robot, recording, values):
    """What the log would show with some effects at the knee."""
    trials = Trials(robot, 1)
    for name, numbers in values.items():
        CATALOGUE[name].apply(trials, "knee", np.array([numbers]))
    return replayed(robot, recording, trials)[0]


@pytest.mark.parametrize(
    ("one", "both"),
    [
        (
            {"asymmetric_friction": [0.5, 0.2]},
            {"coulomb_friction": [0.35], "torque_bias": [-0.15]},
        ),
        (
            {"directional_efficiency": [0.7, 1.1]},
            {"load_dependent_friction": [0.2 / 0.9], "torque_constant": [-0.1]},
        ),
    ],
    ids=lambda values: " ".join(values),
)
def test_two_effects_that_are_exactly_one(one, both, plain):
    robot, recording = plain
    expected = with_effects(robot, recording, one)
    found = with_effects(robot, recording, both)
    plainly = replayed(robot, recording, Trials(robot, 1))[0]
    # The drive's own damping is integrated implicitly, what a law takes from it is not.
    changed, apart = (np.sqrt(np.mean((m - expected) ** 2, axis=0)) for m in (plainly, found))
    assert (apart < 0.06 * changed).all()
    (name,) = one
    for other, beside in (tuple(both), tuple(both)[::-1]):
        if other != "coulomb_friction":
            assert name in equivalences(other, ["position", "effort"], beside=[beside])
            assert other in equivalences(name, ["position", "effort"], beside=[beside])


def test_a_bias_on_a_robot_with_dry_friction_is_friction_of_two_sizes(plain):
    text = LEG.format(**PLAIN | {"knee": 'frictionloss="0.4"'})
    robot = robot_from_spec(mujoco.MjSpec.from_string(text), "leg.xml")
    _, recording = plain
    expected = with_effects(robot, recording, {"asymmetric_friction": [0.15, -0.15]})
    found = with_effects(robot, recording, {"torque_bias": [-0.15]})
    np.testing.assert_allclose(found, expected, atol=1e-3)
    signals = ["position", "effort"]
    knee, hip = (
        equivalences("torque_bias", signals, robot=robot, joints=(joint,))
        for joint in ("knee", "hip")
    )
    assert set(knee) == {"asymmetric_friction"}
    assert hip == {}


PENDULUM = """
<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body><joint name="j" axis="0 1 0"/>
  <geom type="capsule" fromto="0 0 0 0.3 0 0" size="0.02" mass="0.5"/></body></worldbody>
<actuator><motor name="m" joint="j"/></actuator></mujoco>
"""


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("asymmetric_friction", [1.0, 1.0]),
        ("asymmetric_friction", [1.0, 0.2]),
        ("stribeck_friction", [1.0, 0.1, 1.0]),
        ("presliding_friction", [1.0, 0.002]),
        ("pose_dependent_friction", [1.0, 0.3, 5.0, -1.0]),
        ("load_dependent_friction", [0.3]),
        ("directional_efficiency", [0.7, 1.3]),
    ],
)
def test_a_link_held_by_friction_creeps_no_more_than_by_coulomb_friction(name, values):
    robot = robot_from_spec(mujoco.MjSpec.from_string(PENDULUM), "pendulum.xml")
    # Its weight is 0.74 N·m, 74 % of breakaway; of 0.6 N·m from the motor a gear loses 0.18 N·m.
    dry, motor = 1.0, 0.0
    if name in ("load_dependent_friction", "directional_efficiency"):
        dry, motor = 0.18, -0.6
    time = STEP * np.arange(500)
    columns = {"j/position": 0 * time, "j/effort_target": 0 * time + motor}
    channels = [Channel(joint="j", signal="position")]
    replay = Replay(robot, whole(Recording(name="log", time=time, columns=columns)), channels)

    def crept(effect, numbers):
        trials = Trials(robot, 1)
        CATALOGUE[effect].apply(trials, "j", np.array([numbers]))
        return np.ptp(replay.predict(trials)[0, 250:])  # after what springs has sprung

    coulomb = crept("coulomb_friction", [dry])
    assert crept(name, values) < 1.05 * coulomb
    assert coulomb < 1e-3
