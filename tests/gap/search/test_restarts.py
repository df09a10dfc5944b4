"""What the noise of the states that replays restart from makes of them."""

import mujoco
import numpy as np
import pytest
from scipy.stats import chi2

from tests.gap.simulation.own_log import own_log
from tests.gap.simulation.test_own_log import ELEMENTS, arm
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import cut
from walkerkit.gap.search.restarts import by_chance, of_restarts
from walkerkit.gap.simulation.channel import Channel
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Replay, as_they_are

STD = 1e-3  # rad


def test_it_is_what_a_right_model_leaves_besides_the_noise():
    xml = arm(ELEMENTS["motor"], integrator="RK4")
    columns = own_log(mujoco.MjModel.from_xml_string(xml), rows=2000)
    time, rng = columns.pop("time"), np.random.default_rng(1)
    noisy = {
        name: values + STD * rng.standard_normal(len(time)) * name.endswith("/position")
        for name, values in columns.items()
        if name.endswith(("/position", "target"))
    }
    recording = Recording(name="own", time=time, columns=noisy)
    robot = robot_from_spec(mujoco.MjSpec.from_string(xml), "own.xml")
    channels = [Channel(joint=joint, signal="position") for joint in ("a", "b")]
    replay = Replay(robot, cut([recording], 0.5), channels, n_threads=1)
    left = np.sqrt(np.mean((as_they_are([replay], 1)[0] - replay.measured) ** 2, axis=0))
    made = of_restarts([replay], 1)
    assert made[0] > 3 * STD  # the joint under torque, and that of a servo besides
    np.testing.assert_allclose(np.hypot(made, STD), left, rtol=0.25)


@pytest.mark.parametrize(("count", "tries"), [(8, 1), (23, 30)])
def test_few_of_many_go_beyond_what_is_put_down_to_chance(count, tries):
    most = by_chance(count, tries)
    assert chi2.sf(count * most**2, count) * tries == pytest.approx(0.002)
    assert by_chance(0, tries) == 1.0
