"""Structures, the objective, screening and fitting: on one joint, against closed forms and spread.

The effects themselves are under contract in `test_effects.py`; here they only serve.
"""

from dataclasses import replace
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from scipy.optimize import approx_fprime
from scipy.signal import lfilter

from walkerkit.gap.effects import CATALOGUE, EVERYWHERE, JointEffect, Parameter
from walkerkit.gap.effects.effect import registered
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import stretches, whole, windows
from walkerkit.gap.search import fit as fit_module
from walkerkit.gap.search import objective as objectives
from walkerkit.gap.search import slopes as slopes_module
from walkerkit.gap.search.certainty import INSENSITIVE, covariance
from walkerkit.gap.search.decision import TAILS
from walkerkit.gap.search.fit import evaluate, fit, polish
from walkerkit.gap.search.half import Half
from walkerkit.gap.search.numerical_error import NumericalError
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.recent import Recent
from walkerkit.gap.search.screen import screen
from walkerkit.gap.search.settle import robustly, settled
from walkerkit.gap.search.slopes import linearised
from walkerkit.gap.search.structure import Case, Fit, Structure, Term, candidate_terms, carried
from walkerkit.gap.simulation.excursion import excursions
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.replay import Channel, Replay, predict_together
from walkerkit.gap.simulation.robot import Excursion
from walkerkit.gap.simulation.trials import Trials

STEP = 0.002
PENDULUM = """
<mujoco><compiler angle="radian"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body name="rod"><joint name="hip" axis="0 1 0" damping="0.1"/>
  <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/>{more}</body></worldbody>
<actuator><position name="hip" joint="hip" kp="{kp}" kv="1" {limit}/>{drive}</actuator></mujoco>
"""
KNEE = """<body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0"/>
<geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.3"/></body>"""
POSITION, EFFORT = (Channel(joint="hip", signal=signal) for signal in ("position", "effort"))


def pendulum(kp=40, limit="", knee=False, **fields):
    text = PENDULUM.format(
        kp=kp,
        limit=limit,
        more=KNEE if knee else "",
        drive='<position name="knee" joint="knee" kp="20" kv="0.5"/>' if knee else "",
    )
    return robot_from_spec(mujoco.MjSpec.from_string(text), f"kp{kp}.xml")


def run(robot, seconds=2.0, name="log", amplitude=0.5, **planted):
    """A log of the model stepped by hand, with fields of the model set to other values."""
    model = robot.spec.copy().compile()
    for field, value in planted.items():
        getattr(model, field)[:] = value
    data, joints = mujoco.MjData(model), list(robot.joints)
    every = round(STEP / model.opt.timestep)
    time = STEP * np.arange(round(seconds / STEP))
    t = np.maximum(time - 0.1, 0)
    target = amplitude * (np.sin(5 * t + 3 * t**2) + 0.3 * np.sin(23 * t))
    rows = []
    for value in [0.0] * 1000 + target.tolist():
        data.ctrl[:] = value
        q = data.qpos.copy()
        mujoco.mj_step(model, data, every)
        rows.append((q, data.qfrc_actuator.copy()))
    columns = {}
    for k, joint in enumerate(joints):
        columns[f"{joint}/position"] = np.array([q[k] for q, _ in rows[1000:]])
        columns[f"{joint}/effort"] = np.array([e[k] for _, e in rows[1000:]])
        columns[f"{joint}/position_target"] = target
    return Recording(name=name, time=time, columns=columns)


def noisy(recording, rng, std=1e-3, memory=0.0):
    """The same with noise on the positions that forgets with a factor of `memory` a sample."""
    columns = dict(recording.columns)
    for name in columns:
        if name.endswith("/position"):
            white = std * np.sqrt(1 - memory**2) * rng.normal(size=len(recording.time))
            noise, _ = lfilter([1], [1, -memory], white, zi=[memory * std * rng.normal()])
            columns[name] = columns[name] + noise
    return replace(recording, columns=columns)


def objective(robot, recordings, channels=(POSITION,), floor=1e-4, **options):
    segments = [part for recording in recordings for part in whole(recording)]
    replay = Replay(robot, segments, channels, **options)
    return Objective([replay], channels, np.full(len(channels), floor))


def structure(robots, **sites):
    terms = [Term(effect=CATALOGUE[name], sites=tuple(where)) for name, where in sites.items()]
    return Structure(tuple(terms), tuple(robots))


def sized(robot, *recordings):
    return replace(robot, excursions=excursions(robot, recordings, list(robot.joints)))


# A ground to stand on, drives that all have a limit, or a voltage in the log.
NEED_MORE = {
    *("foot_offset", "ground_compliance", "ground_friction"),
    *("supply_sag", "supply_voltage"),
}


class TestStructure:
    def test_numbers_are_in_the_order_of_terms_places_parameters(self):
        robot = pendulum(knee=True)
        tried = structure([robot], parallel_spring=["knee", "hip"], base_tilt=[EVERYWHERE])
        slots = [(s.term.effect.name, s.place, s.parameter.name) for s in tried.slots]
        assert slots == [
            ("parallel_spring", "knee", "stiffness"),
            ("parallel_spring", "knee", "springref"),
            ("parallel_spring", "hip", "stiffness"),
            ("parallel_spring", "hip", "springref"),
            ("base_tilt", "*", "roll"),
            ("base_tilt", "*", "pitch"),
        ]
        np.testing.assert_array_equal(tried.columns(tried.terms[0], "hip"), [2, 3])
        np.testing.assert_array_equal(tried.columns(tried.terms[1]), [4, 5])
        for values in (tried.zero, tried.scale, *tried.bounds):
            assert values.shape == (6,)

    def test_each_place_gets_its_own_values_and_a_shared_one_serves_all(self):
        robot = pendulum(knee=True)
        apart = structure([robot], viscous_friction=["hip", "knee"])
        damping = apart.trials(robot, np.array([[0.1, 0.2], [0.3, 0.4]])).field("dof_damping")
        np.testing.assert_allclose(damping, [[0.2, 0.2], [0.4, 0.4]])
        shared = Structure(
            (Term(effect=CATALOGUE["command_delay"], sites=("hip", "knee"), shared=True),), (robot,)
        )
        trials = shared.trials(robot, np.array([[0.01]]))
        assert [trials.command_delay[j][0] for j in ("hip", "knee")] == [0.01, 0.01]

    def test_values_are_carried_by_name_and_from_shared_to_apart(self):
        robot = pendulum(knee=True)
        delay = Term(effect=CATALOGUE["command_delay"], sites=("hip", "knee"), shared=True)
        old = Structure((delay,), (robot,)).with_term(
            Term(effect=CATALOGUE["armature"], sites=("hip", "knee"))
        )
        new = structure([robot], armature=["knee"], viscous_friction=["hip"], command_delay=["hip"])
        np.testing.assert_array_equal(
            carried(np.array([0.01, 0.2, 0.3]), old, new), [0.3, 0.0, 0.01]
        )

    def test_candidates_are_where_all_robots_have_them(self):
        one, two = pendulum(), pendulum(knee=True)
        effects = [CATALOGUE[n] for n in ("viscous_friction", "payload", "command_delay")]
        terms = candidate_terms(effects, [two], ["hip", "knee"])
        assert [(t.effect.name, t.sites, t.shared) for t in terms] == [
            ("viscous_friction", ("hip", "knee"), False),
            ("payload", ("rod", "shank"), False),
            ("command_delay", ("hip", "knee"), True),
        ]
        terms = candidate_terms(effects, [one, two], ["hip"])
        assert [(t.sites, t.shared) for t in terms] == [
            (("hip",), False),
            (("rod",), False),
            (("hip",), False),
        ]

    def test_several_robots_share_the_tightest_bounds(self):
        stiff, soft = pendulum(kp=400), pendulum(kp=100)
        (slot,) = structure([stiff, soft], position_gain=["hip"]).slots
        assert (slot.parameter.lower, slot.parameter.upper) == (-99.9, 100_000)
        assert all(-99.9 <= start <= 100_000 for start in slot.parameter.starts)
        assert slot.parameter.scale == pytest.approx(40)

    @pytest.mark.parametrize("effect", sorted(CATALOGUE.keys() - NEED_MORE))
    def test_robots_that_differ_are_both_unchanged_at_zero(self, effect):
        weak = pendulum(kp=100, limit='forcerange="-3 3"')
        robots = (
            replace(pendulum(kp=400), excursions={"hip": Excursion(lower=1, upper=2, effort=9)}),
            replace(weak, excursions={"hip": Excursion(lower=-1, upper=-0.9, effort=2)}),
        )
        (term,) = candidate_terms([CATALOGUE[effect]], robots, ["hip"])
        tried = Structure((term,), robots)
        lower, upper = tried.bounds
        assert (lower < upper).all()
        assert ((lower <= tried.zero) & (tried.zero <= upper)).all()
        for robot in robots:
            recording = run(robot, 0.3)
            replay = Replay(robot, whole(recording), (POSITION, EFFORT))
            np.testing.assert_array_equal(
                replay.predict(tried.trials(robot, tried.zero[None])),
                replay.predict(Trials(robot, 1)),
            )


class TestEffectBase:
    def test_writing_a_class_registers_an_effect_of_the_package_alone(self):
        class Mine(JointEffect):
            name = "mine"

        assert "mine" not in registered()
        assert registered().keys() == CATALOGUE.keys()
        assert Mine.__abstractmethods__

    def test_joint_effects_act_where_they_can(self):
        robot = pendulum(knee=True)
        passive = robot_from_spec(
            mujoco.MjSpec.from_string(PENDULUM.format(kp=1, limit="", more=KNEE, drive="")), "x"
        )
        gain = CATALOGUE["position_gain"]
        assert gain.sites(robot, ["knee", "hip"]) == ("knee", "hip")
        assert gain.sites(passive, ["knee", "hip"]) == ("hip",)


class TestObjective:
    def test_residuals_are_predicted_minus_measured(self):
        robot = pendulum()
        recordings = [run(robot, 0.5), run(robot, 0.4, name="b", amplitude=0.2)]
        robot = sized(robot, *recordings)
        whole_objective = objective(robot, recordings, (POSITION, EFFORT))
        tried = structure([robot], viscous_friction=["hip"])
        values = np.array([[0.0], [0.3]])
        (residual,) = whole_objective.residuals([Case(structure=tried, values=values)])
        start = 0
        for recording in recordings:
            alone = Replay(robot, whole(recording), (POSITION, EFFORT))
            expected = alone.predict(tried.trials(robot, values)) - alone.measured
            stop = start + len(recording.time)
            np.testing.assert_array_equal(residual[:, start:stop], expected)
            start = stop

    def test_score_is_the_log_of_the_geometric_mean_gap(self):
        robot = pendulum()
        recording = run(robot, 0.5)
        one = objective(robot, [recording], (POSITION, EFFORT), floor=0.0)
        assert one.score(np.array([4e-6, 9.0])) == pytest.approx(np.log(np.sqrt(2e-3 * 3)))
        better = one.score(np.array([4e-6, 9.0]) * 0.95**2)
        assert one.score(np.array([4e-6, 9.0])) - better == pytest.approx(-np.log(0.95))
        assert one.score(np.array([np.nan, 1.0])) == np.inf

    def test_weights_are_the_gradient_of_the_score(self):
        robot = pendulum()
        one = objective(robot, [run(robot, 0.3)], (POSITION, EFFORT), floor=0.01)
        residual = np.random.default_rng(0).normal(size=one.measured.shape) * [0.02, 3.0]
        gradient = one.weights(one.mean_square(residual)) * residual
        for row, column in ((3, 0), (70, 1)):
            for move in (1e-5,):
                moved = np.stack([residual, residual])
                moved[:, row, column] += [-move, move]
                low, high = one.score(one.mean_square(moved))
                assert (high - low) / (2 * move) == pytest.approx(gradient[row, column], rel=1e-4)

    def test_blocks_are_half_seconds_of_a_segment(self):
        robot = pendulum()
        one = objective(robot, [run(robot, 1.2), run(robot, 0.7, name="b")])
        lengths = np.bincount(one.block)
        np.testing.assert_array_equal(lengths, [250, 250, 100, 250, 100])
        residual = np.arange(len(one.block), dtype=float)[:, None]
        np.testing.assert_allclose(
            one.block_squares(residual)[:, 0],
            [np.sum(residual[one.block == b] ** 2) for b in range(5)],
        )
        np.testing.assert_array_equal(one.block_counts()[:, 0], lengths)

    def test_signals_that_only_some_recordings_have(self):
        robot = pendulum()
        full, other = run(robot, 0.4, dof_damping=0.4), run(robot, 0.6, name="b", dof_damping=0.4)
        less = replace(other, columns={k: v for k, v in other.columns.items() if "effort" not in k})
        both = objective(robot, [full, less], (POSITION, EFFORT))
        np.testing.assert_array_equal(both.count, [500, 200])
        tried = structure([robot], viscous_friction=["hip"])
        (residual,) = both.residuals([Case(structure=tried, values=np.array([[0.0]]))])
        assert np.isfinite(residual).all()
        assert not residual[0, 200:, 1].any()
        # Where no recording has the signal it says nothing, and does not spoil the rest.
        none = objective(robot, [less], (POSITION, EFFORT))
        (start,) = evaluate(none, [(tried, np.zeros(1))])
        (found,) = fit(none, [start])
        assert found.values[0] == pytest.approx(0.3, rel=1e-3)

    def test_a_perfect_prediction_has_a_score_without_any_noise(self):
        robot = pendulum()
        one = objective(robot, [run(robot, 0.3)], floor=0.0)
        assert np.isfinite(one.score(np.zeros(1)))

    def test_trials_that_diverge_are_nan_alone(self):
        robot = pendulum()
        one = objective(robot, [run(robot, 0.3), run(robot, 0.3, name="b")], (POSITION, EFFORT))
        wild = structure([robot], velocity_gain=["hip"])
        values = np.array([[0.0], [-1e9], [0.1]])
        good, bad = [Case(structure=wild, values=values[k]) for k in ([0, 2], [1])]
        together, apart = (
            one.residuals([Case(structure=wild, values=values)])[0],
            one.residuals([good, bad]),
        )
        assert np.isnan(together[1]).all()
        np.testing.assert_array_equal(together[[0, 2]], apart[0])
        (scores,) = [one.score(squares) for squares in one.mean_squares([bad])]
        assert scores == np.inf

    def test_numerical_error_of_the_timestep_is_no_gap(self):
        # The machine is the model at a sixteenth of its step.
        robot = pendulum(kp=2500)
        fine = robot.refined(16)
        model, data = fine.model, mujoco.MjData(fine.model)
        time = STEP * np.arange(500)
        target = 0.3 * np.sign(np.sin(8 * np.maximum(time - 0.1, 0)))
        position = []
        for value in target:
            position.append(float(data.qpos[0]))
            data.ctrl[:] = value
            mujoco.mj_step(model, data, 16)
        recording = Recording(
            name="log",
            time=time,
            columns={"hip/position": np.array(position), "hip/position_target": target},
        )
        case = Case(structure=Structure((), (robot,)), values=np.zeros((1, 0)))
        made = {
            "half": {"factor": 2},
            "integrator": {"factor": 2, "other_integrator": True},
            "quarter": {"factor": 4},
        }

        def taken_out(floor: float) -> tuple[int, float]:
            one = objective(robot, [recording], floor=floor)
            finer = {
                way: objective(robot.refined(**each), [recording], floor=floor)
                for way, each in made.items()
            }
            one.refine(finer, case)
            return len(one.numerical.changes), np.sqrt(one.mean_squares([case])[0][0, 0])

        raw = np.sqrt(objective(robot, [recording], floor=1e-6).mean_squares([case])[0][0, 0])
        assert raw > 2e-4
        two, left_by_two = taken_out(raw)
        three, left_by_three = taken_out(1e-6)
        assert (two, three) == (2, 3)
        assert left_by_two < 0.25 * raw
        assert left_by_three < 0.6 * left_by_two

    def test_a_numerical_error_that_stays_as_it_was_is_not_found_again(self):
        robot = pendulum()
        parts = stretches(run(robot, dof_damping=2.1), 0.25)  # instead of 0.1

        def compared(robot) -> Objective:
            return Objective([Replay(robot, parts, [POSITION])], [POSITION], np.array([1e-6]))

        one, finer = compared(robot), {"half": compared(robot.refined(2))}

        def found_at(*values: float, **sites: list[str]) -> bool:
            """Whether the error at some values is another than the one before."""
            before = one.numerical
            case = Case(structure=structure([robot], **sites), values=np.array([values]))
            one.refine(finer, case)
            return one.numerical is not before

        def error_at(*values: float, **sites: list[str]):
            """The error at some values, found anew."""
            other = compared(robot)
            other.refine(
                finer, Case(structure=structure([robot], **sites), values=np.array([values]))
            )
            return other.numerical.changes

        damped = {"viscous_friction": ["hip"]}
        assert found_at()
        assert not found_at(0.2, **damped)  # which is nothing beside the gap
        assert not found_at(0.2, 0.01, **damped, armature=["hip"])
        assert found_at(2.0, **damped)  # where hardly any gap is left
        case = Case(structure=structure([robot], **damped), values=np.array([[1.9]]))
        known = error_at(1.9, **damped)[0]
        few, rows = finer["half"].of_segments(one.telling([known], known))
        assert 0 < rows.sum() < 0.3 * len(rows)
        gap = np.sqrt(one.mean_square(one.simulated([case])[0][0]))
        again = found_at(1.9, **damped)
        moved = np.sqrt(one.mean_square(one.numerical.changes - error_at(1.9, **damped)))
        assert again or (moved < 0.05 * gap).all()
        assert few.steps < 0.6 * one.steps

    def test_a_numerical_error_that_few_stretches_have_is_looked_at_there(self):
        robot = pendulum()
        still = stretches(run(robot, amplitude=0.001, dof_damping=2.1), 0.25)
        far = stretches(run(robot, amplitude=1.5, dof_damping=2.1), 0.25)[-1]
        parts = [*still[:2], far, *still[3:]]  # of which every eighth would be the fifth

        def compared(robot) -> Objective:
            return Objective([Replay(robot, parts, [POSITION])], [POSITION], np.array([1e-4]))

        one, finer = compared(robot), {"half": compared(robot.refined(2))}
        tried = structure([robot], viscous_friction=["hip"])
        own = Case(structure=tried, values=np.zeros((1, 1)))
        one.refine(finer, own)
        (error,) = one.numerical.changes
        (chosen,) = one.telling([error], one.simulated([own])[0][0])
        assert chosen == (2, 4)
        before = one.numerical
        one.refine(finer, Case(structure=tried, values=np.array([[2.0]])))
        assert one.numerical is not before

    def test_how_the_solver_rounds_off_dry_friction_is_no_gap(self):
        # The machine sticks; the model creeps, as MuJoCo's friction does unless it is told not to.
        spec = pendulum(kp=20).spec.copy()
        spec.joint("hip").frictionloss = 0.3
        robot = robot_from_spec(spec, "rubbing.xml")
        assert robot.has_dry_friction
        recording = run(robot.refined(4, as_dry_as_it_goes=True))
        case = Case(structure=Structure((), (robot,)), values=np.zeros((1, 0)))
        one = objective(robot, [recording], floor=1e-5)
        (raw,) = np.sqrt(one.mean_squares([case])[0][0])
        finer = {
            "half": robot.refined(2),
            "integrator": robot.refined(2, other_integrator=True),
            "friction": robot.refined(2, as_dry_as_it_goes=True),
        }
        left = []
        for ways in (("half", "integrator"), tuple(finer)):
            one = objective(robot, [recording], floor=1e-5)
            one.refine({w: objective(finer[w], [recording], floor=1e-5) for w in ways}, case)
            assert one.numerical.ways == ways
            left.append(float(np.sqrt(one.mean_squares([case])[0][0, 0])))
        assert left[1] < 0.3 * left[0] < 0.3 * raw, (left, raw)

    @pytest.mark.parametrize("factor", [1.5, -1.5], ids=["free", "at its bound"])
    def test_linearised_is_the_slope_of_the_residuals(self, factor):
        robot = pendulum()
        one = objective(robot, [run(robot, 0.5, dof_damping=0.4)])
        tried = structure([robot], viscous_friction=["hip"])
        values = np.array([[0.1], [0.1001], [-1e9]])
        case = Case(structure=tried, values=values)
        (residual,) = one.residuals([case])
        # A timestep that would make up for two thirds of the gap, and for nothing where it cannot.
        part = (one.block + np.arange(len(one.block)) % 3 > 0)[:, None]
        one.numerical = NumericalError(
            ("half", "integrator"),
            np.stack([-residual[0] * part / factor, np.roll(residual[0], 40, axis=0)]),
        )
        (corrected,) = one.residuals([case])
        moves = one.moves([None, None])
        at, changes = one.corrected(residual[0], moves.apart(residual[1:] - residual[:1]))
        np.testing.assert_array_equal(at, corrected[0])
        expected = corrected[1] - corrected[0]
        np.testing.assert_allclose(changes[0], expected, atol=1e-3 * np.abs(expected).max())
        plain = residual[1] - residual[0]
        assert (np.abs(plain - expected).max() > 0.1 * np.abs(plain).max()) == (factor > 0)
        assert np.isnan(changes[1]).all()

    def test_memory_is_bounded_by_grouping_cases(self):
        robot = pendulum()
        one = objective(robot, [run(robot, 0.3)])
        tried = structure([robot], viscous_friction=["hip"])
        cases = [Case(structure=tried, values=np.zeros((n, 1))) for n in (1, 2, 3)]
        assert one.grouped(cases) == [slice(0, 3)]
        assert one.grouped([]) == []


@pytest.fixture(scope="module")
def problem():
    robot = pendulum()
    recording = run(robot, dof_damping=0.35, dof_armature=0.02)
    robot = sized(robot, recording)
    return robot, recording, objective(robot, [recording], (POSITION, EFFORT))


def counted(robot, recording):
    """An objective, and a list to which every simulation of it adds how many robots it had.

    It remembers nothing, so that what comes first takes as many as what comes after it.
    """
    rows = []

    class Forgetful(Recent):
        def get(self, key):
            return None

    class Counted(Objective):
        def _less_measured(self, predicted):
            rows.append(len(predicted[0]))
            return super()._less_measured(predicted)

    replay = Replay(robot, whole(recording), (POSITION, EFFORT))
    return Counted([replay], (POSITION, EFFORT), np.full(2, 1e-4), recent=Forgetful()), rows


class TestPolish:
    def test_finds_the_best_in_fewer_simulations(self, problem):
        robot, recording, _ = problem
        one, rows = counted(robot, recording)
        tried = structure([robot], viscous_friction=["hip"], armature=["hip"])
        (near,) = evaluate(one, [(tried, np.array([0.24, 0.021]))])
        rows.clear()
        (expected,) = fit(one, [near])
        by_fit = sum(rows)
        rows.clear()
        found, slopes = polish(one, near)
        assert sum(rows) < 0.5 * by_fit
        assert found.score == pytest.approx(expected.score, abs=3e-4)
        np.testing.assert_allclose(found.values, expected.values, rtol=1e-3)
        np.testing.assert_array_equal(
            slopes.residual, one.residuals([Case(structure=tried, values=found.values[None])])[0][0]
        )
        scale = np.abs(linearised(one, found).jacobian).max(axis=(1, 2), keepdims=True)
        np.testing.assert_allclose(
            slopes.jacobian / scale, linearised(one, found).jacobian / scale, atol=0.02
        )
        for own, known in zip(
            covariance(one, found), covariance(one, found, slopes=slopes), strict=True
        ):
            np.testing.assert_allclose(own, known, rtol=0.1, atol=1e-12)

    def test_from_afar_damps_its_steps(self, problem):
        robot, _, one = problem
        tried = structure([robot], viscous_friction=["hip"], armature=["hip"])
        far = Fit(structure=tried, values=tried.bounds[1], score=np.inf, mean_square=np.zeros(2))
        found, _ = polish(one, far)
        np.testing.assert_allclose(found.values, [0.25, 0.02], rtol=1e-3)

    def test_a_step_that_bounds_cut_short_is_not_the_end(self):
        """A long step along a valley that a bound cuts across leads uphill; shorter ones do not."""
        one, trials = np.array([0.0, 0.0]), SimpleNamespace(structure=SimpleNamespace())
        trials.values, trials.structure.scale = one, np.ones(2)
        trials.structure.bounds = (np.full(2, -1.0), np.full(2, 1.0))
        trials.mean_square = np.ones(1)
        normal = np.array([[1.0, -0.99], [-0.99, 0.9802]])
        gradient = -normal @ np.array([-30.0, -31.0])
        ordered, promised = fit_module._most_promising_first(trials, normal, gradient)
        own = [-(step @ gradient) - 0.5 * step @ normal @ step for step in ordered]
        assert promised == pytest.approx(own[0])
        assert own == sorted(own, reverse=True)
        assert promised > 0

    def test_a_start_is_near_enough_before_it_is_certain(self, problem):
        robot, recording, _ = problem
        one, rows = counted(robot, recording)
        tried = structure([robot], viscous_friction=["hip"], armature=["hip"])
        far = Fit(structure=tried, values=tried.bounds[1], score=np.inf, mean_square=np.zeros(2))
        best, _ = polish(one, far)
        certain = sum(rows)
        rows.clear()
        found, _ = polish(one, far, near_enough=True)
        assert sum(rows) < certain
        np.testing.assert_allclose(found.values, best.values, rtol=0.05)

    def test_what_cannot_catch_up_with_its_leader_goes_no_further(self, problem):
        robot, recording, _ = problem
        one, rows = counted(robot, recording)
        hopeless = structure([robot], armature=["hip"])
        (start,) = evaluate(one, [(hopeless, hopeless.zero)])
        rows.clear()
        alone, _ = polish(one, start)
        to_its_end = sum(rows)
        for leader, least, most in [(alone.score, 0.9, 1.0), (alone.score - 3.0, 0.0, 0.5)]:
            rows.clear()
            found, _ = polish(one, start, leader=leader)
            assert least * to_its_end <= sum(rows) <= most * to_its_end
            assert alone.score <= found.score <= start.score + 1e-12

    def test_numerical_error_is_taken_out_of_slopes_without_simulating_them_again(self, problem):
        robot, recording, _ = problem
        one, finer = (
            objective(model, [recording], (POSITION, EFFORT)) for model in (robot, robot.refined(2))
        )
        tried = structure([robot], viscous_friction=["hip"], armature=["hip"])
        case = Case(structure=tried, values=np.array([[0.2, 0.01]]))
        (start,) = evaluate(one, [(tried, case.values[0])])
        _, slopes = polish(one, start, iterations=0)
        one.refine({"half": finer}, case, slopes.residual)
        assert one.numerical.changes.any()
        slopes.correct(one)
        _, simulated = polish(one, start, iterations=0)
        np.testing.assert_allclose(slopes.residual, simulated.residual, atol=1e-12)
        np.testing.assert_allclose(slopes.jacobian, simulated.jacobian, atol=1e-9)


class TestFit:
    def test_finds_two_effects_at_once(self, problem):
        robot, _, one = problem
        tried = structure([robot], viscous_friction=["hip"], armature=["hip"])
        (start,) = evaluate(one, [(tried, tried.zero)])
        (found,) = fit(one, [start])
        np.testing.assert_allclose(found.values, [0.25, 0.02], rtol=1e-4)
        assert found.score < start.score - 3
        again = evaluate(one, [(found.structure, found.values)])[0]
        assert again.score == pytest.approx(found.score)
        np.testing.assert_allclose(again.mean_square, found.mean_square)

    def test_many_starts_at_once_are_each_as_alone(self, problem):
        robot, _, one = problem
        kinds = ("viscous_friction", "armature", "torque_bias")
        starts = [
            evaluate(one, [(tried, tried.zero)])[0]
            for tried in (structure([robot], **{kind: ["hip"]}) for kind in kinds)
        ]
        together = fit(one, starts)
        for start, found in zip(starts, together, strict=True):
            (alone,) = fit(one, [start])
            np.testing.assert_array_equal(found.values, alone.values)
            assert found.score <= start.score

    def test_slopes_of_a_known_fit_serve_however_many_starts_fit_into_memory(
        self, problem, monkeypatch
    ):
        robot, recording, _ = problem
        kinds = ("torque_bias", "viscous_friction", "parallel_spring")
        known = structure([robot], armature=["hip"])
        found, simulated = [], []
        for memory in (2**28, 1):
            monkeypatch.setattr(fit_module, "_KEPT", memory)
            one, rows = counted(robot, recording)
            (near,) = evaluate(one, [(known, np.array([0.01]))])
            starts = [
                evaluate(one, [(tried, carried(near.values, known, tried))])[0]
                for tried in (structure([robot], armature=["hip"], **{k: ["hip"]}) for k in kinds)
            ]
            slopes = linearised(one, near)
            rows.clear()
            found.append(fit(one, starts, iterations=1, near=slopes))
            simulated.append(sum(rows))
        assert simulated[0] == simulated[1]
        for one, other in zip(*found, strict=True):
            np.testing.assert_array_equal(one.values, other.values)

    def test_stays_within_its_bounds_and_finds_the_best_there(self, problem):
        robot, _, _ = problem
        # Damping can be taken away, and friction that is not there cannot.
        recording = run(robot, dof_damping=0.02)
        less = objective(robot, [recording])
        for name, bound in (("viscous_friction", None), ("coulomb_friction", 0.0)):
            tried = structure([robot], **{name: ["hip"]})
            (start,) = evaluate(less, [(tried, np.array([0.5 * tried.scale[0]]))])
            (found,) = fit(less, [start], iterations=20)
            lower, upper = tried.bounds
            assert lower[0] <= found.values[0] <= upper[0]
            expected = -0.08 if bound is None else bound
            assert found.values[0] == pytest.approx(expected, abs=2e-3 * tried.scale[0])

    def test_never_leaves_its_bounds_not_even_to_perturb(self, problem, monkeypatch):
        robot, _, one = problem
        tried = structure([robot], viscous_friction=["hip"], armature=["hip"])
        lower, upper = tried.bounds
        seen, perturbed = [], []

        class Watched(Objective):
            def residuals(self, cases):
                seen.extend(row for case in cases for row in case.values)
                return super().residuals(cases)

        def perturbing(*given):
            found = perturb(*given)
            perturbed.extend(found.case.values[1:])
            return found

        perturb = slopes_module._perturbed
        monkeypatch.setattr(slopes_module, "_perturbed", perturbing)
        watched = Watched(one.replays, one.channels, one.floor)
        (found,) = fit(watched, evaluate(watched, [(tried, upper)]))
        assert len(seen) > 10
        assert len(perturbed) > 1
        assert all(((lower <= row) & (row <= upper)).all() for row in seen + perturbed)
        assert (found.values < upper).any()

    def test_at_a_bound_the_rest_is_as_good_as_it_can_be(self):
        robot = pendulum()
        # The machine is livelier than the model without any damping, which is the least it has.
        recording = run(robot, dof_damping=-0.1, dof_armature=0.02)
        robot = sized(robot, recording)
        one = objective(robot, [recording])
        both = structure([robot], viscous_friction=["hip"], armature=["hip"])
        (found,) = fit(one, evaluate(one, [(both, np.array([0.1, 0.0]))]), iterations=20)
        assert found.values[0] == pytest.approx(-0.1, abs=1e-9)
        grid = found.values[1] + np.linspace(-2e-3, 2e-3, 81)
        case = Case(structure=both, values=np.stack([np.full(81, -0.1), grid], axis=1))
        (squares,) = one.mean_squares([case])
        probable = one.score(squares) + one.penalty(both, case.values)
        assert found.score <= probable.min() + 1e-4

    def test_what_is_behind_a_leader_goes_on_while_it_can_catch_up(self, problem):
        robot, _, one = problem
        tried = structure([robot], viscous_friction=["hip"], armature=["hip"])
        (start,) = evaluate(one, [(tried, np.array([3.0, 0.3]))])

        def score(steps, leader=np.inf):
            return fit(one, [start], iterations=steps, leader=leader)[0].score

        once, twice = score(1), score(2)
        gain = start.score - once
        assert score(1, once + 0.1) == once  # it is ahead
        assert score(1, once - 2 * gain) == twice < once - 2 * gain
        assert score(1, once - 5 * gain) == once  # a step gains less than the one before
        assert score(1, once - 3.5 * gain) == score(3) < once - 3.5 * gain < twice

    @pytest.mark.parametrize("start", [0.2, 0.275, 0.279, 0.2795, 0.285])
    def test_a_numerical_error_that_looks_like_the_effect_does_not_hold_it_up(
        self, start, monkeypatch
    ):
        # All of it is known here, so that nothing of it is left.
        monkeypatch.setattr("walkerkit.gap.search.objective.NUMERICAL_LEFT", 0.0)
        robot = pendulum()
        recording = run(robot, dof_damping=0.35)
        one = objective(robot, [recording], floor=1e-5)
        tried = structure([sized(robot, recording)], viscous_friction=["hip"])
        vars(tried)["prior"] = np.array([np.inf])  # which draws it as well
        ((more, true),) = one.residuals([Case(structure=tried, values=np.array([[0.27], [0.25]]))])
        # Up to 0.28 the timestep can make up for too much damping, but for a ripple.
        ripple = 3e-5 * np.sin(np.arange(len(true)))[:, None]
        one.numerical = NumericalError(("half",), (more - true + ripple)[None])
        one.measured = one.measured + 1.5 * one.numerical.changes[0]
        (found,) = fit(one, evaluate(one, [(tried, np.array([start]))]), iterations=20)
        assert found.values[0] == pytest.approx(0.25, abs=2e-3)

    def test_what_the_recordings_do_not_feel_stays_where_its_prior_has_it(self):
        robot = pendulum()
        # The joint turns about y, so only a pitch matters to it; a roll does in second order.
        spec = robot.spec.copy()
        spec.option.gravity = 9.81 * np.array([-np.sin(0.1), 0, -np.cos(0.1)])
        recording = run(robot_from_spec(spec, "tilted.xml"))
        recording = noisy(recording, np.random.default_rng(0))
        robot = sized(robot, recording)
        one = objective(robot, [recording], (POSITION, EFFORT), floor=5e-4)
        tried = structure([robot], base_tilt=[EVERYWHERE])
        (found,) = fit(one, evaluate(one, [(tried, np.array([0.0, 0.06]))]))
        roll, pitch = found.values
        assert roll == pytest.approx(0.0, abs=1e-3)
        assert pitch == pytest.approx(0.1, rel=0.01)
        _, sensitivity = covariance(one, found)
        assert sensitivity[0] < INSENSITIVE < sensitivity[1]

    def test_a_start_that_diverges_is_handed_back_untouched(self, problem):
        robot, _, one = problem
        tried = structure([robot], velocity_gain=["hip"])
        wild = Fit(
            structure=tried, values=np.array([-1e9]), score=np.inf, mean_square=np.full(2, np.nan)
        )
        nothing = evaluate(one, [(Structure((), (robot,)), np.zeros(0))])[0]
        assert fit(one, [wild, nothing]) == [wild, nothing]

    def test_reports_its_progress(self, problem):
        robot, _, one = problem
        tried = structure([robot], viscous_friction=["hip"])
        told = []
        fit(
            one,
            evaluate(one, [(tried, tried.zero)]),
            iterations=3,
            progress=lambda stage, part: told.append((stage, part)),
            stage="friction",
        )
        assert told[0] == ("friction", 0.0)
        assert all(stage == "friction" and 0 <= part < 1 for stage, part in told)

    def test_threads_change_nothing(self, problem):
        robot, recording, _ = problem
        tried = structure([robot], viscous_friction=["hip"], torque_bias=["hip"])
        found = []
        for n in (1, 2):
            one = objective(robot, [recording], n_threads=n)
            found.append(fit(one, evaluate(one, [(tried, tried.zero)]))[0].values)
        np.testing.assert_array_equal(*found)

    def test_what_was_simulated_is_not_simulated_again(self, problem, monkeypatch):
        robot, recording, _ = problem
        one, simulated = objective(robot, [recording]), []

        def counting(replays, trials, n_threads):
            simulated.append(sum(each.n for each in trials))
            return predict_together(replays, trials, n_threads)

        monkeypatch.setattr(objectives, "predict_together", counting)
        case = Case(structure=structure([robot], armature=["hip"]), values=np.array([[0.0], [0.1]]))
        (first,) = one.simulated([case])
        (mixed,) = one.apart().simulated([replace(case, values=np.array([[0.1], [0.2], [0.0]]))])
        (fresh,) = objective(robot, [recording]).simulated([case])
        assert simulated == [2, 1, 2]
        np.testing.assert_array_equal(mixed[[2, 0]], first)
        np.testing.assert_array_equal(first, fresh)

    def test_two_robots_share_their_values(self):
        stiff, soft = pendulum(kp=60), pendulum(kp=20)
        logs = [run(robot, 1.0, dof_armature=0.02) for robot in (stiff, soft)]
        robots = [sized(robot, log) for robot, log in zip((stiff, soft), logs, strict=True)]
        replays = [
            Replay(robot, windows(log, 0.5), (POSITION,))
            for robot, log in zip(robots, logs, strict=True)
        ]
        one = Objective(replays, (POSITION,), np.array([1e-5]))
        tried = structure(robots, armature=["hip"], viscous_friction=["hip"])
        (found,) = fit(one, evaluate(one, [(tried, tried.zero)]), iterations=20)
        assert found.values[0] == pytest.approx(0.02, rel=0.01)
        assert found.values[1] == pytest.approx(0.0, abs=2e-3)


READ = "hip/position"


class TestRobustly:
    def test_a_wild_block_does_not_draw_the_values(self):
        robot = pendulum()
        clean = run(robot, 6.0, dof_damping=0.35)
        robot = sized(robot, clean)
        columns = dict(clean.columns)
        pushed = (clean.time > 2.0) & (clean.time < 2.4)
        columns[READ] = columns[READ] + np.where(pushed, 0.2, 0.0)
        rng = np.random.default_rng(1)
        half = Half(
            recordings=(),
            told=(),
            objective=objective(robot, [noisy(replace(clean, columns=columns), rng)], floor=1e-3),
            make_finer=dict,
        )
        half = replace(half, make_finer=lambda: {"half": half.objective})
        tried = structure([robot], viscous_friction=["hip"])
        (start,) = evaluate(half.objective, [(tried, np.array([0.25]))])
        drawn = settled(half, start, passes=1)
        slopes = linearised(half.objective, drawn)
        found = robustly(half, drawn, slopes, np.full(1, 1e-3))
        assert abs(found.values[0] - 0.25) < 0.2 * abs(drawn.values[0] - 0.25)
        assert found.values[0] == pytest.approx(0.25, rel=0.03)


class TestCovariance:
    @pytest.mark.parametrize("memory", [0.0, 0.97], ids=["white", "coloured"])
    def test_is_the_spread_of_estimates_over_noise(self, memory):
        robot = pendulum()
        clean = run(robot, 6.0, dof_damping=0.35)
        robot = sized(robot, clean)
        tried = structure([robot], viscous_friction=["hip"], torque_bias=["hip"])
        rng, values, claimed = np.random.default_rng(7), [], []
        for _ in range(24):
            one = objective(robot, [noisy(clean, rng, memory=memory)], floor=1e-3)
            (found,) = fit(one, evaluate(one, [(tried, np.array([0.25, 0.0]))]), iterations=3)
            values.append(found.values)
            claimed.append(np.diag(covariance(one, found)[0]))
        spread, typical = np.std(values, axis=0), np.sqrt(np.mean(claimed, axis=0))
        # The spread of 24 values is known to 15 per cent; twelve blocks give no better a claim.
        ratio = typical / spread
        assert ((ratio > 0.55) & (ratio < 1.6)).all(), ratio
        np.testing.assert_array_less(np.abs(np.mean(values, axis=0) - [0.25, 0]), 1.0 * spread)

    def test_what_the_recordings_do_not_show_has_no_sensitivity(self):
        robot = pendulum()
        recording = run(robot, 0.5)
        tried = structure([sized(robot, recording)], parallel_spring=["hip"])
        one = objective(robot, [recording])
        _, sensitivity = covariance(one, evaluate(one, [(tried, tried.zero)])[0])
        stiffness, springref = sensitivity
        assert stiffness > 1
        assert springref == 0.0

    def test_what_nothing_parts_is_known_as_well_as_before_the_log(self):
        """A spring's rest and a constant torque are one number of its effort."""
        robot = pendulum()
        recording = run(robot, 0.5)
        tried = structure([sized(robot, recording)], parallel_spring=["hip"], torque_bias=["hip"])
        one = objective(robot, [recording])
        (found,) = evaluate(one, [(tried, np.array([1.0, 0.1, 0.0]))])
        variance, _ = covariance(one, found, one.floor)
        stiffness, _, bias = np.sqrt(np.diag(variance)) / tried.prior
        assert stiffness < 0.3
        assert 0.3 < bias <= 1.0

    def test_a_prior_holds_a_number_as_steeply_as_the_fit_is_drawn(self):
        tried = structure([pendulum()], position_gain=["hip"], torque_bias=["hip"])
        for far in (0.3, 30.0):
            values = tried.zero + far * tried.prior
            slopes = approx_fprime(values, lambda at: tried.surprise(at).sum(), 1e-6 * tried.prior)
            steep = slopes * tried.scale
            normal = tried.prior_curvature(values) * (values - tried.zero) / tried.scale
            np.testing.assert_allclose(normal, steep, rtol=1e-4)

    def test_what_is_far_from_its_prior_is_held_by_it_the_less(self):
        """Without stiffness nothing is felt of where a spring rests."""
        robot = pendulum()
        recording = run(robot, 0.5)
        tried = structure([sized(robot, recording)], parallel_spring=["hip"])
        one = objective(robot, [recording])
        for far in (0.0, 30.0):
            (found,) = evaluate(one, [(tried, tried.zero + np.array([0.0, far * tried.prior[1]]))])
            variance, _ = covariance(one, found)
            held = np.sqrt((TAILS + far**2) / TAILS) * tried.prior[1]
            assert np.sqrt(variance[1, 1]) == pytest.approx(held, rel=0.02)

    def test_delays_within_a_timestep_are_not_known_to_be_there(self):
        robot = pendulum()
        tried = structure([robot], sensor_delay=["hip"])

        def known(steps: float) -> float:
            recording = run(robot)
            read = np.interp(recording.time - steps * STEP, recording.time, recording.columns[READ])
            late = replace(recording, columns=dict(recording.columns) | {READ: read})
            one = objective(robot, [late], floor=1e-6)
            (fit,) = evaluate(one, [(tried, np.array([steps * STEP]))])
            variance, _ = covariance(one, fit, one.floor)
            return float(fit.values[0] / np.sqrt(variance[0, 0]))

        assert known(0.2) < 1.0
        assert known(4.0) == pytest.approx(16.0, rel=0.1)


class TestScreen:
    def test_starts_at_the_magnitude_that_explains_most(self):
        robot = pendulum(knee=True)
        channels = tuple(Channel(joint=j, signal="position") for j in ("hip", "knee"))
        recording = run(robot, dof_damping=[0.9, 0.2])
        robot = sized(robot, recording)
        replay = Replay(robot, whole(recording), channels)
        one = Objective([replay], channels, np.full(2, 1e-4))
        (base,) = evaluate(one, [(Structure((), (robot,)), np.zeros(0))])
        terms = candidate_terms(
            [CATALOGUE[n] for n in ("viscous_friction", "command_delay")], [robot], ["hip", "knee"]
        )
        viscous, delay = screen(one, base, terms)
        size = {j: CATALOGUE["viscous_friction"].parameters(robot, j)[0] for j in ("hip", "knee")}
        tried = viscous.structure
        grid = [[h, k] for h in (0, *size["hip"].starts) for k in (0, *size["knee"].starts)]
        scores = [found.score for found in evaluate(one, [(tried, np.array(v)) for v in grid])]
        # 0.8 and 0.2 are planted.
        np.testing.assert_array_equal(
            viscous.values, [size["hip"].starts[1], size["knee"].starts[1]]
        )
        # Place by place is as good as the full grid here, or nearly.
        assert viscous.score <= min(scores) + 0.1
        assert viscous.score < base.score
        assert len(delay.values) == 1
        assert delay.score >= viscous.score

    def test_keeps_what_is_explained_already(self):
        robot = pendulum()
        recording = run(robot, dof_damping=0.35, dof_armature=0.02)
        robot = sized(robot, recording)
        one = objective(robot, [recording])
        known = structure([robot], armature=["hip"])
        (base,) = evaluate(one, [(known, np.array([0.02]))])
        (found,) = screen(one, base, [Term(effect=CATALOGUE["viscous_friction"], sites=("hip",))])
        assert found.values[0] == 0.02
        assert found.values[1] > 0
        assert found.score < base.score

    def test_sees_a_limit_that_binds_in_single_steps_alone(self):
        robot = pendulum(kp=200)
        time = STEP * np.arange(1000)
        target = np.where((time > 0.5) & (time < 1.3), 0.3, 0.0)
        model = robot.spec.copy().compile()
        model.actuator_forcelimited[:] = 1
        model.actuator_forcerange[:] = (-30, 30)
        data, rows = mujoco.MjData(model), []
        for value in target:
            data.ctrl[:] = value
            q = float(data.qpos[0])
            mujoco.mj_step(model, data)
            rows.append((q, float(data.qfrc_actuator[0])))
        position, effort = np.array(rows).T
        columns = {
            "hip/position": position,
            "hip/effort": effort,
            "hip/position_target": target,
        }
        recording = Recording(name="steps", time=time, columns=columns)
        robot = sized(robot, recording)
        one = objective(robot, [recording], (POSITION, EFFORT))
        (base,) = evaluate(one, [(Structure((), (robot,)), np.zeros(0))])
        (start,) = screen(one, base, [Term(effect=CATALOGUE["effort_limit"], sites=("hip",))])
        assert start.score < base.score
        (found,) = fit(one, [start], iterations=20)
        assert found.values[0] == pytest.approx(30, rel=0.02)

    def test_a_place_without_room_stays_as_it_is(self):
        class Stuck(JointEffect):
            name = "stuck"
            equation = symptom = added_as = source = "none"

            def acts_on(self, robot, joint):
                return True

            def parameters(self, robot, site):
                return (
                    Parameter(name="x", unit="1", lower=0, upper=1, scale=1, starts=(0.0, 0.0)),
                )

            def apply(self, trials, site, values):
                trials.effort_offset[site] += values[:, 0]

        robot = pendulum()
        one = objective(robot, [run(robot, 0.3)])
        (base,) = evaluate(one, [(Structure((), (robot,)), np.zeros(0))])
        (found,) = screen(one, base, [Term(effect=Stuck(), sites=("hip",))])
        np.testing.assert_array_equal(found.values, [0.0])
