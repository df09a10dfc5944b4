"""The filter's derivatives, and what it makes of measurements without error."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from walkerkit.gap.simulation import base_filter
from walkerkit.gap.simulation.base_filter import GYRO_BIAS, Motion, P, Settings, Stances, V, smooth

G = np.array([0.0, 0.0, -9.81])
SETTINGS = Settings(
    gyro=0.005,
    acceleration=0.1,
    gyro_bias=0.01,
    acceleration_bias=0.05,
    gyro_drift=1e-4,
    acceleration_drift=1e-3,
    attitude=0.02,
    height=0.005,
    up=np.array([0.0, 0.0, 1.0]),
    gravity=G,
)
FEET = np.array([[0.2, 0.1, -0.3], [0.2, -0.1, -0.3], [-0.2, 0.1, -0.3], [-0.2, -0.1, -0.3]])


def swaying(n=200, step=0.01):
    """A trunk that sways over feet that stand: its motion as the filter takes it, and the truth."""
    fine = 20
    time = step / fine * np.arange(fine * (n - 1) + 1)
    angles = 0.1 * np.stack([np.sin(3 * time), np.sin(2 * time + 1), np.sin(time)], axis=1)
    place = 0.03 * np.stack([np.sin(2 * time), np.sin(3 * time), np.sin(4 * time)], axis=1)
    place[:, 2] += 0.3
    turned = Rotation.from_euler("xyz", angles)
    h = step / fine
    spin = np.vstack([(turned[:-1].inv() * turned[1:]).as_rotvec() / h, np.zeros((1, 3))])
    speed = np.gradient(place, h, axis=0)
    pushed = turned.inv().apply(np.gradient(speed, h, axis=0) - G)
    at = slice(None, None, fine)

    def means(values):
        return values[:-1].reshape(n - 1, fine, 3).mean(axis=1)

    matrices, world = turned.as_matrix()[at], np.array([*FEET]) * (1, 1, 0)
    lever = world[None] - place[at, None]
    point = np.einsum("nji,nfj->nfi", matrices, lever)
    rate = spin[at]
    moving = -np.cross(rate[:, None], point) - turned[at].inv().apply(speed[at])[:, None]
    motion = Motion(
        step=step,
        turning=means(spin),
        pushing=means(pushed),
        spinning=rate,
        up=np.full((n, 3), np.nan),
        point=point,
        moving=moving,
        level=0.0,
        start=np.eye(3),
    )
    return motion, matrices, speed[at]


def stances(n, value=1e-4):
    return Stances(
        stands=np.ones((n, 4), dtype=bool),
        slipping=np.full((n, 4), value),
        sinking=np.full((n, 4), value),
    )


def test_errors_are_carried_as_finite_differences_say():
    rng = np.random.default_rng(0)
    motion, matrices, _ = swaying(3)
    motion = replace(motion, turning=rng.standard_normal((2, 3)))
    vector = rng.standard_normal(16)
    rotation, after, carry = base_filter._carried(motion, SETTINGS, 0, matrices[1], vector)
    found, small = np.empty_like(carry), 1e-6
    for k in range(len(carry)):
        off = small * np.eye(len(carry))[k]
        other = Rotation.from_rotvec(off[:3]).as_matrix() @ matrices[1]
        turned, moved, _ = base_filter._carried(motion, SETTINGS, 0, other, vector + off[3:])
        turn = Rotation.from_matrix(turned @ rotation.T).as_rotvec()
        found[:, k] = np.concatenate([turn, moved - after]) / small
    np.testing.assert_allclose(found, carry, atol=1e-3)


def test_measurements_without_error_give_the_truth():
    motion, matrices, speed = swaying()
    found = smooth(replace(motion, start=matrices[0]), stances(200), SETTINGS)
    turn = Rotation.from_matrix(found.rotation @ matrices.transpose(0, 2, 1)).as_rotvec()
    assert np.abs(turn[:, :2]).max() < 2e-3
    assert np.abs(found.of(V) - speed).max() < 0.01
    assert np.abs(found.of(P)[:, 2] - 0.3).max() < 0.035
    np.testing.assert_allclose(found.foot_velocity(motion), 0, atol=0.01)
    np.testing.assert_allclose(found.foot_heights(motion, SETTINGS), 0, atol=1e-3)


def test_feet_that_stand_tell_the_gyroscope_s_bias():
    motion, matrices, _ = swaying()
    bias = np.array([0.01, -0.012, 0.008])
    motion = replace(
        motion,
        start=matrices[0],
        turning=motion.turning + bias,
        spinning=motion.spinning + bias,
    )
    found = smooth(motion, stances(200), SETTINGS)
    np.testing.assert_allclose(found.of(GYRO_BIAS)[-1], bias, atol=2e-3)
    std = np.sqrt(found.covariance[-1].diagonal()[GYRO_BIAS])
    assert (std < 0.5 * SETTINGS.gyro_bias).all()


def test_what_comes_later_makes_nothing_less_sure():
    motion, matrices, _ = swaying()
    motion = replace(motion, start=matrices[0])
    whole = smooth(motion, stances(200), SETTINGS).covariance.diagonal(axis1=1, axis2=2)
    few = stances(200)
    few.stands[100:] = False
    half = smooth(motion, few, SETTINGS).covariance.diagonal(axis1=1, axis2=2)
    assert (whole[:100, :6] <= half[:100, :6] * (1 + 1e-6)).all()


@pytest.mark.parametrize("angle", [0.0, 0.2])
def test_the_unit_s_own_attitude_counts_where_it_has_one(angle):
    motion, matrices, _ = swaying()
    up = np.einsum("nji,j->ni", matrices, [0.0, 0.0, 1.0])
    start = Rotation.from_rotvec([angle, 0, 0]).as_matrix() @ matrices[0]
    none = Stances(
        stands=np.zeros((200, 4), dtype=bool), slipping=np.ones((200, 4)), sinking=np.ones((200, 4))
    )
    found = smooth(replace(motion, up=up, start=start), none, SETTINGS)
    seen = np.einsum("nji,j->ni", found.rotation, [0.0, 0.0, 1.0])
    assert np.linalg.norm(seen - up, axis=1).max() < 0.02
