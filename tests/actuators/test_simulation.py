"""One physics, a batch and plain MuJoCo, seen alike."""

from __future__ import annotations

import mujoco
import numpy as np
import pytest
from dm_control import mjcf, suite
from mujoco.batch import Batch

from tests.actuators.robots import compiled, robot
from walkerkit.actuators.simulation import Simulation, indexer


@pytest.fixture
def physics():
    return compiled(robot())


def test_everything_that_is_a_simulation(physics):
    model, data = physics.model.ptr, physics.data.ptr
    for one in (physics, (physics.model, physics.data), (model, data)):
        simulation = Simulation.of(one)
        assert simulation.model is model
        assert simulation.batch_shape == ()
        assert np.shares_memory(simulation.state("qpos"), data.qpos)
    assert Simulation.of(suite.load("pendulum", "swingup").physics).batch_shape == ()
    batch = Batch(model, 3, 1)

    class Environments:
        pass

    environments = Environments()
    environments.batch = batch
    for many in (batch, environments):
        simulation = Simulation.of(many)
        assert simulation.model is model
        assert simulation.batch_shape == (3,)
        assert np.shares_memory(simulation.state("qpos"), batch.state)


@pytest.mark.parametrize("wrong", [None, 3, "physics", (1, 2)])
def test_what_is_none(wrong):
    with pytest.raises(TypeError, match="physics should be a dm_control Physics, a mujoco"):
        Simulation.of(wrong)


def test_swapped_pair(physics):
    with pytest.raises(TypeError, match=r"pair \(MjModel, MjData\)"):
        Simulation.of((physics.data, physics.model))


def test_state_is_live(physics):
    simulation = Simulation.of(physics)
    qpos, qvel = simulation.state("qpos"), simulation.state("qvel")
    simulation.state("ctrl")[:] = 0.7
    assert physics.data.ctrl[0] == 0.7
    physics.step(5)
    np.testing.assert_array_equal(qpos, physics.data.qpos)
    assert (qvel != 0).any()
    batch = Batch(physics.model.ptr, 2, 1)
    simulation = Simulation.of(batch)
    position = simulation.state("qpos")
    simulation.state("ctrl")[1] = 0.7
    batch.step(nstep=5)
    np.testing.assert_array_equal(position, batch.qpos)
    assert (position[0] != position[1]).any()


@pytest.mark.parametrize("n_sims", [None, 2])
def test_parameters_are_live_and_constants_follow(physics, n_sims):
    model = physics.model.ptr
    before = model.dof_invweight0.copy()
    pose = physics.data.qpos.copy()
    physics.data.qpos[:] = pose + 0.1
    simulation = Simulation.of(physics if n_sims is None else Batch(model, n_sims, 1))
    armature = simulation.parameter("dof_armature")
    assert armature.shape == ((model.nv,) if n_sims is None else (n_sims, model.nv))
    armature[..., -1] += 5.0
    simulation.commit("dof_frictionloss")  # nothing derives from it
    np.testing.assert_array_equal(model.dof_invweight0, before)
    simulation.commit("dof_armature")
    changed = simulation.parameter("dof_invweight0")[..., -1]
    assert (changed < 0.9 * before[-1]).all()
    # The simulated state is not touched, although MuJoCo works the constants out in another.
    np.testing.assert_array_equal(physics.data.qpos, pose + 0.1)
    if n_sims is not None:
        np.testing.assert_array_equal(model.dof_invweight0, before)


@pytest.mark.parametrize(
    ("ids", "expected"),
    [([3], slice(3, 4)), ([2, 3, 4], slice(2, 5)), ([2, 4], None), ([4, 3], None), ([], None)],
)
def test_indexer(ids, expected):
    got = indexer(ids)
    if expected is not None:
        assert got == expected
    array = np.arange(12.0).reshape(2, 6)
    np.testing.assert_array_equal(array[:, got], array[:, np.array(ids, dtype=int)])


def test_plain_mujoco_of_the_same_text():
    root = robot()
    model = mujoco.MjModel.from_xml_string(root.to_xml_string())
    data = mujoco.MjData(model)
    simulation = Simulation.of((model, data))
    assert simulation.model is model
    assert simulation.state("qpos").shape == (model.nq,)
    assert mjcf.Physics.from_mjcf_model(root).model.nq == model.nq
