"""Parts of a robot that cannot feel each other, and trying something in all of them at once."""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from tests.gap.search.test_fit import objective, sized, structure
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Case
from walkerkit.gap.simulation.branches import branches, met
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Channel
from walkerkit.gap.simulation.robot import Robot

LEG = """
<body name="{side}_thigh" pos="0 {y} 0">
  <joint name="{side}_hip" axis="0 1 0" damping="0.2" armature="0.01"/>
  <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="1"/>
  <body name="{side}_shank" pos="0 0 -0.2">
    <joint name="{side}_knee" axis="0 1 0" damping="0.1" armature="0.01"/>
    <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.4"/>
  </body>
</body>
"""


def two_legs(*, more: str = "", apart: float = 0.2) -> Robot:
    legs = "".join(LEG.format(side=side, y=y) for side, y in (("left", 0), ("right", apart)))
    joints = [f"{side}_{name}" for side in ("left", "right") for name in ("hip", "knee")]
    servos = "".join(f'<position name="{j}" joint="{j}" kp="30" kv="0.5"/>' for j in joints)
    xml = f"<mujoco><worldbody>{legs}</worldbody>{more}<actuator>{servos}</actuator></mujoco>"
    return robot_from_spec(mujoco.MjSpec.from_string(xml), "legs.xml")


def test_legs_that_cannot_touch_are_branches() -> None:
    robot = two_legs(more='<option><flag contact="disable"/></option>')
    joints, bodies = branches(robot)
    assert joints == {"left_hip": 0, "left_knee": 0, "right_hip": 1, "right_knee": 1}
    assert bodies == {"left_thigh": 0, "left_shank": 0, "right_thigh": 1, "right_shank": 1}


@pytest.mark.parametrize(
    "more",
    [
        "",  # they can touch
        '<option><flag contact="disable"/></option>'
        '<equality><joint joint1="left_hip" joint2="right_hip"/></equality>',
        '<option><flag contact="disable"/></option>'
        '<tendon><fixed><joint joint="left_hip" coef="1"/></fixed></tendon>',
    ],
    ids=["contact", "equality", "tendon"],
)
def test_legs_that_are_coupled_are_one(more: str) -> None:
    joints, _ = branches(two_legs(more=more))
    assert set(joints.values()) == {0}


@pytest.mark.parametrize(("apart", "count"), [(0.2, 2), (0.045, 1)])
def test_legs_that_could_touch_and_did_not_are_branches(apart: float, count: int) -> None:
    """Capsules of 4 cm across: 5 mm of air are too little for what is tried."""
    robot = two_legs(apart=apart)
    time = np.arange(200) * 0.005
    columns = {f"{joint}/position": 0.3 * np.sin(5 * time) for joint in robot.joints}
    columns["left_hip/position_target"] = 0.3 * np.sin(5 * time)
    recording = Recording(name="log", time=time, columns=columns)
    near = met(robot, [recording])
    assert near == (frozenset() if count == 2 else frozenset({(0, 1)}))
    joints, _ = branches(replace(robot, met=near))
    assert len(set(joints.values())) == count
    # A joint without a position may be anywhere.
    del columns["left_knee/position"]
    assert met(robot, [Recording(name="log", time=time, columns=columns)]) is None


def test_slopes_of_both_legs_at_once_are_those_of_each() -> None:
    robot = two_legs(more='<option><flag contact="disable"/></option>')
    time = np.arange(200) * 0.005
    columns = {}
    for k, joint in enumerate(robot.joints):
        columns[f"{joint}/position_target"] = 0.4 * np.sin((5 + k) * time)
        columns[f"{joint}/position"] = 0.3 * np.sin((5 + k) * (time - 0.02))
    recording = Recording(name="log", time=time, columns=columns)
    robot = sized(robot, recording)
    channels = [Channel(joint=joint, signal="position") for joint in robot.joints]
    one = objective(robot, [recording], channels)
    joints = list(robot.joints)
    tried = structure([robot], armature=joints, coulomb_friction=joints)
    start = 0.5 * tried.scale
    (current,) = evaluate(one, [(tried, start)])
    assert one.moves(tried.branches).row.max() == 3  # four numbers of each leg
    at_once = linearised(one, current).jacobian
    for k, slope in enumerate(at_once):
        moved = start + 0.02 * tried.scale * (np.arange(len(start)) == k)
        (pair,) = one.simulated([Case(structure=tried, values=np.stack([start, moved]))])
        before, after = pair
        np.testing.assert_allclose(slope, (after - before) / 0.02, atol=1e-7)
