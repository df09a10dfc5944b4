"""The ground of the rehearsal's hardware, against statics and Coulomb's law: four feet."""

import mujoco
import mujoco.batch
import numpy as np
import pytest

from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hardware_base import base_readings, free_joint
from walkerkit.gap.rehearsal.hardware_ground import SINK, Soil
from walkerkit.gap.rehearsal.hidden import HiddenEffect

STEP = 5e-4
G, MASS = 9.81, 2.0 + 4 * 0.1
FOOT = '<geom size="0.02" pos="{x} {y} -0.02" mass="0.1" friction="0.6"/>'
PUCK = """
<mujoco><option timestep="0.0005" integrator="Euler"/><worldbody>
<geom type="plane" size="0 0 1" pos="0 0 0.1" friction="0.2"/>
<body name="puck" pos="0 0 {height}"><freejoint/>
  <geom type="box" size="0.2 0.2 0.01" mass="2" contype="0" conaffinity="0"/>{feet}</body>
</worldbody></mujoco>
"""
FEET = "".join(FOOT.format(x=x, y=y) for x in (-0.2, 0.2) for y in (-0.2, 0.2))


def slide(seconds, tilts, *, height=0.14, **hidden):
    """Poses of pucks on slopes of these angles, from a height, (n_steps, n_sims, 7)."""
    model = mujoco.MjModel.from_xml_string(PUCK.format(height=0.14, feet=FEET))
    effects = [HiddenEffect(effect=name, values=values) for name, values in hidden.items()]
    soil = Soil(model, effects, step=STEP, n_sims=len(tilts))
    assert soil.any
    batch = mujoco.batch.Batch(model, len(tilts), nthread=1, persistent=True)
    gravity = batch.expand("opt.gravity")
    gravity[:] = G * np.stack([np.sin(tilts), np.zeros_like(tilts), -np.cos(tilts)], axis=1)
    qpos = batch.bind("qpos")
    qpos[:, 2] = height
    soil.watch(batch)
    rows = []
    for _ in range(round(seconds / STEP)):
        soil.push(batch)
        batch.step(stage=int(mujoco.mjtStage.mjSTAGE_VEL))
        rows.append(qpos.copy())
    return np.array(rows)


def test_what_stands_sinks_in_by_its_weight():
    nominal = slide(0.6, np.zeros(1))
    assert 0.14 - nominal[-1, 0, 2] == pytest.approx(SINK, rel=1e-3)
    soft = slide(1.5, np.zeros(1), ground_compliance={"stiffness": 3000.0})
    assert 0.14 - soft[-1, 0, 2] == pytest.approx(MASS * G / 4 / 3000, rel=1e-2)
    np.testing.assert_allclose(soft[-1, 0, :2], 0.0, atol=1e-9)


def test_what_does_not_slip_does_not_creep():
    held = slide(2.0, np.array([0.9 * np.arctan(0.6)]))
    assert np.ptp(held[1200:, 0, 0]) < 1e-6
    assert held[-1, 0, 0] < 2 * SINK


@pytest.mark.parametrize("friction", [0.6, 0.3])
def test_what_slips_is_held_back_by_coulomb_s_law(friction):
    hidden = {} if friction == 0.6 else {"ground_friction": {"friction": friction}}
    tilts = np.array([0.8, 1.3, 1.6]) * np.arctan(friction)
    x = slide(1.2, tilts, **hidden)[:, :, 0]
    speed = np.gradient(x, STEP, axis=0)
    acceleration = (speed[-100] - speed[1200]) / (STEP * (len(x) - 100 - 1200))
    expected = np.maximum(G * (np.sin(tilts) - friction * np.cos(tilts)), 0.0)
    np.testing.assert_allclose(acceleration, expected, atol=0.01 * G)


def test_what_falls_comes_to_rest():
    z = slide(1.5, np.zeros(1), height=0.19)[:, 0, 2]
    assert z.min() > 0.13
    assert np.ptp(z[-400:]) < 1e-4


def compiled(text, changes):
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    return mujoco.MjModel.from_xml_string(text)


@pytest.mark.parametrize(
    "changes",
    [
        {'pos="0 0 0.14"': 'pos="0 0 1"'},
        {"/><worldbody>": '><flag contact="disable"/></option><worldbody>'},
    ],
    ids=["it falls", "no contacts"],
)
def test_what_does_not_stand_at_home_falls_on_the_ground_of_the_model(changes):
    model = compiled(PUCK.format(height=0.14, feet=FEET), changes)
    before = model.geom_contype.copy()
    assert not Soil(model, [], step=STEP, n_sims=1).any
    np.testing.assert_array_equal(model.geom_contype, before)


def test_feet_still_meet_all_but_the_ground():
    ball = '<body pos="0 0 1"><freejoint/><geom name="ball" size="0.02" mass="0.1"/></body>'
    model = compiled(PUCK.format(height=0.14, feet=FEET), {"</worldbody>": ball + "</worldbody>"})
    assert Soil(model, [], step=STEP, n_sims=1).any
    data = mujoco.MjData(model)
    data.qpos[2] = 0.14 - 2e-3
    place, ball_id = data.qpos[7:10], model.geom("ball").id
    place[:] = [-0.2, -0.2, 0.12 - 2e-3 + 0.039]
    mujoco.mj_forward(model, data)
    assert [ball_id in pair and 0 not in pair for pair in data.contact.geom.tolist()] == [True]
    place[:] = [1.0, 0.0, 0.1 + 0.019]
    mujoco.mj_forward(model, data)
    assert [set(pair) for pair in data.contact.geom.tolist()] == [{0, ball_id}]


def test_a_ground_without_a_bit_of_its_own_is_refused():
    text = PUCK.format(height=0.14, feet=FEET)
    model = compiled(text, {'friction="0.6"': 'friction="0.6" conaffinity="2147483647"'})
    with pytest.raises(InputError, match="uses all of its 31 bits"):
        Soil(model, [], step=STEP, n_sims=1)


def test_frictionless_feet_slide():
    changes = {'friction="0.6"': 'condim="1" friction="0.6"', 'friction="0.2"': 'condim="1"'}
    model = compiled(PUCK.format(height=0.14, feet=FEET), changes)
    soil = Soil(model, [], step=STEP, n_sims=1)
    batch = mujoco.batch.Batch(model, 1, nthread=1, persistent=True)
    batch.bind("qvel")[:, 0] = 0.3
    soil.watch(batch)
    for _ in range(400):
        soil.push(batch)
        batch.step(stage=int(mujoco.mjtStage.mjSTAGE_VEL))
    assert batch.bind("qvel")[0, 0] == pytest.approx(0.3, rel=1e-3)


@pytest.mark.parametrize("without", ["<freejoint/>", FEET])
def test_without_feet_there_is_no_ground_to_hide_in(without):
    text = PUCK.format(height=0.14, feet=FEET).replace(without, "")
    model = mujoco.MjModel.from_xml_string(text)
    assert not Soil(model, [], step=STEP, n_sims=1).any
    hidden = HiddenEffect(effect="ground_friction", values={"friction": 0.3})
    with pytest.raises(InputError, match="ground_friction is hidden, and the robot has no feet"):
        Soil(model, [hidden], step=STEP, n_sims=1)
    assert (free_joint(model) is None) == (without == "<freejoint/>")


def test_readings_of_the_base_are_noisy_and_right():
    turn = np.array([0.5, 0.5, -0.5, 0.5])
    states = np.tile(np.r_[1.0, 2.0, 3.0, turn, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0], (4000, 1))
    columns = base_readings(states, np.random.default_rng(0))
    for k, axis in enumerate("xyz"):
        for name, first in (("position", 1), ("linear_velocity", 4), ("angular_velocity", 7)):
            values = columns[f"base/{name}_{axis}"]
            assert values.mean() == pytest.approx(first + k, abs=1e-3)
            assert values.std() > 1e-4
    quaternions = np.stack([columns[f"base/quaternion_{axis}"] for axis in "wxyz"], axis=1)
    np.testing.assert_allclose(np.linalg.norm(quaternions, axis=1), 1.0, atol=1e-12)
    error = np.zeros((len(states), 3))
    for row, quaternion in zip(error, quaternions, strict=True):
        mujoco.mju_subQuat(row, quaternion, turn)
    np.testing.assert_allclose(error.std(axis=0), 1e-3, rtol=0.1)
