"""The steps one by one, and what a result can be made into, on one joint."""

import re

import mujoco
import numpy as np
import pytest
from dm_control import composer

from tests.gap.simulation.follow import Follow
from walkerkit import gap
from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.rehearsal.hardware import run_hardware
from walkerkit.gap.rehearsal.rehearse import rehearse
from walkerkit.gap.report.quantity import quantity
from walkerkit.gap.report.wording import verdict_sentence
from walkerkit.gap.search.structure import Case
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.trials import Trials

JOINT = "shaft"
BENCH = """
<mujoco><compiler angle="radian"/><option timestep="0.001" integrator="implicitfast"/>
  <worldbody><body name="arm"><joint name="shaft" axis="0 1 0" range="-1.6 1.6" damping="0.05"
    armature="0.005"/><geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4"/></body>
  </worldbody><actuator><position joint="shaft" kp="20" kv="0.6"/></actuator></mujoco>
"""


@pytest.fixture(scope="module")
def bench(tmp_path_factory):
    path = tmp_path_factory.mktemp("bench") / "bench.xml"
    path.write_text(BENCH, encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def rehearsal(bench):
    return rehearse(bench, ["coulomb_friction"], seed=1, seconds=2.5)


@pytest.fixture(scope="module")
def problem(bench, rehearsal):
    return gap.load(bench, rehearsal.recordings)


@pytest.fixture(scope="module")
def fitted(problem):
    return gap.fit(problem, {"coulomb_friction": [JOINT]})


@pytest.fixture(scope="module")
def diagnosed(bench, rehearsal):
    effects = ["coulomb_friction", "viscous_friction"]
    return gap.diagnose(bench, rehearsal.recordings, effects=effects)


@pytest.fixture(scope="module")
def read_first(bench):
    """Logs of a loop that reads, computes and sends: an effort is of the target before."""
    time = np.arange(0, 2, 0.004)
    targets = [0.4 * np.sign(np.sin(size * time))[:, None] for size in (5, 6, 7)]
    return run_hardware(bench, targets, rate=250, seed=1, reads_first=True)


def test_correlations_follow_the_numbers_in_the_order_in_which_they_are_told(problem):
    names, found = ("torque_bias", "coulomb_friction", "viscous_friction"), []
    for order in (names, names[::-1]):
        fitted = gap.fit(problem, {name: [JOINT] for name in order})
        assert [one.effect for one in fitted.effects] == [*order]
        rows = np.array([p.correlation for one in fitted.effects for p in one.parameters])
        np.testing.assert_allclose(rows, rows.T, atol=1e-12)
        np.testing.assert_array_equal(np.diag(rows), 1.0)
        assert abs(rows[1, 2 if order == names else 0]) > 0.1  # of the two frictions
        found.append(rows)
    np.testing.assert_allclose(found[0], found[1][::-1, ::-1], atol=0.05)


class TestReplay:
    @pytest.mark.parametrize("logs", ["rehearsal", "read_first"])
    def test_is_what_compare_measures(self, bench, logs, request):
        recordings = request.getfixturevalue(logs)
        recordings = getattr(recordings, "recordings", recordings)
        compared = gap.compare(bench, recordings)
        read = any(note.startswith("Efforts were taken to be read") for note in compared.notes)
        assert read == (logs == "read_first")
        replayed = gap.replay(gap.load(bench, recordings))
        assert replayed.gap == compared.gap
        assert gap.locate(replayed) == compared.locations
        for trace, other in zip(replayed.traces, compared.traces, strict=True):
            np.testing.assert_array_equal(trace.after, other.before)

    def test_what_was_not_looked_for_is_not_said_to_be_missing(self, bench, rehearsal):
        compared = gap.compare(bench, rehearsal.recordings)
        assert compared.verdict == "unexplained"
        assert verdict_sentence(compared).startswith("Simulation and measurement disagree")
        assert "`walkerkit diagnose` with the same arguments" in compared.notes[0]

    def test_of_mended_robots_shows_what_they_leave(self, problem, fitted):
        replayed = gap.replay(problem, fitted.robots)
        assert replayed.gap == fitted.gap
        assert fitted.gap.position.after < 0.4 * fitted.gap.position.before
        left, before = gap.locate(replayed), gap.locate(gap.replay(problem))
        assert left != before

    def test_is_printed_in_a_line(self, problem, fitted):
        shown = repr(gap.replay(problem))
        assert shown.startswith(f"<Comparison: joints {JOINT}; the position error on held-out rec")
        assert str(gap.replay(problem, fitted.robots)).endswith(" mrad after>")
        before = gap.replay(problem).gap.position.before
        assert f" is {quantity(before, 'rad')}>" in shown
        first, *_ = gap.locate(gap.replay(problem))
        assert str(first).startswith(f"{JOINT}, {first.regime}: ")
        assert str(first).endswith(f" of the position gap, lift {first.lift:.2g}")

    def test_takes_one_robot_per_experiment(self, problem):
        with pytest.raises(ValueError, match="2 robots for 1 experiments"):
            gap.replay(problem, [problem.robots[0]] * 2)


class TestResults:
    def test_are_shown_in_a_line(self, problem, diagnosed):
        shown = repr(problem)
        assert shown.startswith("<Problem: ")
        names = ("bench.xml", f"joints {JOINT}", "fitted: ", "held out: ")
        assert all(name in shown for name in names)
        assert len(shown.splitlines()) == 1
        assert repr(diagnosed) == f"<Result: {diagnosed.verdict}; coulomb_friction>"


class TestFit:
    def test_recovers_what_is_hidden(self, bench, rehearsal, fitted):
        (hidden,) = rehearsal.hidden
        true = hidden.values[f"{JOINT}/frictionloss"]
        own = mujoco.MjModel.from_xml_path(str(bench)).dof_frictionloss[0]
        assert fitted.value("coulomb_friction", "frictionloss") == pytest.approx(true, rel=0.05)
        assert fitted.model.dof_frictionloss[0] == pytest.approx(own + true, rel=0.05)

    def test_says_so_in_a_table(self, fitted):
        first, *_ = str(fitted).splitlines()
        assert first.startswith("The position error on held-out recordings is ")
        row = next(line for line in str(fitted).splitlines() if "frictionloss" in line)
        assert row.split()[:3] == ["coulomb_friction", JOINT, "frictionloss"]
        assert "±" in row
        assert repr(fitted) == f"<Fitted: coulomb_friction at {JOINT}>"

    def test_is_that_of_whole_rollouts_whatever_was_fitted_before(self, problem, fitted):
        whole = problem.whole.objective
        assert [len(r.segments) for r in whole.replays] == [len(problem.fit.recordings[0])]
        again = gap.fit(problem, {"coulomb_friction": [JOINT]})
        np.testing.assert_array_equal(again.fit.values, fitted.fit.values)
        for share in (0.95, 1.05):
            ((moved,),) = whole.mean_squares(
                [Case(structure=fitted.fit.structure, values=share * fitted.fit.values[None])]
            )
            assert whole.score(moved) > fitted.fit.score

    def test_effects_stay_in_the_order_in_which_they_are_given(self, problem):
        found = gap.fit(problem, {"viscous_friction": "*", "coulomb_friction": "*"})
        assert [one.effect for one in found.effects] == ["viscous_friction", "coulomb_friction"]
        viscous = found.effects[0].parameters[0]
        assert abs(viscous.value) < max(3 * viscous.std, 0.05)

    @pytest.mark.parametrize("names", ["coulomb_friction", ["coulomb_friction"]])
    def test_of_names_alone_is_everywhere(self, problem, fitted, names):
        found = gap.fit(problem, names)
        assert [one.places for one in found.effects] == [(JOINT,)]
        np.testing.assert_array_equal(found.fit.values, fitted.fit.values)

    def test_of_nothing_leaves_the_gap(self, problem):
        found = gap.fit(problem, {})
        assert found.effects == ()
        assert found.gap.position.after == found.gap.position.before

    @pytest.mark.parametrize(
        ("effects", "message"),
        [
            ({"coulomb": [JOINT]}, "did you mean 'coulomb_friction'"),
            (["coulomb"], "did you mean 'coulomb_friction'"),
            ({"coulomb_friction": ["shaf"]}, f"did you mean '{JOINT}'"),
            ({"coulomb_friction": []}, "name one at least"),
            ({"coulomb_friction": [JOINT, JOINT]}, "each once"),
        ],
    )
    def test_names_that_there_are_not(self, problem, effects, message):
        with pytest.raises(InputError, match=message):
            gap.fit(problem, effects)

    def test_readings_of_targets_that_there_are_not(self, bench, rehearsal):
        message = "hold is 'zoh'; give one of 'zero_order', 'linear', 'next'"
        with pytest.raises(InputError, match=message):
            gap.load(bench, rehearsal.recordings, hold="zoh")

    @pytest.mark.parametrize("window", ["0.5", [0.5]])
    @pytest.mark.parametrize("step", [gap.load, gap.compare, gap.diagnose])
    def test_windows_that_are_no_numbers(self, bench, rehearsal, step, window):
        message = re.escape(f"window is {window!r}; give a positive number of seconds")
        with pytest.raises(InputError, match=message):
            step(bench, rehearsal.recordings, window=window)

    def test_a_number_that_there_is_not(self, fitted):
        with pytest.raises(KeyError, match="is 0 of the parameters"):
            fitted.value("armature", "armature")


class TestResult:
    def test_prints_itself(self, diagnosed):
        assert str(diagnosed).startswith(("Explained", "Partly explained"))

    def test_has_the_mended_model(self, bench, diagnosed):
        (named,) = diagnosed.diagnosis.effects
        given = mujoco.MjModel.from_xml_path(str(bench))
        added = diagnosed.model.dof_frictionloss[0] - given.dof_frictionloss[0]
        assert added == pytest.approx(named.parameters[0].value)

    def test_writes_the_report_alone(self, diagnosed, tmp_path):
        path = diagnosed.report(tmp_path / "alone.html")
        assert "coulomb_friction" in path.read_text(encoding="utf-8")
        assert list(tmp_path.iterdir()) == [path]

    def test_makes_the_folder_of_the_report(self, diagnosed, tmp_path):
        assert diagnosed.report(tmp_path / "new" / "er" / "alone.html").is_file()
        with pytest.raises(InputError, match=r"new: cannot be written \(.*\)\. Give another file"):
            diagnosed.report(tmp_path / "new")

    def test_has_what_its_diagnosis_has(self, diagnosed):
        for name in ("verdict", "gap", "locations", "effects", "notes"):
            assert getattr(diagnosed, name) is getattr(diagnosed.diagnosis, name)

    def test_walker_moves_as_the_replay_of_the_mended_robot(self, diagnosed, rehearsal):
        recording = rehearsal.recordings[0]
        (robot,) = diagnosed.robots
        step, rows = robot.model.opt.timestep, 500
        channel = Channel(joint=JOINT, signal="position")
        replay = Replay(robot, whole(recording), [channel], hold="zero_order")
        predicted = replay.predict(Trials(robot, 1))[0, :, 0]
        # The log's targets at the physics' own steps, each held until the next one.
        time = step * np.arange(rows)
        latest = np.searchsorted(recording.time, time + recording.time[0] + 1e-9, side="right") - 1
        targets = recording.columns[f"{JOINT}/position_target"][latest][:, None]
        walker = diagnosed.walker(name="bench")
        task = Follow(walker, targets, step)
        environment = composer.Environment(task, random_state=0, legacy_step=False)
        environment.reset()
        joints = environment.physics.bind(walker.observable_joints)
        first = replay._groups[0].states[id(recording)]
        joints.qpos, joints.qvel = (values[0, 0] for values in first.at(recording.time[:1]))
        path = [float(joints.qpos[0])]
        for _ in range(rows - 1):
            environment.step(np.zeros(1))
            path.append(float(joints.qpos[0]))
        expected = np.interp(time, recording.time - recording.time[0], predicted)
        moved = np.ptp(predicted[: round(rows * step / np.diff(recording.time).mean())])
        np.testing.assert_allclose(path, expected, atol=1e-6 + 1e-3 * moved)

    def test_several_models_are_taken_one_by_one(self, tmp_path, rehearsal):
        for number, recording in enumerate(rehearsal.recordings):
            recording.save(tmp_path / f"{number}.csv")
        for name in ("light", "heavy"):
            (tmp_path / f"{name}.xml").write_text(BENCH, encoding="utf-8")
        manifest = tmp_path / "experiments.toml"
        manifest.write_text(
            '[[experiment]]\nmodel = "light.xml"\nrecordings = ["0.csv"]\nheld_out = ["1.csv"]\n'
            '[[experiment]]\nmodel = "heavy.xml"\nrecordings = ["2.csv"]\n',
            encoding="utf-8",
        )
        found = gap.fit(gap.load(manifest), {"coulomb_friction": "*"})
        assert list(found.mended) == ["light", "heavy"]
        assert found.mended["heavy"].model.dof_frictionloss[0] > 0
        with pytest.raises(ValueError, match=r"mended\['light'\]\.model"):
            assert found.model
