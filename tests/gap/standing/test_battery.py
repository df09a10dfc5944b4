"""The next experiment for a robot on its feet is one that it comes through."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

from tests.gap.standing.robots import write_four_legs
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.experiments.experiment import load_experiments
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.standing import standing_targets
from walkerkit.gap.report.planner import next_experiment
from walkerkit.gap.search.structure import Fit, Structure, Term
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.standing import battery
from walkerkit.gap.standing.battery import standing_battery
from walkerkit.gap.standing.choose import safe_motions
from walkerkit.gap.standing.motions import MOTIONS
from walkerkit.gap.workflow import prepare
from walkerkit.walkers.leg import LEG_XML


@pytest.fixture
def squats_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    squat = [motion for motion in MOTIONS if motion.name == "squat"]
    monkeypatch.setattr(battery, "safe_motions", partial(safe_motions, motions=squat))


def test_a_robot_that_hangs_has_none() -> None:
    assert standing_battery(load_robot(LEG_XML), seconds=6.0, rate=100.0) == {}


def test_nor_has_one_that_does_not_stand(tmp_path: Path) -> None:
    robot = load_robot(write_four_legs(tmp_path, limit=2.0))
    assert standing_battery(robot, seconds=6.0, rate=100.0, n_threads=1) == {}


@pytest.mark.usefixtures("squats_alone")
def test_the_next_experiment_of_a_robot_on_its_feet(tmp_path: Path) -> None:
    path = write_four_legs(tmp_path)
    targets = standing_targets(np.random.default_rng(0), seconds=2.0)
    logs = run_hardware(path, [targets["squat"], targets["sway"]], names=["squat", "sway"], seed=0)
    problem = prepare(load_experiments(path, logs), window=0.5, n_threads=1).problem("zero_order")
    members = [
        Fit(
            structure=Structure(
                (Term(effect=CATALOGUE[name], sites=("FL_calf",)),), problem.robots
            ),
            values=np.array([value]),
            score=0.0,
            mean_square=np.zeros(2),
        )
        for name, value in (("viscous_friction", 0.8), ("coulomb_friction", 1.0))
    ]
    planned = next_experiment(problem, members)
    assert planned is not None
    assert planned.experiment.excitation == "squat"
    assert planned.experiment.set_up == "as_it_is"
    assert planned.targets.columns["FL_calf/position_target"].std() > 0.02
    assert {"base/position_z", "base/quaternion_w"} <= planned.targets.columns.keys()
