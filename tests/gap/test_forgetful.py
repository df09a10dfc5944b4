"""Robots whose replays forget where they started: refused, with a window that tells."""

import re

import mujoco
import numpy as np
import pytest

from walkerkit import gap

ROD = """<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <worldbody>
    <body>
      <joint name="hip" axis="0 1 0" damping="0.01"/>
      <geom type="capsule" fromto="0 0 0 0 0 0.3" size="0.02" mass="1"/>
    </body>
  </worldbody>
  <actuator><motor name="hip" joint="hip"/></actuator>
</mujoco>
"""
RATE = 250.0


def balanced(noise: float) -> gap.Recording:
    """A rod that a motor balances, by 250 readings a second without noise; its log has some."""
    model = mujoco.MjModel.from_xml_string(ROD)
    data, rows = mujoco.MjData(model), []
    for _ in range(2000):
        wanted = 0.05 * np.sin(2 * np.pi * 0.7 * data.time)
        data.ctrl[0] = -6 * (data.qpos[0] - wanted) - 0.5 * data.qvel[0]
        rows.append((data.time, data.qpos[0], data.ctrl[0]))
        mujoco.mj_step(model, data, round(1 / RATE / model.opt.timestep))
    time, position, effort = np.array(rows).T
    position = position + noise * np.random.default_rng(0).standard_normal(len(time))
    columns = {"hip/position": position, "hip/effort_target": effort}
    return gap.Recording(name="balanced", time=time, columns=columns)


@pytest.mark.parametrize("noise", [0.003, 0.01])
def test_what_falls_from_the_noise_of_its_starts_is_refused_with_a_window_that_tells(
    tmp_path, noise
):
    model = tmp_path / "rod.xml"
    model.write_text(ROD)
    with pytest.raises(gap.InputError, match=r"every 0.5 s tell nothing.*'hip'") as refused:
        gap.compare(model, [balanced(noise)], n_threads=1)
    window = float(re.search(r"--window ([\d.]+)\)", str(refused.value))[1])
    assert gap.compare(model, [balanced(noise)], window=window, n_threads=1).verdict == "no_gap"


def test_what_tells_little_is_not_refused(tmp_path):
    model = tmp_path / "rod.xml"
    model.write_text(ROD)
    assert gap.compare(model, [balanced(1e-3)], n_threads=1).verdict == "no_gap"
