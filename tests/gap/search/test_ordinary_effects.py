"""The ground of models that are far from the robot: servos by orders of magnitude, late targets."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gap.search.test_naming import LEG, found, hide, recorded, search
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.search.effort import Effort
from walkerkit.gap.search.naming import begin
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.trials import Trials
from walkerkit.gap.workflow import prepare

CARRIAGE = """
<mujoco>
  <option timestep="0.0005" gravity="0 0 0" integrator="implicitfast"/>
  <worldbody>
    <body>
      <joint name="carriage" type="slide" axis="1 0 0" damping="190" frictionloss="20"/>
      <geom type="box" size="0.1 0.1 0.05" mass="95"/>
    </body>
  </worldbody>
  <actuator><position joint="carriage" kp="1.5e6" kv="9000" forcerange="-350 350"/></actuator>
</mujoco>
"""
CHANNELS = tuple(Channel(joint="carriage", signal=signal) for signal in ("position", "effort"))


@pytest.mark.parametrize("softer", [0.02, 100.0])
def test_gains_that_are_off_by_orders_of_magnitude_are_found(tmp_path: Path, softer: float) -> None:
    """Too soft, the leg hangs in its joints; too stiff, its steps follow no target of the log."""
    model, given = tmp_path / "leg.xml", tmp_path / "given.xml"
    model.write_text(LEG)
    gains = {"kp": (30, 20), "kv": (1, 0.5)}
    text = LEG
    for name, values in gains.items():
        for value in values:
            text = text.replace(f'{name}="{value:g}"', f'{name}="{value / softer!r}"')
    given.write_text(text)
    logs = recorded(model, [hide("coulomb_friction", "ankle", frictionloss=0.2)])
    leg = prepare(load_experiments(given, logs), window=0.5, n_threads=1).problem("zero_order")
    told = found(search(leg, "position_gain", "velocity_gain", "coulomb_friction"))
    for k, joint in enumerate(("knee", "ankle")):
        own = {name: values[k] for name, values in gains.items()}
        kp = own["kp"] / softer + told["position_gain"][joint]
        kd = own["kv"] / softer + told["velocity_gain"][joint]
        assert kp == pytest.approx(own["kp"], rel=0.02)
        assert kd == pytest.approx(own["kv"], rel=0.1)
    assert told["coulomb_friction"] == pytest.approx({"ankle": 0.2}, rel=0.1)


def swinging(model: Path, frequency: float) -> Recording:
    """What a carriage on its servo logs of a motion that sets in slowly, with little noise."""
    time = np.arange(0.0, 8.0, 0.001)
    swings = ((0.1, frequency), (0.02, 3.1 * frequency))
    target = sum(size * np.sin(2 * np.pi * own * time) for size, own in swings)
    target *= -np.expm1(-((time / 0.5) ** 3))
    columns = {"carriage/position": 0.0 * time, "carriage/position_target": target}
    log, robot = Recording(name=f"at {frequency}", time=time, columns=columns), load_robot(model)
    (shown,) = Replay(robot, whole(log), CHANNELS, n_threads=1).predict(Trials(robot, 1))
    shown += np.random.default_rng(0).normal(size=shown.shape) * (1e-7, 0.1)
    signals = {f"carriage/{c.signal}": shown[:, k] for k, c in enumerate(CHANNELS)}
    return replace(log, columns={**columns, **signals})


def test_targets_that_come_late_are_not_taken_for_a_soft_servo(tmp_path: Path) -> None:
    """Let loose with its delay a stiff servo goes soft, which comes nearer, and stays there."""
    model = tmp_path / "carriage.xml"
    model.write_text(CARRIAGE)
    late, logs = 23, []
    for log in (swinging(model, frequency) for frequency in (0.3, 0.45)):
        columns = {name: values[:-late] for name, values in log.columns.items()}
        columns["carriage/position_target"] = log.columns["carriage/position_target"][late:]
        logs.append(replace(log, time=log.time[:-late], columns=columns))
    problem = prepare(load_experiments(model, logs), window=None, n_threads=1).problem("zero_order")
    ground = begin(problem, list(CATALOGUE.values()), effort=Effort()).plain
    slots = zip(ground.structure.slots, ground.values.tolist(), strict=True)
    values = {slot.term.effect.name: value for slot, value in slots}
    assert values["command_delay"] == pytest.approx(0.023, abs=2e-4)
    assert values["position_gain"] == pytest.approx(0.0, abs=0.02 * 1.5e6)
    assert values["velocity_gain"] == pytest.approx(0.0, abs=0.05 * 9000)
