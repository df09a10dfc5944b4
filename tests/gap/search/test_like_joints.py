"""Joints of a kind, and structures in which they share numbers."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.search.fit import evaluate, polished
from walkerkit.gap.search.like_joints import Tied, kinds_of_joints, tied
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.structure import Structure, Term, extended
from walkerkit.gap.simulation.excursion import excursions
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.trials import Trials

JOINTS = ("left_knee", "right_knee", "neck")
CHANNELS = [Channel(joint=joint, signal="position") for joint in JOINTS]


def body(name: str, at: float, mass: float, kp: float) -> tuple[str, str]:
    return (
        f'<body name="{name}" pos="0 {at} 0"><joint name="{name}" axis="0 1 0" damping="0.1"/>'
        f'<geom type="capsule" fromto="0 0 0 0 0 -.3" size=".02" mass="{mass}" '
        'contype="0" conaffinity="0"/></body>',
        f'<position name="{name}" joint="{name}" kp="{kp}" kv="0.3"/>',
    )


def robot(*, right_kp=20.0):
    parts = [
        body("left_knee", 0.0, 1.0, 20),
        body("right_knee", 1.0, 1.01, right_kp),
        body("neck", 2.0, 0.3, 5),
    ]
    spec = mujoco.MjSpec.from_string(
        '<mujoco><compiler angle="radian"/><option timestep="0.002"/><worldbody>'
        + "".join(one for one, _ in parts)
        + "</worldbody><actuator>"
        + "".join(one for _, one in parts)
        + "</actuator></mujoco>"
    )
    return robot_from_spec(spec, "three.xml")


@pytest.fixture
def moved():
    """The robot, sized, and its log with knees damped by 0.5 more, and the neck by 0.2."""
    own = robot()
    time = 0.002 * np.arange(1500)
    target = {joint: 0.4 * np.sin((3 + k) * time) for k, joint in enumerate(JOINTS)}
    model = own.model
    model.dof_damping[:] += [0.5, 0.5, 0.2]
    data, rows = mujoco.MjData(model), []
    for k in range(len(time)):
        rows.append(data.qpos.copy())
        data.ctrl[:] = [target[joint][k] for joint in JOINTS]
        mujoco.mj_step(model, data)
    columns = {f"{joint}/position_target": target[joint] for joint in JOINTS}
    columns |= {
        f"{joint}/position": row for joint, row in zip(JOINTS, np.array(rows).T, strict=True)
    }
    recording = Recording(name="log", time=time, columns=columns)
    plain = robot()
    return replace(plain, excursions=excursions(plain, [recording], list(JOINTS))), recording


def structure(own) -> Structure:
    names = ("viscous_friction", "armature")
    return Structure(tuple(Term(effect=CATALOGUE[n], sites=JOINTS) for n in names), (own,))


def test_kinds_are_told_by_inertia_losses_range_and_drives() -> None:
    assert kinds_of_joints(robot()) == (("left_knee", "right_knee"), ("neck",))
    assert kinds_of_joints(robot(right_kp=30.0)) == tuple((joint,) for joint in JOINTS)


def test_a_tied_structure_moves_its_joints_together(moved) -> None:
    own, recording = moved
    few = Tied.of(structure(own), kinds_of_joints(own))
    assert few is not None
    assert [slot.key[:2] for slot in few.slots] == [
        ("viscous_friction", "left_knee"),
        ("viscous_friction", "neck"),
        ("armature", "left_knee"),
        ("armature", "neck"),
    ]
    values = np.array([[0.3, 0.1, 0.002, 0.001]])
    trials = few.trials(own, values)
    expected = Trials(own, 1)
    expected.field("dof_damping")[:] += [0.3, 0.3, 0.1]
    expected.field("dof_armature")[:] += [0.002, 0.002, 0.001]
    replay = Replay(own, whole(recording), CHANNELS)
    np.testing.assert_array_equal(replay.predict(trials), replay.predict(expected))
    assert few.key != few.whole.key
    # Both knees are moved at once, so that nothing else can be; the neck is on its own.
    assert few.branches[0] is None
    assert few.branches[1] is not None


def test_joints_that_are_all_different_are_not_tied() -> None:
    own = robot(right_kp=30.0)
    assert Tied.of(structure(own), kinds_of_joints(own)) is None
    # A plain fit of few numbers is to be had all the same: one for all.
    few = tied(structure(own))
    assert few is not None
    assert [slot.key[0] for slot in few.slots] == ["viscous_friction", "armature"]


def test_a_tied_fit_finds_what_like_joints_share_and_is_a_start_of_the_whole(moved) -> None:
    own, recording = moved
    replay = Replay(own, whole(recording), CHANNELS)
    objective = Objective([replay], CHANNELS, np.full(3, 1e-5))
    (nothing,) = evaluate(objective, [(Structure((), (own,)), np.zeros(0))])
    start = extended(nothing, structure(own).terms)
    few = tied(start.structure)
    assert few is not None
    (found,) = polished(objective, [few.start(start)], iterations=10)
    apart = few.apart(found)
    np.testing.assert_allclose(apart.values[:3], [0.5, 0.5, 0.2], rtol=0.02)
    (again,) = evaluate(objective, [(apart.structure, apart.values)])
    np.testing.assert_allclose(again.mean_square, found.mean_square)
    assert again.score < nothing.score - 1
