"""Delays in front of actuators: by our own line and by MuJoCo's, which do the same."""

from __future__ import annotations

import re

import numpy as np
import pytest
from dm_control import mjcf
from mujoco.batch import Batch

from tests.actuators.contract import EXPRESSIONS, ActuatorContract, DeterministicContract
from tests.actuators.reference import clip, dc_motor, late, pd
from tests.actuators.robots import WORDS, batch_of, built, commands, compiled, robot, run
from walkerkit.actuators import (
    ActuatorCmd,
    BuiltinMotorActuatorCfg,
    BuiltinPdActuatorCfg,
    BuiltinPositionActuatorCfg,
    BuiltinVelocityActuatorCfg,
    DcMotorActuatorCfg,
    DelayedActuatorCfg,
    IdealPdActuatorCfg,
    XmlMotorActuatorCfg,
    XmlPositionActuatorCfg,
)

IDEAL = IdealPdActuatorCfg(
    joint_names_expr=EXPRESSIONS, stiffness=25.0, damping=0.4, effort_limit=8.0
)
POSITION = BuiltinPositionActuatorCfg(
    joint_names_expr=EXPRESSIONS, stiffness=25.0, damping=0.4, effort_limit=8.0
)


def delayed(base_cfg, lag, words="position", **kwargs):
    """The config of a constant delay."""
    return DelayedActuatorCfg(
        base_cfg=base_cfg, delay_target=words, delay_min_lag=lag, delay_max_lag=lag, **kwargs
    )


class TestIdealPd(DeterministicContract):
    words = ("position", "velocity", "effort")
    limits = (8.0, 8.0, 8.0)
    cfg = delayed(IDEAL, 4)

    def expected(self, j, history, q, qd):
        p = late(history, 4)[0]
        asked = pd(25.0, 0.4, p, history[-1][1], history[-1][2], q, qd)
        return asked, clip(asked, -8.0, 8.0)


class TestAllTargetsOfAMotor(DeterministicContract):
    words = ("position", "velocity", "effort")
    limits = (8.0, 8.0, 8.0)
    cfg = delayed(
        DcMotorActuatorCfg(
            joint_names_expr=EXPRESSIONS,
            stiffness=25.0,
            damping=0.4,
            effort_limit=8.0,
            saturation_effort=9.0,
            velocity_limit=6.0,
        ),
        2,
        ("effort", "position", "velocity"),
    )

    def expected(self, j, history, q, qd):
        asked = pd(25.0, 0.4, *late(history, 2), q, qd)
        return asked, dc_motor(asked, qd, 9.0, 6.0, 8.0)


class TestNative(DeterministicContract):
    limits = (8.0, 8.0, 8.0)
    cfg = delayed(POSITION, 5)

    def expected(self, j, history, q, qd):
        asked = pd(25.0, 0.4, late(history, 5)[0], None, None, q, qd)
        return asked, clip(asked, -8.0, 8.0)


class TestXml(DeterministicContract):
    cfg = delayed(XmlPositionActuatorCfg(joint_names_expr=("hip",)), 3)
    joints = ("hip",)
    actuator = '<position name="hip" joint="hip" kp="20" gear="1.7"/>'

    def expected(self, j, history, q, qd):
        asked = 20 * 1.7**2 * (late(history, 3)[0] - q)
        return asked, asked


class TestWandering(ActuatorContract):
    words = ("position", "velocity", "effort")
    limits = (8.0, 8.0, 8.0)
    cfg = DelayedActuatorCfg(
        base_cfg=IDEAL,
        delay_target=("position", "velocity", "effort"),
        delay_min_lag=1,
        delay_max_lag=6,
        delay_hold_prob=0.3,
        delay_update_period=4,
        seed=5,
    )


class TestNoDelay(DeterministicContract):
    cfg = delayed(POSITION, 0)
    limits = (8.0, 8.0, 8.0)

    def expected(self, j, history, q, qd):
        asked = pd(25.0, 0.4, history[-1][0], None, None, q, qd)
        return asked, clip(asked, -8.0, 8.0)


# MuJoCo's delay and ours.

PENDULUM = """
<mujoco><compiler angle="radian"/><option timestep="{timestep}"/><worldbody><body>
  <joint name="j" axis="0 1 0" damping="0.1"/><geom size="0.1" pos="0.2 0 0" mass="1"/>
</body></worldbody></mujoco>
"""
GAINS = {"joint_names_expr": ("j",), "stiffness": 60.0, "damping": 2.0}


def pendulum(cfg, edit_timestep=0.002, timestep=0.002, after_compilation=False):
    """An actuator of a pendulum whose timestep may change after `edit_mjcf`."""
    root = mjcf.from_xml_string(PENDULUM.format(timestep=edit_timestep))
    actuator = cfg.build()
    actuator.edit_mjcf(root)
    if not after_compilation:
        root.option.timestep = timestep
    physics = mjcf.Physics.from_mjcf_model(root)
    physics.model.opt.timestep = timestep
    actuator.initialize(physics)
    actuator.reset()
    return actuator, physics


# One of them MuJoCo delays, the other we do: its control is another, its force is the same.
NATIVE = BuiltinPositionActuatorCfg(**GAINS)
OURS = BuiltinPdActuatorCfg(**GAINS)


@pytest.mark.parametrize("lag", [1, 2, 7, 20])
@pytest.mark.parametrize(
    ("edit_timestep", "timestep", "late_change", "time"),
    [
        (0.002, 0.002, False, 0.0),
        (0.002, 0.005, False, 0.0),
        (0.005, 0.0023, False, 0.0),
        (0.002, 1 / 300, True, 0.0),
        (0.001, 0.001, False, 12345.678),
    ],
)
def test_native_delay_is_our_delay(lag, edit_timestep, timestep, late_change, time):
    rng = np.random.default_rng(lag)
    targets = [[0.4 * x] for x in np.repeat(rng.standard_normal(100), 3)]
    records = []
    for cfg in (NATIVE, OURS):
        actuator, physics = pendulum(delayed(cfg, lag), edit_timestep, timestep, late_change)
        assert actuator.native == (cfg is NATIVE)
        physics.data.time = time
        cmds = [ActuatorCmd(position_target=target) for target in targets]

        def reset(k, actuator=actuator):
            if k == 150:  # in the middle of an episode, MuJoCo's own state going on
                actuator.reset()

        records.append(run(actuator, physics, cmds, reset))
    np.testing.assert_allclose(records[0].qpos, records[1].qpos, rtol=0, atol=1e-12)
    np.testing.assert_allclose(records[0].applied, records[1].applied, rtol=0, atol=1e-9)
    assert np.ptp(records[0].qpos) > 0.05


def test_native_delay_is_our_delay_in_a_batch_with_partial_resets():
    records = []
    for cfg in (NATIVE, OURS):
        root = mjcf.from_xml_string(PENDULUM.format(timestep=0.002))
        actuator = delayed(cfg, 6).build()
        actuator.edit_mjcf(root)
        root.option.timestep = 0.004
        batch = Batch(mjcf.Physics.from_mjcf_model(root).model.ptr, 4, 2)
        actuator.initialize(batch)
        actuator.reset()
        cmds = commands(150, (4, 1), ("position",), scale=0.5, seed=2)

        def reset(k, actuator=actuator, batch=batch):
            if k in (40, 43, 90):
                batch.reset([1, 3])
                actuator.reset([1, 3])
            if k == 60:
                actuator.reset([0])

        position = []
        for k, cmd in enumerate(cmds):
            reset(k)
            batch.ctrl[:, actuator.ctrl_ids] = actuator.compute(cmd)
            batch.step()
            position.append(batch.qpos.copy())
        records.append(np.array(position))
    np.testing.assert_allclose(records[0], records[1], rtol=0, atol=1e-12)


@pytest.mark.parametrize("cfg", [NATIVE, OURS], ids=["native", "ours"])
def test_a_held_pose_does_not_dip(cfg):
    """From rest at 0.8 rad with gravity compensated for by the target."""
    sag = []
    for lag in (0, 10):
        actuator, physics = pendulum(delayed(cfg, lag))
        with physics.reset_context():
            physics.data.qpos[:] = 0.8
        actuator.reset()
        record = run(actuator, physics, [ActuatorCmd(position_target=[0.8])] * 300)
        sag.append(record.qpos)
    np.testing.assert_allclose(sag[0], sag[1], rtol=0, atol=1e-12)
    assert sag[0].min() > 0.75


@pytest.mark.parametrize(
    ("base_cfg", "words", "native"),
    [
        (NATIVE, "position", True),
        (NATIVE, ("position",), True),
        (BuiltinVelocityActuatorCfg(joint_names_expr=("j",), damping=1.0), "velocity", True),
        (BuiltinMotorActuatorCfg(joint_names_expr=("j",)), "effort", True),
        (OURS, "position", False),
        (IdealPdActuatorCfg(**GAINS), "position", False),
    ],
)
def test_which_delays_are_left_to_mujoco(base_cfg, words, native):
    actuator, physics = pendulum(delayed(base_cfg, 4, words))
    assert actuator.native == native
    (element,) = actuator.elements
    assert (element.nsample, element.interp) == ((4, "zoh") if native else (0, None))
    assert physics.model.ptr.actuator_delay[0] == pytest.approx(4 * 0.002 if native else 0.0)
    assert actuator.holds == native
    for word in [words] if isinstance(words, str) else words:
        assert actuator.lag(word) == 4
    assert ("delay_max_lag" in actuator.parameters) != native


MOTOR = BuiltinMotorActuatorCfg(joint_names_expr=("j",))
WHEEL = BuiltinVelocityActuatorCfg(joint_names_expr=("j",), damping=2.0)
XML_MOTOR = XmlMotorActuatorCfg(joint_names_expr=("j",))


@pytest.mark.parametrize(
    ("base_cfg", "words"),
    [
        (NATIVE, ("position",)),
        (WHEEL, ("velocity",)),
        (MOTOR, ("effort",)),
        (XML_MOTOR, ("effort",)),
        (OURS, WORDS),
        (IdealPdActuatorCfg(**GAINS), WORDS),
    ],
)
@pytest.mark.parametrize(("low", "high"), [(3, 3), (1, 5)])
def test_every_target_that_the_actuator_takes_is_late_by_default(base_cfg, words, low, high):
    root = mjcf.from_xml_string(PENDULUM.format(timestep=0.002))
    root.option.gravity = [0, 0, 0]
    if base_cfg is XML_MOTOR:
        root.actuator.add("motor", name="m", joint="j")
    actuator = DelayedActuatorCfg(
        base_cfg=base_cfg, delay_min_lag=low, delay_max_lag=high, delay_hold_prob=1.0
    ).build()
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    actuator.initialize(physics)
    assert {word for word in WORDS if f"{word}_target" in actuator.takes} == {*words}
    for word in words:
        physics.reset()
        actuator.reset(random_state=np.random.RandomState(4))
        lag, efforts = int(actuator.lag(word)), []
        for k in range(12):
            targets = {f"{one}_target": [float(one == word and k >= 2)] for one in words}
            physics.data.ctrl[actuator.ctrl_ids] = actuator.compute(ActuatorCmd(**targets))
            efforts.append(abs(float(actuator.applied_effort[0])))
            physics.step()
        assert np.flatnonzero(np.array(efforts) > 1e-9)[0] == 2 + lag
        assert low <= lag <= high


@pytest.mark.parametrize("base_cfg", [NATIVE, WHEEL, MOTOR, XML_MOTOR])
@pytest.mark.parametrize("word", WORDS)
def test_a_target_that_the_actuator_does_not_take_cannot_be_late(base_cfg, word):
    own = {"position": NATIVE, "velocity": WHEEL}.get(word)
    if own is base_cfg or (word == "effort" and base_cfg in (MOTOR, XML_MOTOR)):
        assert delayed(base_cfg, 3, word).delay_target == (word,)
        return
    with pytest.raises(ValueError, match=f"takes no {word} target that could be late") as caught:
        delayed(base_cfg, 3, word)
    advice = re.search(r"use delay_target='(\w+)'", str(caught.value))[1]
    assert delayed(base_cfg, 3, advice).delay_target == (advice,)
    with pytest.raises(ValueError, match="could be late"):
        delayed(base_cfg, 3, WORDS)


@pytest.mark.parametrize("options", [{"delay_max_lag": 5}, {"delay_max_lag": 0}])
def test_lags_that_vary_or_are_none_are_not_left_to_mujoco(options):
    actuator, _ = pendulum(DelayedActuatorCfg(base_cfg=NATIVE, **options))
    assert not actuator.native
    assert actuator.elements[0].nsample == 0


# Schedules.


def lags_of(actuator, words=WORDS, n_steps=60):
    """The lag of each target at every step."""
    n = len(actuator.joint_names)
    shape = (*actuator.simulation.batch_shape, n)
    cmd = ActuatorCmd(**{f"{word}_target": np.zeros(shape) for word in words})
    record = {word: [] for word in words}
    for _ in range(n_steps):
        actuator.compute(cmd)
        for word in words:
            record[word].append(actuator.lag(word))
    return {word: np.array(lags) for word, lags in record.items()}


def wandering(**options):
    """A delay of all targets, between 2 and 9 steps."""
    options = {"delay_min_lag": 2, "delay_max_lag": 9, "delay_target": WORDS, **options}
    return DelayedActuatorCfg(base_cfg=IDEAL, **options)


def test_lags_are_within_bounds_from_the_first_step_and_independent():
    actuator, _ = built(wandering(), robot())
    lags = lags_of(actuator, n_steps=200)
    for word in WORDS:
        assert {*lags[word].tolist()} == {*range(2, 10)}
    for one, other in (("position", "velocity"), ("velocity", "effort"), ("position", "effort")):
        assert abs(np.corrcoef(lags[one], lags[other])[0, 1]) < 0.2
    with pytest.raises(KeyError, match=r"'speed' is not delayed, \['position', 'velocity'"):
        actuator.lag("speed")


def test_a_target_has_its_lags_whatever_else_is_delayed():
    lags = []
    for words in (WORDS, ("velocity",)):
        actuator, _ = built(wandering(delay_target=words), robot())
        cmd = ActuatorCmd(position_target=np.zeros(3), velocity_target=np.zeros(3))
        steps = []
        for _ in range(40):
            actuator.compute(cmd)
            steps.append(int(actuator.lag("velocity")))
        lags.append(steps)
    assert lags[0] == lags[1]


def test_hold_prob_one_draws_at_every_reset_and_only_then():
    actuator, _ = built(wandering(delay_hold_prob=1.0), robot())
    seen = []
    for _ in range(20):
        actuator.reset()
        lags = lags_of(actuator, n_steps=15)["position"]
        assert (lags == lags[0]).all()
        seen.append(lags[0])
    assert len({*map(int, seen)}) > 3


def test_update_period():
    actuator, _ = built(wandering(delay_update_period=10, delay_max_lag=500), robot())
    lags = lags_of(actuator)["position"]
    assert (np.flatnonzero(np.diff(lags)) + 1).tolist() == [10, 20, 30, 40, 50]


def test_same_seed_same_trajectory_other_seed_another():
    script = commands(40, (3,), WORDS)
    one, same, other = (run(*built(wandering(seed=s), robot()), script) for s in (1, 1, 2))
    assert one == same
    assert one != other


def test_lags_go_on_over_recompilations_and_do_not_start_anew():
    """Composer compiles the model at every episode, and no episode repeats the one before."""
    root = robot()
    actuator, _ = built(wandering(), root)
    episodes = []
    for _ in range(3):
        again = compiled(root)
        actuator.initialize(again)
        actuator.reset()
        episodes.append(lags_of(actuator)["position"])
    assert (episodes[0] != episodes[1]).any()
    assert (episodes[1] != episodes[2]).any()
    # All of it from the seed.
    root = robot()
    actuator, _ = built(wandering(), root)
    for lags in episodes:
        again = compiled(root)
        actuator.initialize(again)
        actuator.reset()
        np.testing.assert_array_equal(lags_of(actuator)["position"], lags)


def test_a_reset_with_its_own_source():
    actuator, _ = built(wandering(delay_hold_prob=1.0, delay_max_lag=900), robot())
    drawn = []
    for seed in (3, 3, 4):
        actuator.reset(random_state=np.random.RandomState(seed))
        drawn.append([int(actuator.lag(word)) for word in WORDS])
    assert drawn[0] == drawn[1] != drawn[2]
    assert len({*drawn[0]}) == 3


def test_bounds_are_parameters():
    actuator, _ = built(wandering(), robot())
    np.testing.assert_array_equal(actuator.nominal("delay_max_lag"), [9.0, 9.0, 9.0])
    actuator.set("delay_max_lag", 4.0)
    np.testing.assert_array_equal(actuator.get("delay_max_lag"), [4.0, 4.0, 4.0])
    np.testing.assert_array_equal(actuator.get("delay_min_lag"), [2.0, 2.0, 2.0])
    actuator.reset()
    for word in WORDS:
        assert 2 <= actuator.lag(word) <= 4
    np.testing.assert_array_equal(actuator.nominal("delay_max_lag"), [9.0, 9.0, 9.0])


# One transport for a whole command.


def out_of_step(options, episodes=12, n_sims=None):
    """In how many episodes no single lag explains the effort, with random targets at every step."""
    root = mjcf.from_xml_string(PENDULUM.format(timestep=0.002))
    actuator = DelayedActuatorCfg(base_cfg=IdealPdActuatorCfg(**GAINS), **options).build()
    actuator.edit_mjcf(root)
    physics = mjcf.Physics.from_mjcf_model(root)
    simulation = physics if n_sims is None else Batch(physics.model.ptr, n_sims, 1)
    actuator.initialize(simulation)
    shape, wrong = (*actuator.simulation.batch_shape, 1), 0
    for episode in range(episodes):
        actuator.reset(random_state=np.random.RandomState(episode))
        rng, past = np.random.default_rng(episode), []
        for _ in range(12):
            past.append(rng.normal(size=(3, *shape)))
            actuator.compute(ActuatorCmd(*past[-1]))
        by_lag = [
            pd(60.0, 2.0, *past[-1 - lag], np.zeros(shape), np.zeros(shape)) for lag in range(6)
        ]
        off = np.abs(np.array(by_lag) - actuator.applied_effort)
        wrong += int((off.min(axis=0) > 1e-9).sum())
    return wrong


@pytest.mark.parametrize("n_sims", [None, 3])
@pytest.mark.parametrize("options", [{}, {"delay_hold_prob": 1.0}, {"delay_update_period": 5}])
def test_a_shared_lag_keeps_the_targets_of_a_command_together(options, n_sims):
    wander = {"delay_max_lag": 5, **options}
    assert out_of_step({**wander, "delay_shared": True}, n_sims=n_sims) == 0
    assert out_of_step(wander, n_sims=n_sims) > 3  # independent, as documented


def test_a_constant_lag_keeps_them_together_by_default():
    assert out_of_step({"delay_min_lag": 3, "delay_max_lag": 3}) == 0


def test_a_shared_lag_is_drawn_from_the_same_distribution():
    actuator, _ = built(wandering(delay_shared=True), robot())
    lags = lags_of(actuator, n_steps=300)
    for word in WORDS:
        np.testing.assert_array_equal(lags[word], lags["position"])
    assert {*lags["effort"].tolist()} == {*range(2, 10)}


def test_a_shared_lag_goes_on_whichever_targets_a_command_has():
    actuator, _ = built(wandering(delay_shared=True, delay_update_period=3), robot())
    seen = []
    for k in range(30):
        words = ("position", "velocity") if k % 2 else ("position", "effort")
        actuator.compute(ActuatorCmd(**{f"{word}_target": np.zeros(3) for word in words}))
        seen.append(int(actuator.lag("effort")))
    assert ((np.flatnonzero(np.diff(seen)) + 1) % 3 == 0).all()
    assert len({*seen}) > 3


# Redraws out of phase.


def test_simulations_redraw_at_steps_of_their_own():
    actuator, physics = built(
        wandering(delay_update_period=10, delay_max_lag=900, delay_per_env_phase=True), robot()
    )
    batch = batch_of(physics, 40)
    actuator.initialize(batch)
    actuator.reset()
    moves = np.diff(lags_of(actuator, n_steps=41)["position"], axis=0) != 0
    first = moves.argmax(axis=0) + 1
    assert len({*first.tolist()}) >= 8
    assert first.max() <= 10
    for row, step in enumerate(first):
        np.testing.assert_array_equal(np.flatnonzero(moves[:, row]) + 1, np.arange(step, 41, 10))


def test_a_phase_without_redraws_is_refused():
    for options in ({}, {"delay_update_period": 5, "delay_hold_prob": 1.0}):
        with pytest.raises(ValueError, match=r"delay_per_env_phase=True .* no redraws"):
            wandering(delay_per_env_phase=True, **options)
    with pytest.raises(ValueError, match="no redraws"):
        delayed(IDEAL, 3, delay_per_env_phase=True, delay_update_period=5)


# Lags that are set.


@pytest.mark.parametrize("shared", [False, True])
def test_lags_that_are_set_hold_until_the_next_draw(shared):
    options = {"delay_hold_prob": 1.0, "delay_shared": shared}
    actuator, physics = built(wandering(**options), robot())
    actuator.set_lags(7)
    assert (lags_of(actuator)["velocity"] == 7).all()
    batch = batch_of(physics, 4)
    actuator.initialize(batch)
    actuator.reset()
    actuator.set_lags([2, 9], env_ids=[0, 3])
    before = actuator.lag("effort")
    assert before[[0, 3]].tolist() == [2, 9]
    actuator.reset([1])
    assert actuator.lag("effort")[[0, 2, 3]].tolist() == before[[0, 2, 3]].tolist()


def test_a_set_lag_is_that_of_the_targets():
    actuator, _ = built(wandering(delay_hold_prob=1.0), robot())
    actuator.set_lags(4)
    q, qd = actuator.base.state()
    past = [np.full(3, float(k)) for k in range(15)]
    for target in past:
        actuator.compute(ActuatorCmd(position_target=target))
    np.testing.assert_allclose(
        actuator.computed_effort, pd(25.0, 0.4, past[-5], None, None, q, qd), rtol=1e-12
    )


@pytest.mark.parametrize("lags", [-1, 10, 2.5, [1, 2], float("nan")])
def test_lags_that_cannot_be(lags):
    actuator, _ = built(wandering(), robot())
    with pytest.raises(ValueError, match=r"lags should be .*(0 to delay_max_lag=9|shape \(2,\))"):
        actuator.set_lags(lags)


def test_a_lag_that_mujoco_keeps_cannot_be_set_and_the_remedy_can():
    actuator, _ = built(delayed(POSITION, 4), robot())
    with pytest.raises(ValueError, match=r"always 4.*delay_min_lag below its delay_max_lag"):
        actuator.set_lags(2)
    remedy = DelayedActuatorCfg(
        base_cfg=POSITION, delay_min_lag=3, delay_max_lag=4, delay_hold_prob=1.0
    )
    actuator, _ = built(remedy, robot())
    actuator.set_lags(2)
    assert (lags_of(actuator, ("position",))["position"] == 2).all()


# Refusals.


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"delay_min_lag": 3, "delay_max_lag": 2}, ValueError, "delay_min_lag=3.*delay_max_lag=2"),
        ({"delay_min_lag": -1}, ValueError, "delay_min_lag should be at least 0, got -1"),
        ({"delay_max_lag": 1.5}, TypeError, "delay_max_lag should be a whole number, got 1.5"),
        ({"delay_max_lag": True}, TypeError, "delay_max_lag should be a whole number, got True"),
        ({"delay_hold_prob": 2}, ValueError, "delay_hold_prob .*at most 1, got 2"),
        (
            {"delay_hold_prob": float("nan")},
            ValueError,
            "delay_hold_prob should be finite",
        ),
        ({"delay_update_period": -4}, ValueError, "delay_update_period should be at least 0, got"),
        ({"seed": -1}, ValueError, "seed should be at least 0, got -1"),
        ({"delay_target": "torque"}, ValueError, "delay_target .*'position'.*got 'torque'"),
        ({"delay_target": ()}, ValueError, r"delay_target .*got \(\)"),
        ({"delay_target": ("effort", "effort")}, ValueError, "delay_target .*got"),
        ({"delay_target": 3}, ValueError, "delay_target .*got 3"),
        ({"delay_target": (["effort"],)}, ValueError, "delay_target .*got"),
        ({"base_cfg": "IdealPd"}, TypeError, "base_cfg should be the config .*got 'IdealPd'"),
        ({"base_cfg": delayed(IDEAL, 1)}, TypeError, "base_cfg should be .*without delay"),
    ],
)
def test_bad_configs(options, error, message):
    with pytest.raises(error, match=message):
        DelayedActuatorCfg(**{"base_cfg": IDEAL, **options})


def test_what_it_is_besides_is_its_base():
    cfg = delayed(IDEAL, 2)
    assert cfg.joint_names_expr == EXPRESSIONS
    actuator, _ = built(cfg, robot())
    assert actuator.takes == actuator.base.takes
    assert actuator.needs == actuator.base.needs == {"position_target"}
    assert not actuator.holds
