"""What an inertial unit and foot sensors log, and what of it is enough."""

import numpy as np
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.imu import (
    ACCELERATION,
    GYRO,
    IMU_QUATERNION,
    has_imu,
    imu_columns,
    of_feet,
)
from walkerkit.gap.recordings.recording import Recording

ROWS = 20


def log(*names: str, **columns: np.ndarray) -> Recording:
    zeros = np.zeros(ROWS)
    more = dict.fromkeys(names, zeros) | {"base/imu_quaternion_w": 1 + zeros} | columns
    joint = {"knee/position": zeros, "knee/position_target": zeros}
    chosen = {name: more.get(name, zeros) for name in (*names, *columns)}
    return Recording(name="log", time=0.01 * np.arange(ROWS), columns=joint | chosen)


@pytest.mark.parametrize(
    ("names", "enough"),
    [
        ((*GYRO, *ACCELERATION), True),
        (IMU_QUATERNION, True),
        ((*IMU_QUATERNION, *GYRO), True),
        (GYRO, False),
        (ACCELERATION, False),
        ((), False),
    ],
)
def test_a_unit_tells_enough_with_its_attitude_or_with_what_makes_it(names, enough):
    assert has_imu(log(*names)) is enough
    assert set(imu_columns(log(*names))) == set(names)


@pytest.mark.parametrize("whole", [IMU_QUATERNION, GYRO, ACCELERATION])
def test_a_part_of_a_vector_is_refused_by_what_it_lacks(whole):
    for lacking in whole:
        with pytest.raises(InputError, match=f"lacks '{lacking}'. Log all {len(whole)} columns"):
            log(*(name for name in whole if name != lacking))


def test_a_quaternion_of_a_unit_has_norm_1():
    with pytest.raises(InputError, match=r"imu_quaternion_w…z' have norm 0\.5"):
        log(*IMU_QUATERNION[1:], **{IMU_QUATERNION[0]: np.full(ROWS, 0.5)})


def test_feet_and_units_survive_a_file(tmp_path):
    given = log("FL_foot/contact", "FL_foot/force", "FR_foot/force", *GYRO, *ACCELERATION)
    assert of_feet(given) == {"FL_foot": ("contact", "force"), "FR_foot": ("force",)}
    given.save(tmp_path / "log.csv")
    again = Recording.load(tmp_path / "log.csv")
    assert again.columns.keys() == given.columns.keys()
    assert again.joints == ("knee",)


def test_parts_keep_how_well_the_base_is_known():
    std = np.arange(ROWS, dtype=float)
    whole = Recording(
        name="log", time=log().time, columns=log().columns, errors={"base/orientation_x": std}
    )
    part = whole.between(0.05, 0.1)
    np.testing.assert_array_equal(part.errors["base/orientation_x"], std[5:10])
