"""A free effort beside what is told: what it is, and what becomes of names beside it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests.gap.servo import SERVO, recorded
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.search.free_effort import FREE_EFFORT, shapes
from walkerkit.gap.search.naming import Explanation, name_effects
from walkerkit.gap.search.structure import Structure, Term
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Replay
from walkerkit.gap.simulation.robot import Excursion, Robot
from walkerkit.gap.simulation.trials import Trials
from walkerkit.gap.workflow import prepare

LACKING = ("viscous_friction", "coulomb_friction", "armature", "position_gain", "torque_bias")


@pytest.fixture(scope="module")
def explained(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Explanation]:
    """Explains logs of a servo with something hidden, by some effects alone."""
    model = tmp_path_factory.mktemp("servo") / "servo.xml"
    model.write_text(SERVO)

    def explain(*hidden: HiddenEffect, effects: Sequence[str] = LACKING) -> Explanation:
        logs = recorded(model, *hidden)
        problem = prepare(load_experiments(model, logs), window=0.5, n_threads=1)
        return name_effects(problem.problem("zero_order"), [CATALOGUE[name] for name in effects])

    return explain


def hide(effect: str, **values: float) -> HiddenEffect:
    return HiddenEffect(effect=effect, joints=("knee",), values=values)


COGGING = hide("cogging", amplitude=0.4, periods=9.0, phase=0.5)
FRICTION = hide("coulomb_friction", frictionloss=0.5)


def confidence(explanation: Explanation) -> dict[str, float]:
    return {one.term.effect.name: one.confidence for one in explanation.named}


def test_a_wrong_name_that_says_no_more_than_any_effort_is_not_sure(
    explained: Callable[..., Explanation],
) -> None:
    """Cogging that is in no catalogue looks like what else goes with the pose."""
    found = explained(COGGING, effects=("torque_bias", "parallel_spring", "kinematic_error"))
    assert found.unknown is not None
    assert found.unknown > 0.99
    assert found.table.confidence([{"kinematic_error"}]) > 0.9  # as if nothing else could be
    assert "kinematic_error" in confidence(found)
    assert all(sure < 0.9 for sure in confidence(found).values())


def test_a_right_name_stays_sure_beside_what_has_none(
    explained: Callable[..., Explanation],
) -> None:
    found = explained(COGGING, FRICTION)
    assert found.unknown is not None
    assert found.unknown > 0.99
    assert confidence(found)["coulomb_friction"] > 0.9


def test_where_nothing_is_left_nothing_is_unknown(explained: Callable[..., Explanation]) -> None:
    found = explained(hide("viscous_friction", damping=0.3))
    assert found.unknown == 0.0
    assert confidence(found) == {"viscous_friction": pytest.approx(1.0, abs=1e-3)}


SLIDER = """
<mujoco>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body><joint name="lift" type="slide" axis="0 0 1" damping="3"/>
    <geom size="0.05" mass="2"/></body></worldbody>
  <actuator><position joint="lift" kp="400"/></actuator>
</mujoco>
"""
EXCURSION = Excursion(lower=-0.5, upper=1.5, velocity=4.0, effort=150.0)


def slider(change: Callable[[mujoco.MjSpec], None] = lambda spec: None) -> Robot:
    spec = mujoco.MjSpec.from_string(SLIDER)
    change(spec)
    return replace(robot_from_spec(spec, "slider.xml"), excursions={"lift": EXCURSION})


def pushed(spec: mujoco.MjSpec) -> None:
    spec.option.gravity[2] += 7.0 / 2.0


def stronger(spec: mujoco.MjSpec) -> None:
    spec.actuators[0].gainprm[0] *= 1.2
    spec.actuators[0].biasprm[1] *= 1.2


@pytest.mark.parametrize(("number", "value", "native"), [(0, 7.0, pushed), (17, 30.0, stronger)])
def test_its_constant_and_its_load_are_what_mujoco_makes_of_them(
    number: int, value: float, native: Callable[[mujoco.MjSpec], None]
) -> None:
    """A constant is gravity on a lift, and what goes with the load is a stronger motor."""
    robot, changed = slider(), slider(native)
    time = 0.002 * np.arange(500)
    columns = {"lift/position": np.zeros(500), "lift/position_target": 0.3 * np.sin(6 * time)}
    log = Recording(name="log", time=time, columns=columns)
    replays = [
        Replay(one, whole(log), [Channel(joint="lift", signal="position")])
        for one in (robot, changed)
    ]
    free = Structure((Term(effect=FREE_EFFORT, sites=("lift",)),), (robot,))
    values = free.zero.copy()
    values[number] = value
    as_it_is, with_it = replays[0].predict(free.trials(robot, np.stack([free.zero, values])))
    (natively,) = replays[1].predict(Trials(changed, 1))
    assert np.abs(as_it_is - natively).max() > 1e-3
    np.testing.assert_allclose(with_it, natively, atol=1e-9)


def test_each_of_its_shapes_is_of_one_size() -> None:
    """So that one plausible size suits all of them."""
    q, qd, effort = np.random.default_rng(0).uniform(-1, 1, size=(3, 1000))
    found = shapes(q, qd, effort)
    assert len(found) == len(FREE_EFFORT.parameters(slider(), "lift"))
    assert (np.abs(found).max(axis=1) <= 1).all()
    assert (np.abs(found).max(axis=1) > 0.9).all()
    assert np.linalg.matrix_rank(found) == len(found)


def test_it_is_in_no_catalogue() -> None:
    assert FREE_EFFORT.name not in CATALOGUE
