"""What the benchmark of diagnoses measures with."""

import time

import mujoco
import numpy as np
import pytest

from benchmarks import diagnose
from walkerkit.walkers.batch import LockStep

ARM = """
<mujoco><worldbody><body><joint name="arm" axis="0 1 0" damping="1"/><geom size="0.1"/></body>
</worldbody><actuator><position joint="arm" kp="10"/></actuator></mujoco>
"""


def test_counts_the_steps_of_all_simulations_and_stops_counting():
    model = mujoco.MjModel.from_xml_string(ARM)
    batch = LockStep(model, 3, n_threads=1)
    state = np.array(batch.batch.state)
    with diagnose.counted_steps() as count:
        batch.rollout(state, ctrl=np.zeros((3, 7, 1)))
        batch.step_by_step(state, 5, lambda k: None)
    batch.rollout(state, ctrl=np.zeros((3, 7, 1)))
    assert count == [3 * 7 + 3 * 5]


def test_measures_the_time_inside_and_stops_measuring():
    batch = LockStep(mujoco.MjModel.from_xml_string(ARM), 3, n_threads=1)
    state = np.array(batch.batch.state)
    start = time.perf_counter()
    with diagnose.time_inside() as inside:
        batch.rollout(state, ctrl=np.zeros((3, 700, 1)))
        rolled = inside[0]
        batch.step_by_step(state, 50, lambda k: None)
    stepped = inside[0]
    batch.rollout(state, ctrl=np.zeros((3, 7, 1)))
    assert 0 < rolled < stepped == inside[0] < time.perf_counter() - start


def test_a_raw_step_takes_some_time():
    raw = diagnose.raw_step(mujoco.MjModel.from_xml_string(ARM))
    assert 1e-8 < raw < 1e-3


def test_the_exponent_of_what_grows_is_that_of_its_growth():
    sizes = np.array([1.0, 2.0, 5.0])
    assert diagnose.exponent(sizes, 3 * sizes**1.5) == pytest.approx(1.5)


def test_draws_what_it_measured(tmp_path):
    diagnose.plot({"joints": [(1.0, 2.0), (3.0, 5.0)]}, tmp_path / "figures")
    text = (tmp_path / "figures" / "diagnose_cost.html").read_text(encoding="utf-8")
    assert "seconds of diagnosis" in text
    assert "joints" in text
