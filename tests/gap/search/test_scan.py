"""A fit where slopes say nothing, and one where there is nothing better around."""

from __future__ import annotations

import numpy as np
import pytest

from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.search.fit import evaluate, fit
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.scan import scanned
from walkerkit.gap.search.structure import Structure, Term
from walkerkit.tasks.excitation import BATTERY

PENDULUM = """
<mujoco model="pendulum">
  <compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody>
    <body name="arm">
      <joint name="shoulder" axis="0 1 0" armature="0.005" damping="0.1"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.25" size="0.02" mass="0.6"/>
    </body>
  </worldbody>
  <actuator><position joint="shoulder" kp="30" kv="1"/></actuator>
</mujoco>
"""
LIMIT = 0.8


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """A drive that cannot make more than `LIMIT`, of which its model knows nothing."""
    model = tmp_path_factory.mktemp("pendulum") / "pendulum.xml"
    model.write_text(PENDULUM)
    time = np.arange(0.0, 2.0, 1 / 250)
    targets = [
        BATTERY[name](
            time,
            lower=np.array([-0.8]),
            upper=np.array([0.8]),
            rng=np.random.default_rng(0),
            max_velocity=6.0,
        )
        for name in ("multisine", "chirp", "steps")
    ]
    limit = HiddenEffect(
        effect="effort_limit", joints=("shoulder",), values={"shoulder/forcerange": LIMIT}
    )
    recordings = run_hardware(model, targets, rate=250, hidden=[limit], seed=1)
    return gap.load(model, recordings, n_threads=1)


def test_a_limit_that_is_never_met_is_found_again(problem: Problem) -> None:
    term = Term(effect=CATALOGUE["effort_limit"], sites=("shoulder",))
    structure = Structure((term,), problem.robots)
    vars(structure)["prior"] = np.array([np.inf])  # which finds the way to no limit at all
    objective = problem.fit.objective
    never = 0.7 * structure.zero
    (start,) = evaluate(objective, [(structure, never)])
    (stuck,) = fit(objective, [start])
    assert stuck.values == never
    found = scanned(objective, stuck)
    assert found.score < stuck.score - 1.0
    assert found.values == pytest.approx([LIMIT], rel=0.02)
    assert scanned(objective, found) is found


def test_nothing_is_nowhere_else(problem: Problem) -> None:
    objective = problem.fit.objective
    (nothing,) = evaluate(objective, [(problem.nothing, np.zeros(0))])
    assert scanned(objective, nothing) is nothing
