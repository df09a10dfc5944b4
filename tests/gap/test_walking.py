"""A trotting quadruped's log leaves no gap to the model that made it, with its pose or without."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from benchmarks.base_state import errors, trot
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.recordings.imu import ACCELERATION, GYRO
from walkerkit.gap.recordings.recording import BASE
from walkerkit.gap.recordings.segments import windows
from walkerkit.gap.recordings.state import with_more_noise
from walkerkit.gap.simulated_unit import Unit
from walkerkit.gap.simulation.base_estimate import with_known_base
from walkerkit.gap.simulation.channel import Channel, base_channels
from walkerkit.gap.simulation.feet import find_feet
from walkerkit.gap.simulation.floating import suited
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.phases import phases_of
from walkerkit.gap.simulation.replay import Replay, as_they_are
from walkerkit.gap.workflow import prepare
from walkerkit.walkers.gait import Trot


@pytest.fixture(scope="module")
def log():
    return trot(Trot(), 1.7, base="both").between(0.3, 1.7)


@pytest.fixture(scope="module")
def robot():
    """That of which the log is."""
    return load_robot("benchmarks.base_state:quadruped", floating=True)


def changes(robot, recording, other=None):
    """RMS by quantity of what a replay errs by, or differs by from that of another recording."""
    channels = [
        *(Channel(joint=joint, signal="position") for joint in recording.joints),
        *base_channels([recording]),
    ]
    replays = [Replay(robot, windows(one, 0.5), channels) for one in (recording, other) if one]
    first, *rest = as_they_are(replays, 1)
    wrong = first - (rest[0] if rest else replays[0].measured)
    squares = {}
    for c, channel in enumerate(channels):
        squares.setdefault(channel.quantity, []).append(np.mean(wrong[:, c] ** 2))
    return {name: float(np.sqrt(np.mean(some))) for name, some in squares.items()}


def test_its_own_log_leaves_no_gap_with_its_pose(log, robot):
    wrong = changes(robot, with_known_base(robot, suited(robot, log)))
    assert set(wrong) == {"position", "base_position", "base_orientation"}
    # A quarter of the timestep changes the joints of this trot by 2.5 mrad.
    assert max(wrong.values()) < 3e-3


def test_nor_with_its_inertial_unit_alone_above_what_the_estimate_may_be_wrong_by(log, robot):
    alone = {n: v for n, v in log.columns.items() if n not in BASE}
    known = with_known_base(robot, suited(robot, replace(log, columns=alone)))
    wrong = changes(robot, known)
    assert set(wrong) == {"position", "base_orientation", "base_angular_velocity"}
    floor = changes(robot, known, with_more_noise(known, (0, 0)))
    for name, size in wrong.items():
        assert size < 2 * floor[name], name
    assert floor["position"] < 5e-3


def test_slips_that_every_stride_repeats_do_not_add_up_to_a_tilt(robot):
    """Of an ideal unit: 0.9° when each stride counted as a witness of its own."""
    found = errors(robot, trot(Trot(), 4.0, base="both"), contacts=True)
    assert np.rad2deg(np.sqrt(np.mean(found.tilt**2))) < 0.4
    assert found.within > 0.9


def test_feet_come_and_go(log):
    contacts = np.stack([v for n, v in log.columns.items() if n.endswith("/contact")])
    assert contacts.shape[0] == 4
    assert ((contacts.mean(axis=1) > 0.3) & (contacts.mean(axis=1) < 0.95)).all()
    assert set(np.unique(contacts)) == {0.0, 1.0}


def test_a_unit_reads_what_mujoco_s_sensors_read():
    text = """<mujoco><option timestep="0.001" integrator="Euler"/><worldbody>
    <geom name="floor" type="plane" size="0 0 1"/><body name="trunk" pos="0 0 0.4"><freejoint/>
    <geom type="box" size="0.2 0.1 0.05" mass="2"/>
    <site name="imu" pos="0.1 0.02 0.05" euler="20 0 90"/>
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


def test_the_typical_phase_is_half_a_stride_of_a_trot_by_postures_and_by_foot_sensors(log, robot):
    known = suited(robot, log)
    half = 0.5 / Trot().frequency
    low = np.median(phases_of(robot, known))
    assert low == pytest.approx(half, rel=0.35)
    feet = find_feet(robot.model, robot.base)
    swing = np.sin(2 * np.pi * known.time / 0.8) > 0
    sensors = {
        f"{foot.name}/contact": (swing ^ (k % 2)).astype(float) for k, foot in enumerate(feet)
    }
    told = replace(known, columns={**known.columns, **sensors})
    assert np.median(phases_of(robot, told)) == pytest.approx(0.4, abs=0.02)


def test_the_phase_of_feet_that_stay_down_has_no_bound(log, robot):
    known = suited(robot, log)
    still = {name: np.full_like(values, values[0]) for name, values in known.columns.items()}
    assert (phases_of(robot, replace(known, columns=still)) == np.inf).all()
    assert not phases_of(replace(robot, base=None), known).size


def test_replays_of_a_robot_that_walks_restart_before_the_next_foot_lands(log):
    def window(**given):
        setup = prepare(
            load_experiments("benchmarks.base_state:quadruped", [log]), n_threads=1, **given
        )
        return setup.window, setup.walks

    length, walks = window(window=None)
    assert walks
    assert length == pytest.approx(0.25 / Trot().frequency, rel=0.35)
    assert window(window=0.4) == (0.4, True)
