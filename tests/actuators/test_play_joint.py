"""Play between motor and link is found by what it is, not by its name."""

import mujoco
import pytest

from walkerkit.actuators.play_joint import play_joint

LEG = """
<mujoco><worldbody><body><joint name="first" axis="0 1 0" armature="0.01"/>{between}
  <joint name="second" {second}/><geom size="0.1"/></body></worldbody>
<actuator><motor joint="first"/>{actuator}</actuator></mujoco>"""
GAP = 'axis="0 1 0" limited="true" range="-1 1"'
SPRING = 'axis="0 1 0" stiffness="40"'


def found(second, between="", actuator=""):
    model = mujoco.MjModel.from_xml_string(
        LEG.format(second=second, between=between, actuator=actuator)
    )
    play = play_joint(model, model.joint("first").id)
    return None if play is None else model.joint(play).name


@pytest.mark.parametrize("second", [GAP, SPRING])
def test_a_joint_on_the_same_axis_that_nothing_drives_is_play(second):
    assert found(second) == "second"


@pytest.mark.parametrize(
    "case",
    [
        {"second": 'axis="0 1 0"'},
        {"second": 'axis="1 0 0" stiffness="40"'},
        {"second": 'axis="0 1 0" pos="0 0 0.1" stiffness="40"'},
        {"second": 'type="slide" axis="0 1 0" stiffness="40"'},
        {"second": SPRING, "actuator": '<motor joint="second"/>'},
        {"second": SPRING, "between": '<joint name="other" axis="1 0 0"/>'},
    ],
    ids=["free", "axis", "place", "type", "driven", "behind another"],
)
def test_other_joints_are_none(case):
    assert found(**case) is None


def test_the_last_joint_of_a_body_has_no_play():
    model = mujoco.MjModel.from_xml_string(LEG.format(second=GAP, between="", actuator=""))
    assert play_joint(model, 1) is None
