"""A slice of the benchmark of known structures: one joint."""

import numpy as np
import pytest

from benchmarks import sysid_fit
from benchmarks.rivals import mujoco_sysid


@pytest.fixture(scope="module")
def rig(tmp_path_factory):
    return sysid_fit.make("pendulum", tmp_path_factory.mktemp("rig"), seconds=1.0)


def test_the_cost_tells_the_robot_from_its_model(rig):
    noise = sysid_fit.cost(rig, rig.true)
    assert noise < 1e-2 * sysid_fit.cost(rig, rig.given())
    assert sysid_fit.cost(rig, 1.1 * rig.true) > 2 * noise
    assert sysid_fit.cost(rig, rig.true, held_out=True) != noise


@pytest.mark.skipif(not mujoco_sysid.available(), reason="needs pip install 'mujoco[sysid]'")
def test_both_find_what_was_planted_and_cost_as_little(rig):
    found = [sysid_fit.by_sysid(rig, sysid_fit._bounds(rig), "mujoco"), sysid_fit.by_gap(rig)]
    costs = [sysid_fit.cost(rig, one.values) for one in found]
    assert max(costs) < 1.2 * sysid_fit.cost(rig, rig.true)
    for one in found:
        np.testing.assert_allclose(one.values, rig.true, rtol=0.1)
        assert one.seconds > 0
