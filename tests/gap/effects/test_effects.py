"""The effects of the catalogue: one contract that each of them keeps.

`EffectContract` is the contract. A subclass names an effect and plants it in a machine by other
means than the effect itself: plain model fields, or the machine's own delays and offsets.
"""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from dm_control import mjcf

from walkerkit.gap.effects import CATALOGUE, EVERYWHERE, Parameter
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.recordings.segments import whole
from walkerkit.gap.search.fit import covariance, evaluate, fit
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.screen import screen
from walkerkit.gap.search.structure import Structure, Term, candidate_terms
from walkerkit.gap.simulation.excursion import excursions
from walkerkit.gap.simulation.mend import mend, write_model
from walkerkit.gap.simulation.replay import Channel, Replay
from walkerkit.gap.simulation.robot import load_robot, robot_from_spec
from walkerkit.gap.simulation.sidecar import FILE, sidecar, with_sidecar
from walkerkit.gap.simulation.trials import Trials

STEP = 0.002
JOINTS = ("hip", "knee")
LEG = """
<mujoco><compiler angle="{angle}"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><body name="thigh"><joint name="hip" axis="1 0 0" damping="0.2" armature="0.01" {hip}/>
  <geom type="capsule" fromto="0 0 0 0.05 0 -0.3" size="0.03" mass="1"/>
  <body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0" damping="0.1" {knee}/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.5"/></body></body></worldbody>
<actuator>{actuators}</actuator></mujoco>
"""
PLAIN = {
    "angle": "radian",
    "hip": "",
    "knee": "",
    "actuators": '<position name="h" joint="hip" kp="60" kv="2"/>'
    '<position name="k" joint="knee" kp="30" kv="1" forcerange="-20 20"/>',
}
# Everything that an effect could trip over, on one robot.
AWKWARD = {
    "angle": "degree",
    "hip": 'stiffness="1.7" springref="13" range="-90 70" limited="true" ref="5"',
    "knee": 'frictionloss="0.13" stiffness="0.3" range="-80 80" limited="true"',
    "actuators": '<general name="h" joint="hip" gear="-2" biastype="affine" gainprm="20" '
    'biasprm="3 -15 -0.5" ctrlrange="-1 1" forcerange="-11 12"/>'
    '<position name="k" joint="knee" kp="30" kv="0" delay="0.006" nsample="3"/>',
}
SIGNALS = ("position", "effort")
CHANNELS = tuple(Channel(joint=joint, signal=signal) for signal in SIGNALS for joint in JOINTS)
NOISE = {"position": 1e-4, "effort": 0.01}


def robot_of(variant):
    robot = robot_from_spec(mujoco.MjSpec.from_string(LEG.format(**variant)), "leg.xml")
    recording = Machine(robot).log()
    return replace(robot, excursions=excursions(robot, [recording], JOINTS)), recording


def commands(time):
    """Targets that rest, swing fast and slow, and turn around; (n, 2) rad."""
    t = np.maximum(time - 0.2, 0)
    hip = 0.35 * np.sin(3 * t + 0.4 * t**2) + 0.15 * np.sign(np.sin(2.1 * t))
    triangle = 2 / np.pi * np.arcsin(np.sin(1.7 * t))
    knee = 0.5 * triangle + 0.2 * np.sin(9 * t) + 0.15 * (np.sin(1.3 * t) > 0.4)
    return np.stack([hip * (time > 0.2), 0.3 + knee * (time > 0.2)], axis=1)


class Machine:
    """The real robot: the model stepped by hand, with what an effect plants in it.

    Attributes:
        model: the plain MuJoCo model, to be written to.
        command_age, sensor_age: steps.
        applied: constant effort that no drive knows of, per joint.
        offset: of the encoders, which drive and log both see.
        effort_factor: logged over true effort.
    """

    def __init__(self, robot):
        self.robot = robot
        self.model = robot.spec.copy().compile()
        self.command_age = self.sensor_age = 0
        self.applied, self.offset, self.effort_factor = np.zeros(2), np.zeros(2), np.ones(2)

    def log(self, seconds=4.0, seed=None):
        model = self.model
        mujoco.mj_setConst(model, mujoco.MjData(model))
        data, settle = mujoco.MjData(model), 1000
        steps = round(seconds / STEP)
        time = STEP * np.arange(steps)
        targets = commands(time)
        rows = []
        for k in range(-settle, steps):
            now = commands(np.array([max(0, k - self.command_age) * STEP]))[0] - self.offset
            for name, target in zip(JOINTS, now, strict=True):
                drive = self.robot.joints[name].drives[0]
                data.ctrl[drive.ctrl] = drive.control(float(target))
            data.qfrc_applied[:] = self.applied
            q = data.qpos.copy()
            mujoco.mj_step(model, data)
            rows.append(np.r_[q + self.offset, data.qfrc_actuator * self.effort_factor])
        rows = np.array(rows)
        position, effort = np.split(rows, 2, axis=1)
        position = position[settle - self.sensor_age : settle - self.sensor_age + steps]
        effort = effort[settle:]
        if seed is not None:
            rng = np.random.default_rng(seed)
            position = position + NOISE["position"] * rng.normal(size=position.shape)
            effort = effort + NOISE["effort"] * rng.normal(size=effort.shape)
        columns = {}
        for k, joint in enumerate(JOINTS):
            columns[f"{joint}/position"] = position[:, k]
            columns[f"{joint}/effort"] = effort[:, k]
            columns[f"{joint}/position_target"] = targets[:, k]
        return Recording(name="log", time=time, columns=columns)


@pytest.fixture(scope="module")
def plain():
    return robot_of(PLAIN)


@pytest.fixture(scope="module")
def awkward():
    return robot_of(AWKWARD)


def replayed(robot, recording, trials):
    return Replay(robot, whole(recording), CHANNELS).predict(trials)


class EffectContract:
    """What every effect of the catalogue promises.

    Attributes:
        name: the effect.
        may_be_out_of_reach: whether some of its starts may lie where the motion never gets.
    """

    name = ""
    may_be_out_of_reach = False

    def plant(self, machine):
        """Puts the effect into a machine.

        Returns:
            Place to the parameters' true values, of the places that have them.
        """
        raise NotImplementedError

    @property
    def effect(self):
        return CATALOGUE[self.name]

    def term(self, robot):
        (term,) = candidate_terms([self.effect], [robot], JOINTS)
        return term

    def test_says_what_it_is(self):
        effect = self.effect
        assert effect.name == self.name
        for text in (effect.equation, effect.symptom, effect.added_as, effect.source):
            assert text
            assert text == text.strip()
        assert type(effect).__doc__

    @pytest.mark.parametrize("variant", ["plain", "awkward"])
    def test_zero_changes_nothing_bit_for_bit(self, variant, request):
        robot, recording = request.getfixturevalue(variant)
        structure = Structure((self.term(robot),), (robot,))
        trials = structure.trials(robot, np.stack([structure.zero, structure.zero]))
        expected = replayed(robot, recording, Trials(robot, 1))
        np.testing.assert_array_equal(
            replayed(robot, recording, trials), np.concatenate([expected, expected])
        )

    @pytest.mark.parametrize("variant", ["plain", "awkward"])
    def test_parameters_agree_with_each_other(self, variant, request):
        robot, _ = request.getfixturevalue(variant)
        for site in self.term(robot).sites:
            parameters = self.effect.parameters(robot, site)
            assert len({p.name for p in parameters}) == len(parameters)
            assert len({len(p.starts) for p in parameters}) == 1
            for p in parameters:
                assert np.isfinite([p.zero, p.lower, p.upper, p.scale, *p.starts]).all()
                assert p.lower <= min(p.starts)
                assert max(p.starts) <= p.upper
                assert p.lower <= p.zero <= p.upper
                assert 0 < p.scale < p.upper - p.lower
            for values in zip(*(p.starts for p in parameters), strict=True):
                assert any(v != p.zero for v, p in zip(values, parameters, strict=True))

    @pytest.mark.parametrize("variant", ["plain", "awkward"])
    def test_every_start_has_a_gradient(self, variant, request):
        robot, recording = request.getfixturevalue(variant)
        term = self.term(robot)
        structure = Structure((term,), (robot,))
        for place in term.places:
            columns = structure.columns(term, place)
            seen = []
            starts = np.array([structure.slots[c].parameter.starts for c in columns]).T
            for start in starts:
                values = np.tile(structure.zero, (len(columns) + 1, 1))
                values[:, columns] = start
                for row, column in enumerate(columns, start=1):
                    move = 0.02 * structure.scale[column]
                    inside = values[row, column] + move <= structure.bounds[1][column]
                    values[row, column] += move if inside else -move
                predicted = replayed(robot, recording, structure.trials(robot, values))
                changes = predicted[1:] - predicted[0]
                assert np.isfinite(changes).all()
                seen.append((np.abs(changes).max(axis=(1, 2)) > 1e-9).all())
            assert any(seen) if self.may_be_out_of_reach else all(seen), (place, seen)

    def test_planted_values_are_recovered(self, plain):
        robot, _ = plain
        machine = Machine(robot)
        truth = self.plant(machine)
        recording = machine.log(seed=sum(map(ord, self.name)))
        robot = replace(robot, excursions=excursions(robot, [recording], JOINTS))
        replay = Replay(robot, whole(recording), CHANNELS)
        floor = np.array([0.5 * NOISE[channel.signal] for channel in CHANNELS])
        objective = Objective([replay], CHANNELS, floor)
        nothing = Structure((), (robot,))
        (base,) = evaluate(objective, [(nothing, np.zeros(0))])
        term = self.term(robot)
        starts = screen(objective, base, [term])
        assert starts[0].score < base.score
        (found,) = fit(objective, starts, iterations=20)
        variance, _ = covariance(objective, found)
        std = np.sqrt(np.diag(variance))
        expected = found.structure.zero.copy()
        for place, values in truth.items():
            expected[found.structure.columns(found.structure.terms[-1], place)] = values
        for value, wanted, sigma, slot in zip(
            found.values, expected, std, found.structure.slots, strict=True
        ):
            if slot.place in truth:
                size = max(0.05 * abs(wanted), 3 * sigma)
                assert 3 * sigma < 0.5 * abs(wanted)
            elif slot.parameter.name in ("springref", "limit"):
                continue  # means nothing where there is no spring, no limit in reach
            else:
                size = max(0.2 * slot.parameter.scale, 3 * sigma)
            assert value == pytest.approx(wanted, abs=size), (slot.place, slot.parameter.name)
        residual = np.sqrt(found.mean_square)
        np.testing.assert_array_less(
            residual, 2 * np.array([NOISE[channel.signal] for channel in CHANNELS])
        )

    @pytest.mark.parametrize("variant", ["plain", "awkward"])
    def test_mended_model_moves_as_the_trial_did(self, variant, request, tmp_path):
        robot, recording = request.getfixturevalue(variant)
        structure = Structure((self.term(robot),), (robot,))
        values = np.array([self.odd(slot.parameter) for slot in structure.slots])
        expected = replayed(robot, recording, structure.trials(robot, values[None]))
        assert np.abs(expected - replayed(robot, recording, Trials(robot, 1))).max() > 1e-4
        mended = mend(structure.trials(robot, values[None]))
        self.close(replayed(mended, recording, Trials(mended, 1)), expected)

        path = tmp_path / "model.xml"
        write_model(mended, path)
        content = json.dumps(sidecar({"model.xml": mended}, []))
        (tmp_path / FILE).write_text(content, encoding="utf-8")
        again = with_sidecar(load_robot(path), path)
        self.close(replayed(again, recording, Trials(again, 1)), expected)

        root = mjcf.from_path(str(path))
        spec = mujoco.MjSpec.from_string(root.to_xml_string(), assets=root.get_assets())
        composed = with_sidecar(robot_from_spec(spec, str(path)), path)
        self.close(replayed(composed, recording, Trials(composed, 1)), expected)

    @staticmethod
    def odd(parameter):
        """A value with many digits that does something, unlike all starts."""
        return parameter.starts[-1] * 0.8127364523 + parameter.starts[0] * 0.1234567

    @staticmethod
    def close(got, expected):
        assert np.isfinite(expected).all()
        np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-6)


class TestViscousFriction(EffectContract):
    name = "viscous_friction"

    def plant(self, machine):
        machine.model.joint("knee").damping += 0.37
        return {"knee": [0.37]}


class TestCoulombFriction(EffectContract):
    name = "coulomb_friction"

    def plant(self, machine):
        knee = machine.model.joint("knee")
        machine.model.dof_solref[knee.dofadr] = (0.004, 1)
        machine.model.dof_solimp[knee.dofadr] = (0.99, 0.99, 0.001, 0.5, 2)
        knee.frictionloss = 0.43
        return {"knee": [0.43]}


class TestArmature(EffectContract):
    name = "armature"

    def plant(self, machine):
        machine.model.joint("hip").armature += 0.017
        return {"hip": [0.017]}


class TestPayload(EffectContract):
    name = "payload"

    def plant(self, machine):
        machine.model.body("shank").mass += 0.21
        return {"shank": [0.21]}


class TestParallelSpring(EffectContract):
    name = "parallel_spring"

    def plant(self, machine):
        knee = machine.model.joint("knee")
        knee.stiffness = 2.3
        machine.model.qpos_spring[knee.qposadr] = -0.4
        return {"knee": [2.3, -0.4]}


class TestPositionGain(EffectContract):
    name = "position_gain"

    def plant(self, machine):
        machine.model.actuator("k").gainprm[0] = 22
        machine.model.actuator("k").biasprm[1] = -22
        return {"knee": [-8]}


class TestVelocityGain(EffectContract):
    name = "velocity_gain"

    def plant(self, machine):
        machine.model.actuator("k").biasprm[2] = -1.6
        return {"knee": [0.6]}


class TestTorqueConstant(EffectContract):
    name = "torque_constant"

    def plant(self, machine):
        # The same servo, felt 1.23 times as strongly and logged as before.
        for name, (kp, kv, strength) in {"h": (60, 2, 1), "k": (30, 1, 1.23)}.items():
            machine.model.actuator(name).gainprm[0] = strength * kp
            machine.model.actuator(name).biasprm[1:3] = -strength * kp, -strength * kv
        machine.model.actuator("k").forcerange *= 1.23
        machine.effort_factor[1] = 1 / 1.23
        return {"knee": [0.23]}


class TestTorqueBias(EffectContract):
    name = "torque_bias"

    def plant(self, machine):
        machine.applied[0] = -0.62
        return {"hip": [-0.62]}


class TestEffortLimit(EffectContract):
    name = "effort_limit"
    may_be_out_of_reach = True

    def plant(self, machine):
        # A joint's own actuatorfrcrange is the same limit, but other code integrates its damping.
        hip = machine.model.actuator("h").id
        machine.model.actuator_forcelimited[hip] = 1
        machine.model.actuator_forcerange[hip] = (-5.3, 5.3)
        return {"hip": [5.3]}


class TestCommandDelay(EffectContract):
    name = "command_delay"

    def plant(self, machine):
        machine.command_age = 7
        return {EVERYWHERE: [7 * STEP]}


class TestSensorDelay(EffectContract):
    name = "sensor_delay"

    def plant(self, machine):
        machine.sensor_age = 7
        return {EVERYWHERE: [7 * STEP]}


class TestEncoderOffset(EffectContract):
    name = "encoder_offset"

    def plant(self, machine):
        machine.offset[1] = 0.047
        return {"knee": [0.047]}


class TestBaseTilt(EffectContract):
    name = "base_tilt"

    def plant(self, machine):
        # Gravity turned by roll about x, then by pitch about y.
        roll, pitch = 0.05, -0.08
        half = 0.5 * np.array([roll, pitch])
        (sx, sy), (cx, cy) = np.sin(half), np.cos(half)
        turn = np.zeros(4)
        mujoco.mju_mulQuat(turn, np.array([cy, 0, sy, 0]), np.array([cx, sx, 0, 0]))
        gravity = np.zeros(3)
        mujoco.mju_rotVecQuat(gravity, np.array([0, 0, -9.81]), turn)
        machine.model.opt.gravity = gravity
        return {EVERYWHERE: [roll, pitch]}


# Of each: the law's kp and kd at the joint, and the effort at its target.
SERVOS = {
    "position": ('<position joint="j" kp="30" kv="1"/>', 30, 1, 0),
    "scaled": (
        '<general joint="j" gear="-2" biastype="affine" gainprm="9" biasprm="3 -7.5 -0.25"/>',
        30,
        1,
        0,
    ),
    "with effort": (
        '<general joint="j" gear="2" input="pos" biastype="affine" gainprm="7.5" '
        'biasprm="0.6 -7.5 -0.25"/>',
        30,
        1,
        1.2,
    ),
}


class TestTogether:
    """Several effects on one drive, against its law by hand.

    Euler's integrator treats an actuator like any other effort, so that the law may be applied from
    outside, step by step, and has to agree to the last digits.
    """

    ROD = """
    <mujoco><compiler angle="radian"/><option timestep="0.002" integrator="Euler">
    <flag eulerdamp="disable"/></option>
    <worldbody><body name="rod"><joint name="j" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0 0 -0.3" size="0.03" mass="1"/></body></worldbody>
    <actuator>{actuator}</actuator></mujoco>"""

    def compare(self, actuator, values, law, forward=0.0, kind="position"):
        """Replays the effects, in their order, beside a law of (target, q, q̇) → (effort, log)."""
        robot = robot_from_spec(
            mujoco.MjSpec.from_string(self.ROD.format(actuator=actuator)), "rod"
        )
        time = STEP * np.arange(500)
        target = 0.4 * np.sin(9 * time) + 0.3 * np.sign(np.sin(5 * time))
        columns = {"j/position": 0 * time, f"j/{kind}_target": target}
        if forward:
            columns["j/effort_target"] = forward * np.sin(13 * time)
        recording = Recording(name="log", time=time, columns=columns)
        terms = tuple(Term(effect=CATALOGUE[name], sites=("j",)) for name in values)
        structure = Structure(terms, (robot,))
        trials = structure.trials(robot, np.array([[*values.values()]], dtype=float))
        channels = [Channel(joint="j", signal=signal) for signal in SIGNALS]
        (got,) = Replay(robot, whole(recording), channels).predict(trials)

        model = mujoco.MjModel.from_xml_string(self.ROD.format(actuator=""))
        data, expected = mujoco.MjData(model), []
        for k, u in enumerate(target):
            effort, logged = law(u, float(data.qpos[0]), float(data.qvel[0]))
            ahead = columns["j/effort_target"][k] if forward else 0.0
            data.qfrc_applied[0] = effort + ahead * self.strength
            expected.append((float(data.qpos[0]), logged + ahead))
            mujoco.mj_step(model, data)
        np.testing.assert_allclose(got, expected, rtol=1e-7, atol=1e-7)
        return np.array(expected)[:, 1]

    strength = 1.0

    @pytest.mark.parametrize("servo", SERVOS)
    def test_gains_keep_the_meaning_of_the_target(self, servo):
        actuator, kp, kd, constant = SERVOS[servo]

        def law(u, q, qd):
            effort = (kp + 11) * (u - q) - (kd + 0.3) * qd + constant
            return effort, effort

        self.compare(actuator, {"position_gain": 11, "velocity_gain": 0.3}, law)

    @pytest.mark.parametrize("gear", [1, -2])
    def test_gain_of_a_velocity_servo(self, gear):
        def law(v, q, qd):
            return 2 * (2.6 * (v - qd),)

        actuator = f'<velocity joint="j" kv="{2 / gear**2}" gear="{gear}"/>'
        self.compare(actuator, {"velocity_gain": 0.6}, law, kind="velocity")

    @pytest.mark.parametrize("servo", SERVOS)
    def test_torque_constant_and_bias_in_either_order(self, servo):
        actuator, kp, kd, constant = SERVOS[servo]
        for names, bias in (
            (["torque_constant", "torque_bias"], 0.7),
            (["torque_bias", "torque_constant"], 1.25 * 0.7),
        ):

            def law(u, q, qd, bias=bias):
                believed = kp * (u - q) - kd * qd + constant
                return 1.25 * believed + bias, believed

            values = {"torque_constant": 0.25, "torque_bias": 0.7}
            self.compare(actuator, {name: values[name] for name in names}, law)

    @pytest.mark.parametrize("servo", SERVOS)
    def test_limit_is_of_what_the_drive_believes_in_either_order(self, servo):
        actuator, kp, kd, constant = SERVOS[servo]

        def law(u, q, qd):
            believed = np.clip(kp * (u - q) - kd * qd + constant, -3.3, 3.3)
            return 1.25 * believed, believed

        values = {"torque_constant": 0.25, "effort_limit": 3.3}
        for names in (list(values), list(values)[::-1]):
            logged = self.compare(actuator, {name: values[name] for name in names}, law)
            assert np.mean(np.abs(logged) == 3.3) > 0.1

    def test_torque_constant_scales_feed_forward_effort_too(self):
        def law(u, q, qd):
            believed = 30 * (u - q) - qd
            return 1.25 * believed, believed

        self.strength = 1.25
        actuator = SERVOS["position"][0]
        self.compare(actuator, {"torque_constant": 0.25}, law, forward=3.0)


def test_every_effect_of_the_catalogue_is_under_contract():
    assert {case.name for case in EffectContract.__subclasses__()} == set(CATALOGUE)


def test_catalogue_is_listed_in_the_order_of_its_families():
    names = list(CATALOGUE)
    assert names[:2] == ["viscous_friction", "coulomb_friction"]
    assert names.index("armature") < names.index("command_delay") < names.index("base_tilt")
    with pytest.raises(TypeError):
        CATALOGUE["more"] = CATALOGUE["armature"]


@pytest.mark.parametrize(
    "wrong",
    [{"starts": ()}, {"starts": (3.0,)}, {"zero": -1.0}, {"scale": 0.0}, {"lower": 2.0}],
    ids=str,
)
def test_parameters_that_contradict_themselves_are_refused(wrong):
    right = {"name": "x", "unit": "1", "lower": 0.0, "upper": 2.0, "scale": 1.0, "starts": (1.0,)}
    Parameter(**right)
    with pytest.raises(ValueError, match="parameter 'x' contradicts itself"):
        Parameter(**right | wrong)
