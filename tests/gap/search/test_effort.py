"""How much is tried: counted in simulation steps, so that machines agree."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tests.gap.search.test_naming import LEG, problem_of
from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.rehearsal.rehearse import rehearse
from walkerkit.gap.report.first_answer import FILE, FirstAnswer
from walkerkit.gap.search.effort import Effort, EnoughError, counted, spend, spent
from walkerkit.gap.search.naming import name_effects
from walkerkit.gap.search.problem import Problem

HIDDEN = HiddenEffect(effect="torque_bias", joints=("knee",), values={"bias": 0.4})
FEW = [CATALOGUE[name] for name in ("viscous_friction", "torque_bias", "parallel_spring")]


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    model = tmp_path_factory.mktemp("leg") / "leg.xml"
    model.write_text(LEG)
    return problem_of(model, (HIDDEN,))


def test_levels_are_multiples_of_the_plain_fit() -> None:
    counted()
    quick, thorough = Effort("quick"), Effort("thorough")
    spend(100)
    on_feet = Effort()
    for one in (quick, thorough, on_feet):
        one.ground_is_done(on_feet=one is on_feet)
        assert one.allows("more")
    spend(220)
    assert not on_feet.allows("more")
    assert quick.allows("more")
    spend(180)
    assert spent() == 500
    assert not quick.allows("more")
    assert not quick.allows("more")
    assert quick.untried == ["more"]
    assert thorough.allows("more")
    thorough.ground_is_done(on_feet=False)  # of another reading: the first counts
    assert thorough.allows("more")


def test_other_levels_are_refused() -> None:
    with pytest.raises(InputError, match=r"no effort 'quik' \(did you mean 'quick'\?\)\. Choose"):
        Effort("quik")  # type: ignore[arg-type]


def test_what_is_stopped_keeps_what_it_has(problem: Problem) -> None:
    effort, stages = Effort(), list[str]()

    def progress(stage: str, done: float) -> None:
        stages.append(stage)
        if "candidates" in stage:
            effort.stop()

    found = name_effects(problem, FEW, progress, effort=effort)
    with pytest.raises(EnoughError):
        effort.checked(None)("", 0.0)
    assert stages[-1].startswith("2 candidates")
    # The plain fit stands, and nothing rare was tried.
    assert not any(name in ("torque_bias", "parallel_spring") for _, name in found.gains)
    whole = name_effects(problem, FEW)
    assert [one.term.effect.name for one in whole.named] == ["torque_bias"]
    assert whole.untried == ()


def test_the_plain_fit_is_told_before_the_rest(tmp_path: Path) -> None:
    model = tmp_path / "leg.xml"
    model.write_text(LEG)
    rehearsal = rehearse(model, ["viscous_friction"], seed=1, seconds=1)
    answers, out = list[FirstAnswer](), tmp_path / "out"

    def first(answer: FirstAnswer) -> None:
        answers.append(answer)
        saved = json.loads((out / FILE).read_text(encoding="utf-8"))
        assert saved["signals"]["position"][1] == answer.signals["position"][1]

    result = gap.diagnose(
        model, rehearsal.recordings, effects=["viscous_friction"], first=first, out=out
    )
    (answer,) = answers
    assert answer.effects == ("viscous_friction",)
    before, after, unit = answer.signals["position"]
    assert before == result.diagnosis.gap.position.before
    assert after < 0.5 * before
    assert unit == "rad"
    assert "takes the held-out gap of position from" in answer.sentence
    assert not (out / FILE).exists()
    assert np.isfinite(answer.seconds)
    told = result.diagnosis.gap
    better = replace(answer, signals={"position": (before, 0.5 * told.position.after, unit)})
    assert told.position_at_floor
    assert better.notes(told) == ()
    left = replace(told, position=replace(told.position, after=0.6 * before))
    (note,) = answer.notes(left)
    assert "gap.fit(gap.load(model, recordings), ['viscous_friction'])" in note
    assert replace(answer, signals={"position": (before, 0.6 * before, unit)}).notes(left) == ()


def test_quick_says_what_it_left_out(tmp_path: Path) -> None:
    model = tmp_path / "leg.xml"
    model.write_text(LEG)
    rehearsal = rehearse(model, ["torque_bias", "payload"], seed=1, seconds=1)
    effects = ["viscous_friction", "torque_bias", "payload"]
    found = gap.diagnose(model, rehearsal.recordings, effects=effects, effort="quick").diagnosis
    again = gap.diagnose(model, rehearsal.recordings, effects=effects, effort="quick").diagnosis
    assert found.effects == again.effects
    for note in found.notes:
        if "did not try" in note:
            assert note.startswith("The effort was quick, so that it did not try: ")
            break
    else:
        pytest.fail("nothing was left out")
