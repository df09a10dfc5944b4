"""A trotting quadruped's log leaves no gap to the model that made it, with its pose or without."""

import sys

import mujoco
import numpy as np
import pytest

from benchmarks.base_state import trot
from walkerkit import gap
from walkerkit.gap.recordings.imu import ACCELERATION, GYRO
from walkerkit.gap.recordings.recording import BASE
from walkerkit.gap.simulated_unit import Unit
from walkerkit.walkers.gait import Trot

MODULE = """
from benchmarks.base_state import servos
from walkerkit.walkers import Quadruped
def make():
    return Quadruped(actuators=servos())
"""


@pytest.fixture(scope="module")
def log():
    return trot(Trot(), 1.7, base="both")


@pytest.mark.parametrize("kept", ["pose", "imu"])
def test_its_own_log_leaves_no_gap(kept, log, tmp_path, monkeypatch):
    (tmp_path / "trotting_robot.py").write_text(MODULE, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "trotting_robot", raising=False)
    alone = {n: v for n, v in log.columns.items() if n not in BASE}
    recording = log if kept == "pose" else gap.Recording(name="trot", time=log.time, columns=alone)
    diagnosis = gap.compare("trotting_robot:make", [recording], n_threads=1)
    assert diagnosis.verdict == "no_gap"
    signals = diagnosis.gap.signals
    told = any("nobody measured the base's pose" in note for note in diagnosis.notes)
    assert told is (kept == "imu")
    if kept == "pose":
        assert {"base_position", "base_orientation"} < set(signals)
        assert "base_angular_velocity" not in signals
        return
    assert {"base_orientation", "base_angular_velocity"} < set(signals)
    assert "base_position" not in signals
    assert len([note for note in diagnosis.notes if "nobody measured" in note]) == 1
    for name in ("position", "base_orientation"):
        size = signals[name]
        assert size.before < 2 * np.hypot(size.noise_floor, size.numerical_floor)


def test_feet_come_and_go(log):
    contacts = np.stack([v for n, v in log.columns.items() if n.endswith("/contact")])
    assert contacts.shape[0] == 4
    assert ((contacts.mean(axis=1) > 0.3) & (contacts.mean(axis=1) < 0.95)).all()
    assert set(np.unique(contacts)) == {0.0, 1.0}


def test_a_unit_reads_what_mujoco_s_sensors_read():
    text = """<mujoco><option timestep="0.001" integrator="Euler"/><worldbody>
    <geom name="floor" type="plane" size="0 0 1"/><body name="trunk" pos="0 0 0.4"><freejoint/>
    <geom type="box" size="0.2 0.1 0.05" mass="2"/><site name="imu" pos="0.1 0.02 0.05" euler="20 0 90"/>
    <body pos="0.1 0 0"><joint name="knee" axis="0 1 0"/>
    <geom name="toe" type="capsule" fromto="0 0 0 0 0 -0.3" size="0.02" mass="0.5"/></body></body>
    </worldbody><sensor><gyro site="imu"/><accelerometer site="imu"/></sensor></mujoco>"""
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    data.qvel[:] = (0.3, -0.2, 0.1, 1.0, -2.0, 1.5, 3.0)
    qpos, qvel, changes, read, touched = [], [], [], [], []
    for _ in range(400):
        mujoco.mj_forward(model, data)
        read.append(data.sensordata.copy())
        touched.append(bool((data.contact.dist <= 0).any() and data.ncon))
        qpos.append(data.qpos.copy())
        qvel.append(data.qvel.copy())
        mujoco.mj_step(model, data)
        changes.append((data.qvel - qvel[-1]) / model.opt.timestep)
    columns = Unit(model, 0).columns(*(np.array(one) for one in (qpos, qvel, changes)))
    found = np.stack([columns[name] for name in (*GYRO, *ACCELERATION)], axis=1)
    np.testing.assert_allclose(found, read, atol=1e-6, rtol=1e-6)
    toe = columns["toe/contact"]
    assert 0 < toe.mean() < 1
    assert (toe <= touched).all()


def test_what_to_log_of_a_base_is_one_of_three():
    with pytest.raises(ValueError, match=r"base is 'imuu'.*'pose', 'imu' or 'both'"):
        trot(Trot(), 0.1, base="imuu")
