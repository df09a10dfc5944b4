from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import pytest

from walkerkit.gap import InputError
from walkerkit.gap.own_robot.hang import hung

BIPED = """\
<mujoco model="biped">
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>{floor}
    <body name="trunk" pos="0.1 0 0.35" quat="1 0 0 0">
      {free}
      <geom type="box" size="0.1 0.1 0.05" mass="3"/>
      <body name="left" pos="0 0.08 0">
        <joint name="left" axis="0 1 0" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.03" mass="0.5"/>
      </body>
      <body name="right" pos="0 -0.08 0">
        <joint name="right" axis="0 1 0" damping="0.1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.03" mass="0.5"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="left" kp="30" kv="1"/><position joint="right" kp="30" kv="1"/>
  </actuator>
  <keyframe>
    <key name="home" qpos="0 0 0.3 1 0 0 0 0.2 -0.2" qvel="0 0 0 0 0 0 1 2" ctrl="0.2 -0.2"/>
  </keyframe>
</mujoco>
"""
FLOOR = '\n    <geom type="plane" size="0 0 0.1"/>'


def write(tmp_path: Path, floor: str = FLOOR, free: str = "<freejoint/>") -> Path:
    path = tmp_path / "biped.xml"
    path.write_text(BIPED.format(floor=floor, free=free))
    return path


@pytest.mark.parametrize("free", ["<freejoint/>", '<joint name="root" type="free"></joint>'])
def test_it_hangs_clear_of_the_floor_and_moves_as_before(tmp_path: Path, free: str) -> None:
    made = hung(write(tmp_path, free=free))
    (path,) = made.text.write(tmp_path / "hung.xml")
    model = mujoco.MjModel.from_xml_path(str(path))
    assert (model.nq, model.nv) == (2, 2)
    assert made.body == "trunk"
    np.testing.assert_array_equal(model.key_qpos, [[0.2, -0.2]])
    np.testing.assert_array_equal(model.key_qvel, [[1, 2]])
    assert set(made.excluded) == {("trunk", "left"), ("trunk", "right")}
    data = mujoco.MjData(model)
    for angle in np.linspace(-np.pi, np.pi, 40):
        data.qpos[:] = angle, -angle
        mujoco.mj_forward(model, data)
        assert data.ncon == 0
        assert data.geom_xpos[:, 2].min() > -1e-9
    # The same motion as of a robot that was mounted by hand, with collisions off.
    by_hand = BIPED.format(floor="", free="").replace(
        "<geom ", '<geom contype="0" conaffinity="0" '
    )
    other = mujoco.MjModel.from_xml_string(by_hand[: by_hand.index("  <keyframe>")] + "</mujoco>")
    moved, expected = mujoco.MjData(model), mujoco.MjData(other)
    for k in range(500):
        moved.ctrl[:] = expected.ctrl[:] = np.sin(0.01 * k)
        mujoco.mj_step(model, moved)
        mujoco.mj_step(other, expected)
    np.testing.assert_allclose(moved.qpos, expected.qpos, atol=1e-12)


def test_all_other_bytes_stay(tmp_path: Path) -> None:
    path = write(tmp_path, floor="")
    made = hung(path)
    assert made.height == 0.35  # without a ground, it stays where it is
    text = made.text.write(tmp_path / "hung.xml")[0].read_text()
    expected = BIPED.format(floor="", free="<freejoint/>").replace("      <freejoint/>\n", "")
    expected = expected.replace("0 0 0.3 1 0 0 0 0.2 -0.2", "0.2 -0.2")
    expected = expected.replace("0 0 0 0 0 0 1 2", "1 2")
    pairs = "".join(f'    <exclude body1="trunk" body2="{b}"/>\n' for b in ("left", "right"))
    assert text == expected.replace("</mujoco>", f"  <contact>\n{pairs}  </contact>\n</mujoco>")


def test_the_height_may_be_given(tmp_path: Path) -> None:
    made = hung(write(tmp_path), height=2.5)
    assert 'pos="0.1 0 2.5"' in made.text.write(tmp_path / "hung.xml")[0].read_text()


def test_a_robot_that_hangs_is_told(tmp_path: Path) -> None:
    path = tmp_path / "mounted.xml"
    text = BIPED.format(floor="", free="")
    path.write_text(text[: text.index("  <keyframe>")] + "</mujoco>")
    with pytest.raises(InputError, match="no robot floats in it"):
        hung(path)
