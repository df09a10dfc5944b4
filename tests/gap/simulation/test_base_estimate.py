"""The base's state without its pose, held to the truth of robots of other physics."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from benchmarks.base_state import errors
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.base_state import LINEAR
from walkerkit.gap.recordings.imu import ACCELERATION, GYRO, IMU_QUATERNION
from walkerkit.gap.recordings.recording import BASE, QUATERNION
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.standing import standing_targets, write_standing
from walkerkit.gap.simulation.base_estimate import with_estimated_base, with_known_base
from walkerkit.gap.simulation.floating import suited
from walkerkit.gap.simulation.load_robot import load_robot


@pytest.fixture(scope="module", autouse=True)
def one_thread():
    with threadpool_limits(1):
        yield


@pytest.fixture(scope="module")
def stood(tmp_path_factory):
    """A quadruped that steps on rehearsed hardware, and its log with the truth beside it."""
    path = write_standing(tmp_path_factory.mktemp("stood"))
    targets = standing_targets(np.random.default_rng(2), seconds=1.8)["steps"]
    (log,) = run_hardware(path, [targets], seed=2, base="truth")
    return load_robot(path), log


def without(log, *names):
    return replace(log, columns={n: v for n, v in log.columns.items() if n not in names})


def imu_alone(log):
    return without(log, *BASE)


def test_standing_attitude_and_velocity_are_known(stood):
    for contacts in (True, False):
        found = errors(*stood, contacts)
        assert np.rad2deg(np.sqrt(np.mean(found.tilt**2))) < 0.5
        assert np.sqrt(np.mean(found.speed**2)) < 0.01
        assert found.within > 0.8


@pytest.mark.parametrize("lost", [0.0, 0.1])
def test_times_that_jitter_and_rows_that_are_lost_change_little(stood, lost):
    robot, log = stood
    rng = np.random.default_rng(1)
    kept = rng.random(len(log.time)) >= lost
    late = np.clip(5e-5 * rng.standard_normal(len(log.time)), -1e-4, 1e-4)
    uneven = replace(
        log,
        time=(log.time + late)[kept],
        columns={name: values[kept] for name, values in log.columns.items()},
    )
    for contacts in (True, False):
        found = errors(robot, uneven, contacts)
        assert np.rad2deg(np.sqrt(np.mean(found.tilt**2))) < 0.5
        assert np.sqrt(np.mean(found.speed**2)) < 0.02


def test_forces_in_any_unit_do_as_contacts(stood):
    robot, log = stood
    rng = np.random.default_rng(0)
    forces = {
        name.replace("contact", "force"): 230 * v + 12 + 3 * rng.standard_normal(len(v))
        for name, v in log.columns.items()
        if name.endswith("/contact")
    }
    own = {n: v for n, v in log.columns.items() if not n.endswith("/contact")}
    found = errors(robot, replace(log, columns=own | forces), contacts=False)
    assert np.rad2deg(np.sqrt(np.mean(found.tilt**2))) < 0.5
    assert np.sqrt(np.mean(found.speed**2)) < 0.01
    estimated = with_estimated_base(robot, imu_alone(replace(log, columns=own | forces)))
    assert "the logged contacts" in estimated.notes[-1]


def test_a_unit_s_attitude_alone_is_enough(stood):
    robot, log = stood
    quaternion = np.stack([log.columns[name] for name in QUATERNION], axis=1)
    signs = (-1.0) ** (np.arange(len(quaternion)) // 100)  # either quaternion of a rotation
    own = dict(zip(IMU_QUATERNION, (quaternion * signs[:, None]).T, strict=True))
    given = without(imu_alone(log), *GYRO, *ACCELERATION)
    found = with_estimated_base(robot, replace(given, columns=given.columns | own))
    for name in LINEAR:
        assert np.sqrt(np.mean((found.columns[name] - log.columns[name]) ** 2)) < 0.05


def test_how_the_unit_is_mounted_is_read_from_its_site(stood, tmp_path):
    robot, log = stood
    turned = Rotation.from_euler("z", 90, degrees=True)
    spec = robot.spec.copy()
    site = spec.site("imu")
    site.quat = np.roll(turned.as_quat(), 1)
    path = tmp_path / "turned.xml"
    path.write_text(spec.to_xml())
    columns = dict(imu_alone(log).columns)
    for names in (GYRO, ACCELERATION):
        values = turned.inv().apply(np.stack([columns[name] for name in names], axis=1))
        columns |= dict(zip(names, values.T, strict=True))
    expected = with_estimated_base(robot, imu_alone(log))
    found = with_estimated_base(load_robot(path), replace(imu_alone(log), columns=columns))
    for name in (*QUATERNION, *LINEAR):
        np.testing.assert_allclose(found.columns[name], expected.columns[name], atol=1e-6)


def test_only_what_nobody_measured_is_estimated(stood):
    robot, log = stood
    assert with_known_base(robot, suited(robot, log)).errors == {}
    assert {*GYRO, "FL_foot/contact"} <= {*suited(robot, log).unused}
    once = with_known_base(robot, suited(robot, imu_alone(log)))
    assert with_known_base(robot, once) is once
    again = with_known_base(robot, once, again=True)
    assert len(again.notes) == len(once.notes)
    np.testing.assert_array_equal(again.columns[LINEAR[0]], once.columns[LINEAR[0]])


def test_a_foot_that_the_model_lacks_is_told(stood):
    robot, log = stood
    renamed = {n.replace("FL_foot/", "FL_fot/"): v for n, v in imu_alone(log).columns.items()}
    found = suited(robot, replace(log, columns=renamed))
    assert any("'FL_fot', did you mean 'FL_foot'" in n or "FL_fot" in n for n in found.notes)
    assert "FL_fot/contact" in found.unused


def test_joints_alone_are_refused_with_what_to_log(stood):
    robot, log = stood
    for more in ((), GYRO):
        kept = without(imu_alone(log), *(n for n in (*GYRO, *ACCELERATION) if n not in more))
        with pytest.raises(InputError, match="base/imu_acceleration_x") as refused:
            suited(robot, kept)
        assert len(str(refused.value).splitlines()) == 1
        assert ("imu_angular_velocity_x' alone does not tell" in str(refused.value)) is bool(more)
