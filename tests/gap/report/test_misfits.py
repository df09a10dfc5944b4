"""A hand on the robot is told of with the option that leaves it out, which then works."""

import re

import numpy as np
import pytest

from walkerkit import gap
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.rehearse import rehearse

ARM = """
<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body><joint name="shaft" axis="0 1 0" range="-1.6 1.6" damping="0.05"
    armature="0.005"/><geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/></body>
  </worldbody><actuator><position joint="shaft" kp="20" kv="0.6"/></actuator></mujoco>
"""


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Two files of an arm; somebody holds it for a moment in the second."""
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.xml").write_text(ARM, encoding="utf-8")
    still, held = rehearse(folder / "arm.xml", [], seed=1, seconds=6).recordings[:2]
    still.save(folder / "still.csv")
    push = np.where((held.time > 3.1) & (held.time < 3.5), 0.2, 0.0)
    columns = {**held.columns, "shaft/position": held.columns["shaft/position"] + push}
    columns.pop("shaft/velocity")
    Recording(name="held", time=held.time, columns=columns).save(folder / "held.csv")
    return folder


def test_the_span_is_told_with_the_option_that_leaves_it_out(logs):
    files = [logs / "still.csv", logs / "held.csv"]
    found = gap.compare(logs / "arm.xml", files)
    (note,) = (n for n in found.notes if "misfit" in n)
    assert "1 span of time misfits up to" in note
    assert "a hand, a fall or drives that were off" in note
    options = re.findall(r"--skip (\S+)", note)
    assert options == [f"{logs / 'held.csv'}=3:3.6"]
    again = gap.compare(logs / "arm.xml", files, skip=options)
    assert again.gap.position.before < 0.3 * found.gap.position.before
    assert not any("misfit" in n for n in again.notes)
    assert any("held: 3 to 3.6 s was skipped, as asked" in n for n in again.notes)


def test_a_log_that_misfits_alike_has_no_such_span(logs):
    found = gap.compare(logs / "arm.xml", logs / "still.csv")
    assert not any("misfit" in n for n in found.notes)
