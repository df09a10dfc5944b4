"""What a table stands on, under which a leg swings: it slides, sinks and rocks."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest

from tests.gap.effects.contract import EffectContract
from tests.gap.effects.machine import AWKWARD, JOINTS, PLAIN, Machine, replay_of
from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.search.certainty import at_bound, ran_away
from walkerkit.gap.search.structure import Fit, Structure, Term
from walkerkit.gap.simulation.excursion import excursions
from walkerkit.gap.simulation.ground_geoms import Ground
from walkerkit.gap.simulation.load_robot import robot_from_spec
from walkerkit.gap.simulation.trials import Trials

NOISES_LEFT = 8.0  # windows of a base that floats restart with an error that lasts
FEET = ((0.4, 0.3), (0.4, -0.3), (-0.4, 0.3), (-0.4, -0.3))
TABLE = """
<mujoco><compiler angle="{angle}"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><geom name="floor" type="plane" size="0 0 1" {floor}/>
<body name="table" pos="0 0 0.7"><freejoint name="root"/>
  <geom type="box" size="0.4 0.3 0.02" mass="8" contype="0" conaffinity="0"/>{feet}
<body name="thigh"><joint name="hip" axis="1 0 0" damping="0.2" armature="0.01" {hip}/>
  <geom type="capsule" fromto="0 0 0 0.05 0 -0.3" size="0.03" mass="1"/>
  <body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0" damping="0.1" {knee}/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.2" size="0.02" mass="0.5"/></body></body></body>
</worldbody><contact>{contact}</contact><actuator>{actuators}</actuator></mujoco>
"""
FOOT = '<geom name="foot{k}" size="0.02" pos="{x} {y} -0.68" mass="0.2" friction="{mu}" {more}/>'


def table_of(variant, floor, mu, more=("", "", "", ""), contact=""):
    feet = "".join(FOOT.format(k=k, x=x, y=y, mu=mu, more=more[k]) for k, (x, y) in enumerate(FEET))
    text = TABLE.format(floor=floor, feet=feet, contact=contact, **variant)
    robot = robot_from_spec(mujoco.MjSpec.from_string(text), "table.xml")
    recording = Machine(robot).log()
    return replace(robot, excursions=excursions(robot, [recording], JOINTS)), recording


@cache
def slippery():
    return table_of(PLAIN, 'friction="0.1"', 0.05)


@cache
def awkward_table(mu):
    """Every way in which MuJoCo lets a contact get its numbers, one a foot."""
    more = ('priority="1"', 'solref="-9000 -160"', "", 'contype="2" conaffinity="2"')
    sliding = f"{0.9 * mu} {0.8 * mu}"
    pair = f'<pair geom1="foot3" geom2="floor" friction="{sliding} 0.005 0.0001 0.0001"/>'
    return table_of(AWKWARD, f'friction="{0.7 * mu}" solmix="3"', mu, more, pair)


class TestGroundFriction(EffectContract):
    name = "ground_friction"
    seconds = 8.0
    noises_left = NOISES_LEFT

    @pytest.fixture(scope="class")
    @classmethod
    def plain(cls):
        return slippery()

    @pytest.fixture(scope="class")
    @classmethod
    def awkward(cls):
        return awkward_table(0.1)

    def plant(self, machine):
        # Priority alone decides, whatever the feet say.
        floor = machine.model.geom("floor")
        floor.priority = 7
        floor.friction[0] = 0.045
        return {EVERYWHERE: [-0.055]}


class TestGroundCompliance(EffectContract):
    name = "ground_compliance"
    noises_left = NOISES_LEFT

    @pytest.fixture(scope="class")
    @classmethod
    def plain(cls):
        return table_of(PLAIN, 'friction="0.8"', 0.8)

    @pytest.fixture(scope="class")
    @classmethod
    def awkward(cls):
        return awkward_table(0.8)

    def plant(self, machine):
        # In MuJoCo's other format: the stiffness and damping of 1/12 s at a ratio of 1.
        model = machine.model
        model.geom("floor").priority = 7
        model.geom("floor").solref = (-144.0, -24.0)
        model.geom("floor").solimp[:2] = (0.6, 0.65)
        return {EVERYWHERE: [1 / 12 - 0.02, -0.3]}


STAND = """
<mujoco><compiler angle="{angle}"/><option timestep="0.002" integrator="implicitfast"/>
<worldbody><geom name="floor" type="plane" size="0 0 1"/>
<body name="table" pos="0 0 0.7"><freejoint name="root"/>
  <geom type="box" size="0.4 0.3 0.02" mass="40" contype="0" conaffinity="0"/>
  <geom size="0.02" pos="-0.4 0.3 -0.68" mass="0.2"/>
  <geom size="0.02" pos="-0.4 -0.3 -0.68" mass="0.2"/>
  <geom size="0.02" pos="0.4 0 -0.68" mass="0.2"/>
<body name="thigh"><joint name="hip" axis="1 0 0" damping="0.2" armature="0.01" {hip}/>
  <geom type="capsule" fromto="0 0 0 0.05 0 -0.3" size="0.03" mass="1"/>
  <body name="shank" pos="0 0 -0.3"><joint name="knee" axis="0 1 0" damping="0.1" {knee}/>
    <geom type="capsule" fromto="0 0 0 0 0 -0.35" size="0.015" mass="0.5"/>{toe}
  </body></body></body>
</worldbody><contact>{contact}</contact><actuator>{actuators}</actuator></mujoco>
"""
SOFT = 'mass="0.05" priority="1" friction="0.1" solref="0.06 1"'
BALL = f'<geom name="toe" size="0.02" pos="0 0 -0.42" {SOFT}/>'
# Welded on askew, given by its ends, with a contact pair of its own.
BAR = f"""<body name="ankle" pos="0 0 -0.42" euler="90 0 0">
<geom name="toe" type="capsule" size="0.02" fromto="-0.01 0 0 0.02 0 0" {SOFT}/></body>"""
PAIR = '<pair geom1="toe" geom2="floor" friction="0.1 0.1 0.005 0.0001 0.0001" solref="0.06 1"/>'


def stand_of(variant, toe, contact=""):
    text = STAND.format(toe=toe, contact=contact, **variant)
    robot = robot_from_spec(mujoco.MjSpec.from_string(text), "stand.xml")
    recording = Machine(robot).log()
    return replace(robot, excursions=excursions(robot, [recording], JOINTS)), recording


class TestFootOffset(EffectContract):
    """A table on three feet, and on a leg with a fourth that comes and goes."""

    may_be_out_of_reach = True

    name = "foot_offset"
    rounding = 1e-5  # contacts begin a step earlier or later by the digits of a foot's place
    noises_left = NOISES_LEFT

    @pytest.fixture(scope="class")
    @classmethod
    def plain(cls):
        return stand_of(PLAIN, BALL)

    @pytest.fixture(scope="class")
    @classmethod
    def awkward(cls):
        return stand_of(AWKWARD, BAR, PAIR)

    def plant(self, machine):
        machine.model.geom("toe").pos += (-0.004, -0.003, -0.012)
        return {"shank": [-0.004, -0.003, -0.012]}


def test_a_foot_moves_with_its_shank_however_it_is_fixed_there():
    shift = np.array([0.003, -0.005, 0.007])
    for robot, _ in (stand_of(PLAIN, BALL), stand_of(AWKWARD, BAR, PAIR)):
        trials = Trials(robot, 2)
        CATALOGUE["foot_offset"].apply(trials, "shank", np.stack([np.zeros(3), shift]))
        at = []
        for row in range(2):
            model = robot.spec.copy().compile()
            for name, values in trials.fields.items():
                getattr(model, name)[:] = values[row]
            data = mujoco.MjData(model)
            data.qpos[7:] = (0.3, -0.4)
            mujoco.mj_kinematics(model, data)
            frame = data.xmat[model.body("shank").id].reshape(3, 3)
            at.append(data.geom_xpos[model.geom("toe").id].copy())
        np.testing.assert_allclose(at[1] - at[0], frame @ shift, atol=1e-12)


@pytest.mark.parametrize("make", [slippery, lambda: awkward_table(0.1)])
@pytest.mark.parametrize(
    ("name", "values"), [("ground_friction", [-0.03]), ("ground_compliance", [0.03, -0.2])]
)
def test_every_contact_changes_by_just_that(name, values, make):
    robot, _ = make()
    trials = Trials(robot, 1)
    CATALOGUE[name].apply(trials, EVERYWHERE, np.array([values]))
    seen = []
    for fields in ({}, trials.fields):
        model = robot.spec.copy().compile()
        for field, changed in fields.items():
            getattr(model, field)[:] = changed[0]
        data = mujoco.MjData(model)
        data.qpos[2] -= 0.001
        mujoco.mj_forward(model, data)
        feet = sorted(range(data.ncon), key=lambda k: tuple(data.contact.geom[k]))
        assert len(feet) == 4
        solref = data.contact.solref[feet]
        constant = np.where(solref[:, 0] > 0, solref[:, 0], -2 / solref[:, 1])
        impedance = data.contact.solimp[feet, :2]
        sliding = data.contact.friction[feet, :2]
        seen.append([sliding] if name == "ground_friction" else [constant, impedance])
    for before, after, value in zip(*seen, values, strict=True):
        np.testing.assert_allclose(after - before, value, atol=1e-12)


def test_a_foot_sinks_as_on_a_damped_spring():
    text = (
        "<mujoco><option timestep='1e-4'/><default><geom solimp='0.9 0.9 0.001'/></default>"
        "<worldbody><geom type='plane' size='0 0 1'/><body pos='0 0 0.05'>"
        "<joint name='lift' type='slide' axis='0 0 1'/><geom size='0.05' mass='2'/></body>"
        "</worldbody></mujoco>"
    )
    robot = robot_from_spec(mujoco.MjSpec.from_string(text), "foot.xml")
    constant, impedance = 0.015, 0.2
    trials = Trials(robot, 1)
    change = np.array([[constant - 0.02, impedance - 0.9]])
    CATALOGUE["ground_compliance"].apply(trials, EVERYWHERE, change)
    model = robot.spec.copy().compile()
    for field, values in trials.fields.items():
        getattr(model, field)[:] = values[0]
    data = mujoco.MjData(model)
    time, depth = [], []
    while data.time < 0.1:
        mujoco.mj_step(model, data)
        time.append(data.time)
        depth.append(-data.qpos[0])
    # A share 1 - d of the weight on a critically damped spring of time constant T, m δ" = …
    passed = np.array(time) / constant
    deepest = (1 - impedance) * 9.81 * constant**2
    expected = deepest * (1 - (1 + passed) * np.exp(-passed))
    np.testing.assert_allclose(depth, expected, atol=0.01 * deepest)


def test_a_ground_as_hard_as_steps_allow_is_an_estimate_and_one_as_soft_as_may_be_is_none():
    robot, _ = table_of(PLAIN, "", 0.8)
    term = Term(effect=CATALOGUE["ground_compliance"], sites=(EVERYWHERE,))
    structure = Structure((term,), (robot,))
    lower, upper = structure.bounds
    step = robot.model.opt.timestep
    assert lower[0] == pytest.approx(2 * step - 0.02)  # MuJoCo takes no shorter time constant
    for values, stopped in ((lower, [False, True]), (upper, [True, True])):
        fit = Fit(structure=structure, values=values, score=0.0, mean_square=np.ones(1))
        assert at_bound(fit).tolist() == stopped
        assert ran_away(fit).tolist() == stopped


def test_only_what_can_touch_the_ground_is_ground():
    def ground(world="", inside="", contact=""):
        return Ground(
            mujoco.MjModel.from_xml_string(
                f"<mujoco><worldbody>{world}<body name='b'><freejoint/>"
                f"<geom name='foot' size='.1'/>{inside}</body></worldbody>"
                f"<contact>{contact}</contact></mujoco>"
            )
        )

    floor = "<geom name='floor' type='plane' size='0 0 1' {}/>"
    assert not ground()
    assert not ground(floor.format("contype='0' conaffinity='0'"))
    assert not ground(
        "<body name='w'>" + floor.format("") + "</body>", "", "<exclude body1='w' body2='b'/>"
    )
    found = ground(floor.format("contype='0'"), "<geom size='.1' contype='2' conaffinity='2'/>")
    np.testing.assert_array_equal(found.contacts, [[0, 1]])
    pair = "<pair geom1='foot' geom2='floor'/>"
    found = ground(floor.format("contype='0' conaffinity='0'"), "", pair)
    assert found
    assert not found.geoms.size
    np.testing.assert_array_equal(found.pairs, [0])


@pytest.mark.parametrize("name", ["ground_friction", "ground_compliance"])
def test_what_touches_nothing_has_no_ground(name):
    text = TABLE.format(floor='contype="0" conaffinity="0"', feet="", contact="", **PLAIN)
    text = text.replace('<freejoint name="root"/>', "")
    robot = robot_from_spec(mujoco.MjSpec.from_string(text), "bench.xml")
    assert CATALOGUE[name].sites(robot, JOINTS) == ()


def test_a_trunk_that_floats_may_carry_a_payload():
    robot, recording = slippery()
    sites = CATALOGUE["payload"].sites(robot, JOINTS)
    assert sites == ("table", "thigh", "shank")
    assert CATALOGUE["com_offset"].sites(robot, JOINTS) == sites
    assert "base_position" in {channel.quantity for channel in replay_of(robot, recording).channels}
