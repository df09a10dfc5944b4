"""Slices of the endurance benchmark."""

import gc

import numpy as np
from dm_control import composer
from dm_control.mjcf import Physics

from benchmarks import endurance
from walkerkit.actuators import DelayedActuatorCfg
from walkerkit.walkers import ServoBench


def test_delays_do_not_drift_and_steps_keep_no_memory():
    # What steps keep, they keep every time; what tests before left may be moved once.
    runs = [endurance.step_on(1_500) for _ in range(3)]
    assert max(drift for drift, _ in runs) < 1e-12
    assert min(grown for _, grown in runs) < 250_000


def test_a_drift_would_show(monkeypatch):
    # The benchmark is told of one step less than there is.
    monkeypatch.setattr(endurance, "DelayedActuatorCfg", _one_later)
    drift, _ = endurance.step_on(100)
    assert drift > 1e-2


def _one_later(**fields):
    later = {name: fields[name] + 1 for name in ("delay_min_lag", "delay_max_lag")}
    return DelayedActuatorCfg(**fields | later)


def test_resets_with_recompilation_keep_no_physics():
    task = endurance._Hold(ServoBench())
    environment = composer.Environment(task, random_state=0)

    def alive():
        gc.collect()
        # By type: `isinstance` would ask proxies what they stand for.
        return sum(issubclass(type(one), Physics) for one in gc.get_objects())

    environment.reset()
    before = alive()
    for _ in range(10):
        environment.reset()
        environment.step(np.zeros(environment.action_spec().shape))
    assert alive() <= before
    assert endurance.reset_again(3) < 100_000_000
