"""Known errors beside logs, without the logs: a servo that MuJoCo moves stands in for a machine."""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import mujoco
import numpy as np
import pytest

from benchmarks import planted
from benchmarks.hidden.outcome import Hidden, Named, Outcome, Value
from benchmarks.plants import best as bests
from benchmarks.plants import running
from benchmarks.plants.best import best_model
from benchmarks.plants.cases import CONTROL, PLANTS, PlantedCase, cases
from benchmarks.plants.kinds import KINDS, SIGN_FLIP, Setting
from benchmarks.plants.outcome import SHOWS, PlantedOutcome, shows
from benchmarks.plants.running import Job, run_case
from benchmarks.plants.scoring import (
    first_beside,
    own_names,
    rare_first,
    sizes_right,
    sure,
    told,
)
from benchmarks.plants.table import line, rows
from benchmarks.plants.temperature import log_score, probability
from benchmarks.rivals.logs import LOGS, RealLog
from benchmarks.rivals.plain import plain
from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.experiments.experiment import Experiment
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.mend import mend, write_model
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.sidecar import FILE, sidecar, with_sidecar
from walkerkit.gap.simulation.trials import Trials

LOG = "arm"
ARM = """
<mujoco model="arm"><compiler angle="radian"/>
  <option timestep="0.002" integrator="implicitfast"/>
  <worldbody><body name="link"><joint name="arm" axis="0 1 0" {joint}/>
    <inertial pos="0 0 -0.2" mass="0.6" diaginertia="0.004 0.004 0.001"/></body></worldbody>
  <actuator><position name="arm" joint="arm" kp="8" kv="0.5" forcerange="-9 9"/></actuator>
</mujoco>
"""
TRUE = 'armature="0.01" damping="0.15" frictionloss="0.2"'


def recorded(name: str, target) -> gap.Recording:
    """What an arm with losses of its own does with a target, logged at 125 Hz."""
    model = mujoco.MjModel.from_xml_string(ARM.format(joint=TRUE))
    data = mujoco.MjData(model)
    rows = []
    for step in range(600):
        if step % 4 == 0:
            data.ctrl[0] = target(data.time)
            rows.append((data.time, data.qpos[0], data.qvel[0], data.ctrl[0]))
        mujoco.mj_step(model, data)
    time, *columns = np.array(rows).T
    signals = ("position", "velocity", "position_target")
    named = {f"arm/{s}": column for s, column in zip(signals, columns, strict=True)}
    return gap.Recording(name=name, time=time, columns=named)


@pytest.fixture(scope="module")
def log(tmp_path_factory) -> RealLog:
    model = tmp_path_factory.mktemp("data") / "arm.xml"
    model.write_text(ARM.format(joint='armature="0.004"'), encoding="utf-8")
    recordings = (
        recorded("fast", lambda t: 0.5 * np.sin(4 * t + 3 * t**2)),
        recorded("slow", lambda t: 0.8 * np.sin(3 * t)),
        recorded("held", lambda t: 0.6 * np.sin(6 * t) + 0.3 * np.sign(np.sin(5 * t))),
    )
    experiment = Experiment(model=str(model), recordings=recordings, held_out=frozenset({"held"}))
    return RealLog(
        name=LOG,
        what="position",
        experiments=lambda: (experiment,),
        figure=lambda problem, of: (of.position.after,),
    )


@pytest.fixture
def known(log, tmp_path_factory, monkeypatch) -> Path:
    """The folder of best models, with the arm among the logs."""
    for module in (bests, running):
        monkeypatch.setattr(module, "LOGS", (*LOGS, log))
    return tmp_path_factory.getbasetemp() / "best"


def case(kind: str, **more) -> PlantedCase:
    return PlantedCase(log=LOG, kind=kind, half="to tell", **more)


class TestCases:
    def test_are_frozen_and_each_has_a_name(self):
        every = cases()
        assert every == cases()
        assert len({one.name for one in every}) == len({one.seed for one in every}) == len(every)

    def test_are_two_dozen_or_more_in_halves(self):
        halves = [sum(one.half == half for one in cases()) for half in ("to fit", "to tell")]
        assert sum(halves) >= 24
        assert abs(halves[0] - halves[1]) <= len(PLANTS)

    def test_have_kinds_that_there_are_on_logs_that_there_are(self):
        assert set(PLANTS) == {one.name for one in LOGS}
        assert {kind for kinds in PLANTS.values() for kind in kinds} == set(KINDS)
        assert all(len(set(kinds)) == len(kinds) for kinds in PLANTS.values())

    def test_of_another_draw_have_other_seeds_and_no_control(self):
        first, second = cases(), cases(draw=1)
        assert {one.seed for one in first}.isdisjoint(one.seed for one in second)
        assert [one.kind for one in second] == [one.kind for one in first if one.half]

    def test_of_a_log_are_those_of_all_logs(self):
        assert cases("emps") == [one for one in cases() if one.log == "emps"]


class TestBestModel:
    def test_is_fitted_once_and_is_what_gap_compare_measures(self, known):
        best = best_model(LOG, known, rounds=0)
        model = Path(best.experiments[0].model)
        before = model.stat().st_mtime_ns
        assert best_model(LOG, known, rounds=0) == best
        assert model.stat().st_mtime_ns == before
        found = gap.compare(model, best.experiments[0].recordings, held_out=["held"])
        sizes = {name: size.before for name, size in found.gap.signals.items()}
        assert sizes == pytest.approx(best.gaps, rel=1e-3)
        joint = load_robot(model).model
        assert joint.dof_armature[0] == pytest.approx(0.01, rel=0.1)
        assert joint.dof_frictionloss[0] == pytest.approx(0.2, rel=0.1)

    def test_has_one_number_for_a_damping_that_two_would_share(self, log):
        structure = plain(log.load())
        assert "velocity_gain" not in structure
        assert structure["viscous_friction"] == ("arm",)
        assert structure["command_delay"] == "*"


@pytest.mark.parametrize("kind", sorted(set(KINDS) - {"shoulder_1.2", "shoulder_0.85"}))
class TestKinds:
    def test_are_undone_by_their_truth(self, kind, known, tmp_path):
        """The gap of an error and of what undoes it is that of the best model."""
        best = best_model(LOG, known, rounds=0)
        setting = Setting(
            robots=(with_own_sidecar(best.experiments[0].model),),
            recordings=best.experiments[0].recordings,
        )
        error = KINDS[kind](np.random.default_rng(3), setting)
        trials = Trials(setting.robot, 1)
        error.robot(trials)
        wrong = reloaded(mend(trials), tmp_path)
        seen = [error.recording(one) for one in setting.recordings]
        if error.effect == SIGN_FLIP:
            np.testing.assert_array_equal(
                seen[0].columns["arm/position"], -setting.recordings[0].columns["arm/position"]
            )
            return
        undone, effect = Trials(wrong, 1), CATALOGUE[error.effect]
        site = "arm" if effect.kind == "joint" else error.place
        parameters = effect.parameters(wrong, site)
        values = [error.truth.get(one.name, one.zero) for one in parameters]
        effect.apply(undone, site, np.array([values]))
        models = wrong, reloaded(mend(undone), tmp_path)
        sizes = [
            gap.replay(gap.load(model.source, seen, held_out=["held"])).gap.position.before
            for model in models
        ]
        assert sizes[0] > SHOWS * best.gaps["position"]
        # Nearly all of it: where the targets are shifted, those of the end are lost for good.
        gained = sizes[0] - best.gaps["position"]
        assert sizes[1] == pytest.approx(best.gaps["position"], abs=0.1 * gained)


def reloaded(robot: Robot, folder: Path) -> Robot:
    """The robot from a file of its own, as a user has it."""
    own = folder / str(len(list(folder.iterdir())))
    own.mkdir()
    write_model(robot, own / "arm.xml")
    (own / FILE).write_text(json.dumps(sidecar({"arm.xml": robot}, [])), encoding="utf-8")
    return with_own_sidecar(own / "arm.xml")


def with_own_sidecar(path: str | Path) -> Robot:
    return with_sidecar(load_robot(path), Path(path))


class TestRunning:
    FEW = ("coulomb_friction", "command_delay", "torque_bias")

    @pytest.mark.parametrize(
        ("kind", "effect"), [("coulomb_friction", "coulomb_friction"), ("delay", "command_delay")]
    )
    def test_a_plant_is_named_where_it_is(self, known, kind, effect):
        best_model(LOG, known, rounds=0)
        found = run_case(Job(case=case(kind), best=known), effects=self.FEW)
        assert found.shows
        assert found.outcome.named[0].effect == effect
        assert found.outcome.named[0].places == ("arm",)
        assert sizes_right(found) is not None
        (value, *_) = found.outcome.named[0].values
        assert value.value == pytest.approx(value.true, rel=0.1)
        assert PlantedOutcome.from_json(found.to_json()) == found
        assert effect in line(found)

    def test_what_does_not_show_is_not_asked_about(self, known, monkeypatch):
        monkeypatch.setattr(running, "shows", lambda best, with_it: False)
        found = run_case(Job(case=case("payload"), best=known))
        assert found.outcome.verdict == "silent"
        assert told([found]) == []

    def test_what_a_log_cannot_have_is_said_to_be_impossible(self, known, monkeypatch):
        monkeypatch.setattr(running, "KINDS", {"none": lambda rng, setting: None})
        found = run_case(Job(case=case("none"), best=known))
        assert found.outcome.verdict == "impossible"
        assert told([found]) == []

    def test_cases_that_are_in_the_file_are_not_run_again(self, tmp_path):
        every = cases("emps")[:3]
        have = [outcome(one) for one in every]
        text = "".join(one.to_json() + "\n" for one in have)
        (tmp_path / planted.FILE).write_text(text)
        assert list(planted.outcomes(every, out=tmp_path)) == have
        assert (tmp_path / planted.FILE).read_text() == text


def named(effect: str, confidence: float = 0.95, places=("arm",), **more) -> Named:
    parts = {"doubt": (), "alike": (), **more}
    return Named(effect=effect, places=places, confidence=confidence, **parts)


def outcome(of: PlantedCase, *names: Named, hidden: str = "payload") -> PlantedOutcome:
    truth = Hidden(effect=hidden, places=("arm",), alike=(), text=hidden)
    return PlantedOutcome(
        case=of.name,
        log=of.log,
        kind=of.kind,
        half=of.half,
        best={"position": 0.01},
        planted={"position": 0.02},
        commit="",
        best_commit="",
        outcome=Outcome(
            case=of.name,
            tier=of.log,
            off="",
            verdict="explained",
            hidden=(truth,) if of.half else (),
            named=names,
            before=0.02,
            after=0.01,
            seconds=1.0,
        ),
    )


class TestTemperature:
    TABLE = (
        ("payload (arm) + coulomb_friction (arm)", 100.0, -4.0),
        ("viscous_friction (arm)", 92.0, -1.0),
    )

    def test_a_table_gives_what_was_planted_the_weight_of_all_that_has_it(self):
        one = dataclasses.replace(outcome(case("payload")), table=self.TABLE)
        odds = np.exp(8.0 / 4.0 - 3.0)
        assert probability(one, 4.0) == pytest.approx(odds / (1 + odds))
        assert probability(one, 1.0) > 0.99
        other = dataclasses.replace(outcome(case("payload"), hidden="friction"), table=self.TABLE)
        assert probability(other, 4.0) == 0.0

    def test_a_name_that_no_structure_has_counts_as_the_least(self):
        right = dataclasses.replace(outcome(case("payload")), table=self.TABLE)
        absent = dataclasses.replace(outcome(case("payload"), hidden="payload_"), table=self.TABLE)
        assert log_score([absent], 1.0) == pytest.approx(np.log(0.01))
        assert log_score([right, absent], 1.0) == pytest.approx(
            (np.log(probability(right, 1.0)) + np.log(0.01)) / 2
        )

    def test_a_kept_outcome_has_its_table(self):
        one = dataclasses.replace(outcome(case("payload")), table=self.TABLE)
        assert PlantedOutcome.from_json(one.to_json()) == one


class TestScoring:
    def test_a_plant_shows_where_some_signal_s_gap_is_a_fifth_larger(self):
        best = {"position": 1.0, "effort": 2.0}
        assert shows(best, {"position": 1.0, "effort": 2.5})
        assert not shows(best, {"position": 1.19, "effort": 1.0})
        assert shows(best, {})

    def test_a_size_is_right_within_two_standard_errors_and_only_of_the_name_itself(self):
        def of(value, std):
            values = (Value(name="mass", place="arm", true=0.2, value=value, std=std),)
            return outcome(case("payload"), named("payload", values=values))

        assert sizes_right(of(0.23, 0.02))
        assert sizes_right(of(0.26, 0.02)) is False
        assert sizes_right(of(0.2, None)) is False
        assert sizes_right(outcome(case("payload"), named("payload"))) is False
        assert sizes_right(outcome(case("payload"), named("com_offset"))) is None
        assert sizes_right(outcome(case("payload"))) is None

    def test_what_the_log_is_given_anyway_is_neither_right_nor_wrong(self):
        control = outcome(
            dataclasses.replace(case(CONTROL), half=""), named("backlash"), named("payload")
        )
        own = own_names([control])[LOG]
        one = outcome(case("payload"), named("payload"), named("backlash"), named("cogging"))
        assert sure(one, own) == [True, False]
        assert sure(one, ()) == [True, False, False]
        behind = outcome(case("payload"), named("backlash"), named("payload"))
        assert first_beside(behind, own)
        assert not first_beside(behind, ())

    def test_ordinary_names_are_put_aside_where_the_hidden_one_is_not(self):
        one = outcome(case("payload"), named("armature"), named("payload"))
        assert rare_first(one)
        other = outcome(case("gain_2"), named("armature"), hidden="position_gain")
        assert not rare_first(other)

    def test_the_table_has_a_row_for_each_half_and_for_the_gains(self):
        some = [
            outcome(dataclasses.replace(case("payload"), half="to fit"), named("payload")),
            outcome(case("gain_2"), named("payload"), hidden="position_gain"),
        ]
        found = {row.what: row.result for row in rows(some)}
        assert found["plants that show"] == "2 of 2"
        assert found["first name right or in its set, to fit"] == "100% (1 of 1)"
        assert found["first name right or in its set, to tell"] == "0% (0 of 1)"
        assert found["servo gains: mass or geometry first"] == "100% (1 of 1)"
        assert found["right first names given with 0.7 or more, to fit"] == "100% (1 of 1)"
        assert "its size within 2 standard errors, to tell" not in found
