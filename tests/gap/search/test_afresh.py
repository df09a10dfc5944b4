"""Rare effects that begin on the model as given: each where it leaves less there."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.search.afresh import afresh
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.structure import extended
from walkerkit.gap.workflow import prepare

ARM = """<mujoco>
  <compiler angle="radian"/>
  <worldbody>
    <body>
      <joint name="hip" axis="0 1 0" armature="0.02" damping="0.2" range="-1 1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/>
      <body pos="0 0 -0.3">
        <joint name="knee" axis="0 1 0" armature="0.01" damping="0.1" range="-1 1"/>
        <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <position joint="hip" kp="60" kv="2"/>
    <position joint="knee" kp="40" kv="1"/>
  </actuator>
</mujoco>
"""
LAG = 0.04  # s


def test_what_joints_usually_share_begins_at_the_one_that_has_it(tmp_path: Path) -> None:
    model = tmp_path / "arm.xml"
    model.write_text(ARM)
    time = np.arange(0.0, 3.0, 0.004)
    sent = [
        np.stack([0.4 * np.sign(np.sin(k * time)), 0.3 * np.sin(4 * time + k * time**2)], axis=1)
        for k in (3, 2)
    ]
    hidden = HiddenEffect(
        effect="setpoint_filter", joints=("knee",), values={"knee/time_constant": LAG}
    )
    logs = run_hardware(model, sent, rate=250, hidden=[hidden], seed=1)
    setup = prepare(load_experiments(model, logs), window=0.5, n_threads=1)
    problem = setup.problem("zero_order")
    (nothing,) = evaluate(problem.fit.objective, [(problem.nothing, np.zeros(0))])
    ordinary = [CATALOGUE[name] for name in ("viscous_friction", "position_gain")]
    bent = extended(nothing, problem.terms(ordinary))
    bent.values[:] = [0.1, 0.5, -10.0, -20.0]
    rare = [CATALOGUE[name] for name in ("setpoint_filter", "torque_bias", "effort_limit")]
    problem.fit.refine(bent)
    (structure, values), *_ = afresh(problem.fit, bent, problem.terms(rare), most=2)
    term = structure.terms[-1]
    assert (term.effect.name, term.places) == ("setpoint_filter", ("knee",))
    assert 0.3 * LAG < values[-1] < 3 * LAG
    assert not values[:-1].any()  # what is ordinary begins as in the model
