"""Others' methods on a log of one servo whose friction is known."""

import mujoco
import numpy as np
import pytest

from benchmarks.rivals import mujoco_sysid
from benchmarks.rivals.logs import LOGS
from benchmarks.rivals.published import PUBLISHED, count, published
from benchmarks.rivals.structures import NESTED, STRUCTURES, fit, mended, start_from, structure
from walkerkit import gap
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.fit import evaluate
from walkerkit.gap.search.structure import Structure, candidate_terms

JOINT = "shaft"
SERVO = '<position joint="shaft" kp="20" kv="0.6" forcerange="-8 8"/>'
MOTOR = '<motor joint="shaft"/>'
TRUE = {"armature": 0.012, "damping": 0.15, "frictionloss": 0.2}
# As dry as it goes at that timestep.
DRY = 'solreffriction="0.001 1" solimpfriction="0.99 0.99 0.001 0.5 2"'


def bench(actuator, joint="", timestep=0.001):
    return f"""
<mujoco><compiler angle="radian"/>
  <option timestep="{timestep}" integrator="implicitfast"/>
  <worldbody><body name="arm"><joint name="shaft" axis="0 1 0" {joint}/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.4" contype="0"/></body>
  </worldbody><actuator>{actuator}</actuator></mujoco>
"""


def recorded(xml, name, target, *, kind="position", seconds=1.2, every=8):
    """What a robot at half the timestep does with a target, logged at 250 Hz."""
    model = mujoco.MjModel.from_xml_string(xml)
    data = mujoco.MjData(model)
    columns = {"position": [], f"{kind}_target": []}
    time = []
    for step in range(round(seconds / model.opt.timestep)):
        if step % every == 0:
            data.ctrl[0] = target(data.time)
            time.append(data.time)
            columns["position"].append(data.qpos[0])
            columns[f"{kind}_target"].append(data.ctrl[0])
        mujoco.mj_step(model, data)
    signals = {f"{JOINT}/{signal}": np.array(values) for signal, values in columns.items()}
    return gap.Recording(name=name, time=np.array(time), columns=signals)


def problem_of(folder, actuator, *, kind="position", size=0.4):
    path = folder / "bench.xml"
    path.write_text(bench(actuator), encoding="utf-8")
    attributes = " ".join(f'{name}="{value}"' for name, value in TRUE.items())
    true = bench(actuator, f"{attributes} {DRY}", timestep=0.0005)
    fast = recorded(true, "fast", lambda t: size * np.sin(4 * t + 4 * t**2), kind=kind)
    slow = recorded(true, "slow", lambda t: size * np.sin(3 * t), kind=kind)
    held = recorded(true, "held", lambda t: size * np.sin(7 * t), kind=kind)
    return gap.load(path, [fast, slow, held], held_out=[held])


@pytest.fixture(scope="module")
def servo(tmp_path_factory):
    return problem_of(tmp_path_factory.mktemp("servo"), SERVO)


@pytest.fixture(scope="module")
def motor(tmp_path_factory):
    return problem_of(tmp_path_factory.mktemp("motor"), MOTOR, kind="effort", size=0.8)


class TestStructures:
    @pytest.mark.parametrize("name", STRUCTURES)
    def test_are_whole_on_a_servo(self, servo, name):
        effects, missing = structure(name, servo)
        assert not missing
        assert tuple(effects) == STRUCTURES[name]

    @pytest.mark.parametrize("name", sorted({name for of in STRUCTURES.values() for name in of}))
    def test_have_effects_that_act_on_a_servo(self, servo, name):
        terms = candidate_terms([CATALOGUE[name]], servo.robots, servo.joints)
        alone = Structure(terms, servo.robots)
        start = [slot.parameter.starts[-1] for slot in alone.slots]
        trials = alone.trials(servo.robots[0], np.array([alone.zero, start]))
        without, with_it = servo.held.told[0].predict(trials)
        assert np.abs(with_it - without).max() > 1e-4

    @pytest.mark.parametrize("name", STRUCTURES)
    def test_go_without_a_velocity_gain_on_a_motor(self, motor, name):
        effects, missing = structure(name, motor)
        assert missing == (() if name == "PACE" else ("velocity_gain",))
        assert set(effects) == set(STRUCTURES[name]) - {"velocity_gain"}

    def test_have_as_many_parameters_as_published_or_say_why_not(self, servo):
        counts = {}
        for name in STRUCTURES:
            effects, _ = structure(name, servo)
            terms = [CATALOGUE[effect] for effect in effects]
            counts[name] = len(
                Structure(candidate_terms(terms, servo.robots, servo.joints), servo.robots).slots
            )
        # Of PACE the four of a joint and the delay; of BAM's the motor's five and its friction.
        assert counts == {
            "PACE": 5,
            "BAM M1": 7,
            "BAM M2": 10,
            "BAM M3": 8,
            "BAM M4": 11,
            "BAM M5": 11,
            "BAM M6": 12,
        }

    @pytest.mark.parametrize("name", NESTED)
    def test_do_what_those_do_of_which_they_are_more(self, servo, name):
        def whole(name):
            effects, _ = structure(name, servo)
            terms = candidate_terms([CATALOGUE[e] for e in effects], servo.robots, servo.joints)
            return Structure(terms, servo.robots)

        objective = servo.fit.objective
        for nested in map(whole, NESTED[name]):
            lower, upper = nested.bounds
            away = np.where(upper > nested.zero, upper, lower) - nested.zero
            (one,) = evaluate(objective, [(nested, nested.zero + 0.05 * away)])
            (larger,) = evaluate(objective, [(whole(name), start_from(one, whole(name)))])
            # But for what their priors make of the numbers, of which the larger has others.
            fitted = (float(objective.score(each.mean_square)) for each in (larger, one))
            assert next(fitted) == pytest.approx(next(fitted), abs=1e-3)
            assert abs(one.score - evaluate(objective, [(nested, nested.zero)])[0].score) > 0.1

    def test_are_fitted_to_the_end_although_one_effect_can_take_the_place_of_another(self, servo):
        names = ("armature", "viscous_friction", "coulomb_friction", "command_delay")
        found = fit(servo, dict.fromkeys(names, "*"))
        assert len(found.values) == len(names)
        robots = mended(servo, found)
        assert robots[0].model.dof_armature[0] == pytest.approx(TRUE["armature"], rel=0.1)
        assert robots[0].model.dof_frictionloss[0] == pytest.approx(TRUE["frictionloss"], rel=0.02)


class TestPublished:
    def test_every_log_has_its_makers_numbers(self):
        assert set(PUBLISHED) == {log.name for log in LOGS}
        assert {name: count(name) for name in PUBLISHED} == {
            "emps": 3,
            "double_pendulum": 6,
            "xl330": 5,
            "go2_leg": 9,
        }

    def test_is_written_to_the_robots_that_are_judged(self, servo, monkeypatch):
        names = ("armature", "viscous_friction", "coulomb_friction")
        effects = {effect: {JOINT: TRUE[key]} for effect, key in zip(names, TRUE, strict=True)}
        monkeypatch.setitem(PUBLISHED, "bench", effects)
        (robot,) = published("bench", servo)
        assert robot.model.dof_frictionloss[0] == TRUE["frictionloss"]
        assert robot.model.dof_armature[0] == TRUE["armature"]
        size = gap.replay(servo, (robot,)).gap.position
        assert size.after < 0.1 * size.before

    def test_of_the_double_pendulum_is_what_the_evidence_says(self, real_logs, repository):
        (log,) = (log for log in LOGS if log.name == "double_pendulum")
        problem = log.load()
        made = log.figure(problem, gap.replay(problem, published(log.name, problem)).gap)
        told = ", ".join(f"{value:.4f}" for value in made)
        row = next(
            line
            for line in (repository / "docs/evidence.md").read_text(encoding="utf-8").splitlines()
            if line.startswith("| makers' parameters")
        )
        assert f"{told} rad" in row


@pytest.mark.skipif(not mujoco_sysid.available(), reason="needs pip install 'mujoco[sysid]'")
class TestMujocoSysid:
    @pytest.mark.parametrize("which", ["servo", "motor"])
    def test_recovers_what_was_planted(self, which, request):
        problem = request.getfixturevalue(which)
        found = mujoco_sysid.identify(problem)
        assert set(found.values) == {f"{JOINT}/{name}" for name in TRUE}
        for name, value in TRUE.items():
            assert found.values[f"{JOINT}/{name}"] == pytest.approx(value, rel=0.05), name
        size = gap.replay(problem, found.robots).gap.position
        assert size.after < 0.03 * size.before

    def test_writes_its_values_to_the_robots_that_are_judged(self, servo):
        found = mujoco_sysid.identify(servo, iterations=2)
        model = found.robots[0].model
        assert model.dof_armature[0] == pytest.approx(found.values[f"{JOINT}/armature"])
        assert model.dof_damping[0] == pytest.approx(found.values[f"{JOINT}/damping"])
        assert model.dof_frictionloss[0] == pytest.approx(found.values[f"{JOINT}/frictionloss"])
