"""Poses that leave the feet where they are, and targets that hold a robot in them."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest

from tests.gap.standing.robots import write_four_legs, write_two_legs
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.standing.loads import asked
from walkerkit.gap.standing.reach import Reach
from walkerkit.gap.standing.simulated import sent, simulated
from walkerkit.gap.standing.standing_pose import Stand, find_stand


@pytest.fixture(scope="module", params=[write_four_legs, write_two_legs])
def stand(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Stand:
    path = request.param(tmp_path_factory.mktemp("robot"))
    return find_stand(load_robot(path), n_threads=1)


def test_feet_stay_and_the_base_goes_where_it_is_wanted(stand: Stand) -> None:
    rng = np.random.default_rng(0)
    shift, turn = rng.uniform(-0.02, 0.02, (2, 5, 3))
    shift[:, 2] -= 0.03
    lifted = np.zeros((5, len(stand.soles)))
    lifted[3:, 0] = 0.02
    reach = Reach(stand)
    poses = reach.poses(shift, turn, lifted)
    assert reach.worst < 1e-4
    for t, qpos in enumerate(poses):
        data = stand.at(qpos)
        np.testing.assert_allclose(qpos[:3], stand.qpos[:3] + shift[t])
        for f, (sole, at) in enumerate(zip(stand.soles, stand.points, strict=True)):
            up = lifted[t, f] * np.array([0, 0, 1])
            np.testing.assert_allclose(sole.where(data), at + up, atol=1e-4)


def test_what_is_out_of_reach_is_known_to_be(stand: Stand) -> None:
    reach = Reach(stand)
    reach.poses(np.array([[0, 0, 0.3]]), np.zeros((1, 3)), np.zeros((1, len(stand.soles))))
    assert reach.worst > 0.05


def test_efforts_balance_what_acts_on_the_robot(stand: Stand) -> None:
    """With them and the forces of the ground that they leave, the base has no acceleration."""
    count = len(stand.soles)
    still = np.tile(stand.qpos, (3, 1))
    efforts = asked(stand, still, 0.01, np.ones((3, count)))[1]
    model, data = stand.robot.model, mujoco.MjData(stand.robot.model)
    data.qpos[:] = stand.qpos
    mujoco.mj_forward(model, data)
    applied = np.zeros(model.nv)
    applied[[joint.dof for joint in stand.joints]] = efforts
    rows = []
    for sole in stand.soles:
        for point in sole.where(data):
            jacobian = np.zeros((3, model.nv))
            mujoco.mj_jac(model, data, jacobian, None, point, sole.body)
            rows.append(jacobian)
    left = data.qfrc_bias - data.qfrc_passive - applied
    pushes = np.concatenate(rows)
    forces = np.linalg.lstsq(pushes.T, left, rcond=1e-9)[0]
    np.testing.assert_allclose(pushes.T @ forces, left, atol=1e-6)
    weight = 9.81 * model.body_subtreemass[stand.base.id]
    assert forces.reshape(-1, 3)[:, 2].sum() == pytest.approx(weight)


def test_the_ground_pushes_as_much_as_the_robot_weighs_under_its_centre(stand: Stand) -> None:
    time = np.arange(0.0, 0.6, 0.01)
    held = {
        joint.name: np.full(len(time), target)
        for joint, target in zip(stand.joints, stand.targets, strict=True)
    }
    log = sent(stand.robot, stand.base, stand.qpos, time, held)
    (ran,) = simulated([log], stand.robot, stand.base, stand.variants.trials, n_threads=1)
    assert ran.force.shape[0] == len(stand.variants.names) == 9
    weight = 9.81 * stand.robot.model.body_subtreemass[stand.base.id]
    heavier = [1.15 if "payload +15%" in name else 0.95 for name in stand.variants.names[1:]]
    np.testing.assert_allclose(ran.force[:, -1, 2] / weight, [1.0, *heavier], atol=0.02)
    np.testing.assert_allclose(ran.pressure(stand.level)[0, -1], stand.centre, atol=2e-3)
