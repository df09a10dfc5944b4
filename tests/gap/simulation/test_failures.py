"""Single simulations that fail: the others go on, and what MuJoCo says of it is counted."""

from __future__ import annotations

import contextlib
from pathlib import Path

import mujoco
import numpy as np
import pytest

from walkerkit import gap
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.report.notes import warning_notes
from walkerkit.gap.simulation.size import check_size
from walkerkit.walkers.batch import LockStep, counted_warnings

SERVO = """
<mujoco model="servo">
  <compiler angle="radian"/>
  <option timestep="0.01" integrator="Euler"/>
  <worldbody>
    <body>
      <joint name="knee" axis="0 1 0" armature="0.002" damping="0.02"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.05"/>
    </body>
  </worldbody>
  <actuator><position joint="knee" kp="130"/></actuator>
</mujoco>
"""
STEPS = 60


def rollout(model: mujoco.MjModel, n_sims: int, **fields: np.ndarray) -> tuple[np.ndarray, ...]:
    batch = LockStep(model, n_sims, fields=fields, n_threads=1)
    data = mujoco.MjData(model)
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    ctrl = 0.3 * np.sin(np.arange(STEPS) / 9)[None, :, None].repeat(n_sims, axis=0)
    done = batch.rollout(np.tile(state, (n_sims, 1)), ctrl=ctrl, record=("qpos",))
    return done.records["qpos"], done.failed


def test_a_simulation_that_diverges_leaves_the_others_as_they_are(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    model = mujoco.MjModel.from_xml_string(SERVO)
    with contextlib.chdir(tmp_path), counted_warnings() as warned:
        # The second is pushed by its own damping, the third has a number that is none.
        damping = np.array([[0.02], [-500.0], [np.nan], [0.03]])
        both, failed = rollout(model, 4, dof_damping=damping)
        alone, _ = rollout(model, 2, dof_damping=damping[[0, 3]])
    assert failed.tolist() == [False, True, True, False]
    assert both[[0, 3]].tobytes() == alone.tobytes()
    assert np.isnan(both[1:3]).all()
    assert sum(warned.values()) >= 2
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


def test_contacts_that_explode_are_counted_and_bounded(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Forty balls in one place, in an arena that holds few of their contacts."""
    ball = '<body><freejoint/><geom size="0.1" mass="1e-4" solref="0.002 0.01"/></body>'
    model = mujoco.MjModel.from_xml_string(
        SERVO.replace("</worldbody>", 40 * ball + "</worldbody>").replace(
            "<option", '<size memory="300K"/><option'
        )
    )
    with contextlib.chdir(tmp_path), counted_warnings() as warned:
        rollout(model, 2)
    assert {"too many contacts", "too many constraints"} & set(warned)
    assert capfd.readouterr() == ("", "")
    assert list(tmp_path.iterdir()) == []


def test_the_notes_say_what_was_warned_of(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A loop at its limit: the model itself goes beyond it, as do gains that are tried."""
    (tmp_path / "servo.xml").write_text(SERVO)
    time = np.arange(150) / 100
    columns = {
        "knee/position_target": 0.3 * np.sin(5 * time),
        "knee/position": 0.25 * np.sin(5 * time - 0.1),
    }
    with contextlib.chdir(tmp_path):
        result = gap.diagnose(
            "servo.xml",
            [Recording(name=name, time=time, columns=columns) for name in "ab"],
            effects=["position_gain", "armature", "velocity_gain"],
            n_threads=1,
        )
    said = [note for note in result.diagnosis.notes if note.startswith("MuJoCo warned")]
    assert len(said) == 1
    assert "bad acceleration" in said[0]
    assert capfd.readouterr() == ("", "")
    assert [path.name for path in tmp_path.iterdir()] == ["servo.xml"]


def test_no_warnings_no_note() -> None:
    assert warning_notes({}) == ()
    (note,) = warning_notes({"bad velocity": 3, "bad acceleration": 12})
    assert "bad acceleration 12, bad velocity 3" in note


def test_what_cannot_fit_into_memory_is_refused_before_it_is_made() -> None:
    time = np.arange(0, 3600, 0.1)
    columns = {"knee/position": np.sin(time), "knee/position_target": np.sin(time)}
    hour = Recording(name="hour", time=time, columns=columns)
    model = mujoco.MjModel.from_xml_string(SERVO)
    check_size(model, "servo.xml", [hour])
    model.opt.timestep = 1e-6
    with pytest.raises(gap.InputError, match=r"servo.xml: 3600 s .* 3.6e\+09 steps.* GiB.*longer"):
        check_size(model, "servo.xml", [hour])


def test_a_diagnosis_refuses_it_too(tmp_path: Path) -> None:
    (tmp_path / "servo.xml").write_text(SERVO.replace('"0.01"', '"1e-10"'))
    time = np.arange(150) / 100
    columns = {"knee/position": np.sin(time), "knee/position_target": np.sin(time)}
    with pytest.raises(gap.InputError, match="GiB at once"):
        gap.diagnose(tmp_path / "servo.xml", [Recording(name="a", time=time, columns=columns)])
