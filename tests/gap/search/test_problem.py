"""What is searched holds what an explanation leaves."""

import numpy as np
import pytest

from tests.gap.servo import SERVO
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.recordings.manifest import load_experiments
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.naming import name_effects
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.workflow import prepare

LIMIT, JUMP = 3.0, 2.6  # N·m, s


@pytest.fixture(scope="module")
def servo(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """Slow waves, each with one jump of 0.4 rad, at which alone the hidden limit is met."""
    model = tmp_path_factory.mktemp("servo") / "servo.xml"
    model.write_text(SERVO.replace("0.002", "0.001"))
    time = np.arange(0.0, 6.0, 1 / 250)
    jump = 0.4 * ((time > JUMP) & (time < JUMP + 0.3))
    targets = [(0.2 * np.sin(w * time) + jump)[:, None] for w in (1.0, 1.3, 1.7)]
    hidden = HiddenEffect(effect="effort_limit", joints=("knee",), values={"forcerange": LIMIT})
    logs = run_hardware(model, targets, rate=250.0, hidden=[hidden], seed=0)
    return prepare(load_experiments(model, logs), window=0.5, n_threads=1).problem("zero_order")


def looks_at_the_jump(problem: Problem) -> bool:
    return any(
        segment.start <= JUMP < segment.start + segment.duration
        for replay in problem.screen.objective.replays
        for segment in replay.segments
    )


def test_it_holds_what_is_rare(servo: Problem) -> None:
    assert not looks_at_the_jump(servo)
    (nothing,) = evaluate(servo.fit.objective, [(servo.nothing, np.zeros(0))])
    servo.searched.look_at(nothing.case)
    rare = servo.screen
    assert looks_at_the_jump(servo)
    servo.searched.look_at(nothing.case)
    assert servo.screen is rare


def test_what_is_rare_is_named(servo: Problem) -> None:
    effects = [CATALOGUE[name] for name in ("viscous_friction", "effort_limit", "slew_limit")]
    final = name_effects(servo, effects)[-1].fit
    assert [term.effect.name for term in final.structure.terms] == ["effort_limit"]
    assert final.values[0] == pytest.approx(LIMIT, rel=0.02)


def test_what_is_no_longer_is_searched_whole(servo: Problem) -> None:
    assert servo.race is servo.fit
    assert servo.screen is not servo.fit
