from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from walkerkit.gap import InputError
from walkerkit.gap.own_robot.servo import with_servos

INNER = """\
<mujoco model="arm">
\t<!-- a comment, kept as it is -->
  <default>
    <default class="strong"><motor ctrlrange="-20 20" gear="2"/></default>
  </default>
  <worldbody>
    <body name="upper"  >
      <joint name="shoulder" axis="0 1 0" range="-1 1"/><geom size="0.1" mass="1"/>
      <body name="lower" pos="0 0 -0.3">
        <joint name="elbow" axis="0 1 0"/><geom size="0.1" mass="1"/>
        <body name="hand" pos="0 0 -0.3">
          <joint name="wrist" axis="0 1 0"/><geom size="0.1" mass="1"/>
        </body>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor class='strong' name="a" joint="shoulder"   ctrlrange="-15 10"></motor>
    <general name="b" joint="elbow" gainprm="3" ctrlrange="-2 2" ctrllimited="true"
             forcerange="-5 5" forcelimited="true" dyntype="filter" dynprm="0.1" biastype="none"/>
    <position name="c" joint="wrist" kp="5" dampratio="1"/>
  </actuator>
  <keyframe><key name="home" qpos="0.5 0 0"/></keyframe>
</mujoco>
"""
OUTER = '<mujoco>\n  <option timestep="0.001"/>\n  <include file="arm.xml"/>\n</mujoco>\n'


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.xml"
    path.write_text(INNER)
    return path


def test_motors_become_servos_of_the_joint(arm: Path) -> None:
    made = with_servos(arm, kp=60, kd=1.5)
    made.text.write(arm.with_name("new.xml"))
    model = mujoco.MjModel.from_xml_path(str(arm.with_name("new.xml")))
    assert made.joints == ("shoulder", "elbow")
    # Efforts at the joint: control times gear, and the smaller of control times gain and force.
    np.testing.assert_allclose(model.actuator_forcerange[:2], [[-30, 20], [-5, 5]])
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], [60, 60, 5])
    np.testing.assert_allclose(model.actuator_biasprm[:2, :3], [[0, -60, -1.5]] * 2)
    assert model.actuator_gear[:, 0].tolist() == [1, 1, 1]
    assert model.actuator_ctrllimited.tolist() == [0, 0, 0]
    assert model.na == 0
    assert any("keyframe 'home' has the control 0 for joint 'shoulder'" in n for n in made.notes)


def test_all_other_bytes_stay(arm: Path) -> None:
    """In the included file, too, and in whatever ends its lines."""
    arm.write_bytes(INNER.replace("\n", "\r\n").encode())
    outer = arm.with_name("scene.xml")
    outer.write_text(OUTER)
    made = with_servos(outer, kp=60, kd=1.5, joints=["elbow"])
    written = made.text.write(arm.with_name("servo.xml"))
    assert [path.name for path in written] == ["servo.xml", "servo_arm.xml"]
    assert written[0].read_text() == OUTER.replace("arm.xml", "servo_arm.xml")
    before = arm.read_bytes().split(b"<general ")
    after = written[1].read_bytes().split(b'<position name="b"')
    assert after[0] == before[0]
    assert after[1].split(b"/>", 1)[1] == before[1].split(b"/>", 1)[1]
    mujoco.MjModel.from_xml_path(str(written[0]))
    # Once more, with other gains for another joint; names of files do not grow.
    again = with_servos(written[0], kp=40, kd=1, joints=["shoulder|wrist"])
    files = again.text.write(arm.with_name("second.xml"))
    assert [path.name for path in files] == ["second.xml", "second_arm.xml"]
    model = mujoco.MjModel.from_xml_path(str(files[0]))
    np.testing.assert_allclose(model.actuator_gainprm[:, 0], [40, 60, 40])
    np.testing.assert_allclose(model.actuator_biasprm[:, 2], [-1, -1.5, -1])


@pytest.mark.parametrize("ending", ["</mujoco>", "  <actuator/>\n</mujoco>", "</mujoco>\n"])
def test_a_robot_without_actuators_gets_servos(tmp_path: Path, ending: str) -> None:
    text = INNER[: INNER.index("  <actuator>")] + ending
    path = tmp_path / "bare.xml"
    path.write_text(text)
    made = with_servos(path, kp=8, kd=0.2, effort=3)
    made.text.write(tmp_path / "new.xml")
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "new.xml"))
    assert [model.actuator(k).name for k in range(model.nu)] == ["shoulder", "elbow", "wrist"]
    np.testing.assert_allclose(model.actuator_forcerange, [[-3, 3]] * 3)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"kp": -1}, ("kp is -1", "at least 0")),
        ({"kp": 1, "joints": ["elbw"]}, ("'elbw'", "did you mean 'elbow'")),
        ({"kp": 1, "joints": ["("]}, ("no regular expression",)),
    ],
)
def test_what_cannot_be_done_is_refused(
    arm: Path, options: dict[str, object], words: tuple[str, ...]
) -> None:
    with pytest.raises(InputError) as refused:
        with_servos(arm, kd=1, **options)  # type: ignore[arg-type]
    for word in words:
        assert word in str(refused.value)


def test_servos_are_changed_only_by_name(arm: Path) -> None:
    only = arm.with_name("only.xml")
    only.write_text("".join(line for line in INNER.splitlines(True) if 'name="a"' not in line))
    lines = only.read_text().replace("<general", "<position").replace('gainprm="3"', "")
    only.write_text(lines.replace('dyntype="filter" dynprm="0.1" biastype="none"', ""))
    with pytest.raises(InputError, match=r"no joint has a torque motor.*--joint"):
        with_servos(only, kp=1, kd=1)
    assert with_servos(only, kp=1, kd=1, joints=[".*"]).joints == ("shoulder", "elbow", "wrist")


def test_another_kind_of_actuator_is_refused(arm: Path) -> None:
    arm.write_text(
        INNER.replace("<position", "<intvelocity").replace('dampratio="1"', 'actrange="-1 1"')
    )
    with pytest.raises(InputError, match="joint 'wrist' has an actuator that is neither"):
        with_servos(arm, kp=1, kd=1, joints=["wrist"])


def test_a_model_that_reads_files_stays_in_its_folder(arm: Path, tmp_path: Path) -> None:
    outer = arm.with_name("scene.xml")
    outer.write_text(OUTER.replace("</mujoco>", '  <include file="floor.xml"/>\n</mujoco>'))
    arm.with_name("floor.xml").write_text(
        '<mujoco><worldbody><geom type="plane" size="1 1 1"/></worldbody></mujoco>'
    )
    made = with_servos(outer, kp=1, kd=1)
    (tmp_path / "other").mkdir()
    with pytest.raises(InputError, match=r"reads 'floor.xml' beside .* in the folder"):
        made.text.write(tmp_path / "other" / "new.xml")
    with pytest.raises(InputError, match="this is the model itself"):
        made.text.write(outer)
