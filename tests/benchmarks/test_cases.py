from collections import Counter

import mujoco
import numpy as np
import pytest

from benchmarks.hidden.cases import CLUTTER, SIGNALS, TIERS, cases
from benchmarks.hidden.clutter import GAINS, LITTLE, LOSSES, MASSES, clutter
from benchmarks.hidden.rigs import (
    EXPERIMENTS,
    HEAVIER,
    NUISANCE,
    OTHERWISE,
    RATE,
    RIGS,
    experiments,
    write_rig,
)
from benchmarks.hidden.truths import truth
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.rehearsal.hardware_drive import load_rig
from walkerkit.gap.rehearsal.hidden import HiddenEffect
from walkerkit.gap.rehearsal.hideable import GROUND, HIDEABLE, NAMELESS
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.walkers import LEG_XML


@pytest.mark.parametrize("tier", TIERS)
class TestTiers:
    def test_are_frozen_and_a_part_is_the_beginning_of_the_whole(self, tier):
        every = cases(tier)
        assert every == cases(tier)
        assert cases(tier, 5) == every[:5]
        assert len({case.name for case in every}) == len({case.seed for case in every})
        assert [case.number for case in every] == list(range(len(every)))

    def test_hide_what_can_be_hidden_on_rigs_that_there_are(self, tier):
        for case in cases(tier):
            assert case.rig in RIGS
            assert case.channels in SIGNALS
            assert set(case.hide) <= {*HIDEABLE, *GROUND, *NAMELESS, "timestep"}
            assert not case.removed or set(case.hide) <= set(HIDEABLE)


@pytest.mark.parametrize("tier", ["one_effect", "one_effect_q_qd", "one_effect_q"])
def test_every_effect_but_the_ground_s_is_hidden_on_either_rig(tier):
    places = Counter((case.hide[0], case.rig) for case in cases(tier))
    assert set(places) == {
        (e, rig) for e in set(CATALOGUE) - set(GROUND) for rig in ("pendulum", "leg")
    }
    assert set(places.values()) == {1}
    # A part of them is on both rigs, too.
    assert {case.rig for case in cases(tier, 8)} == {"pendulum", "leg"}


@pytest.mark.parametrize("tier", TIERS)
def test_other_draws_are_as_many_other_cases(tier):
    first, second = cases(tier), cases(tier, draw=2)
    assert len(first) == len(second)
    assert {case.seed for case in first}.isdisjoint(case.seed for case in second)
    assert {case.robot for case in first} == {None}
    assert None not in {case.robot for case in second}
    assert {case.tier for case in second} == {tier}


def test_every_effect_is_hidden_beside_another():
    assert {name for case in cases("two_effects") for name in case.hide} == set(HIDEABLE)
    assert all(len(set(case.hide)) == 2 for case in cases("two_effects"))


def test_nothing_is_hidden_in_every_way():
    some = cases("nothing")
    assert not any(case.hide for case in some)
    assert {case.off for case in some} == {"", "substeps", "timestep", "integrator", "nuisance"}
    assert {case.channels for case in some} == set(SIGNALS)


class TestCluttered:
    def test_hide_what_is_not_ordinary_on_robots_of_every_size(self):
        some = cases("cluttered")
        assert {case.rig for case in some} == {"pendulum", "leg", "hung_quadruped"}
        assert {case.hide[0] for case in some} == set(HIDEABLE) - set(CLUTTER)
        assert {case.off for case in some} == {"clutter"}

    def test_are_off_everywhere_by_no_more_than_they_may(self, tmp_path):
        spec = mujoco.MjSpec.from_file(str(write_rig("leg", tmp_path)))
        for joint, loss in zip(spec.joints, (0.2, 0.3, 0.0), strict=True):
            joint.frictionloss = loss
        path = tmp_path / "rubs.xml"
        path.write_text(spec.to_xml(), encoding="utf-8")
        real, beside = clutter(path, tmp_path, np.random.default_rng(3), rate=500.0)
        (machine, drives), (model, meant) = load_rig(real), load_rig(path)
        dofs = meant.dofs
        for field, most in (
            (machine.dof_armature[dofs] / model.dof_armature[dofs], LOSSES),
            (machine.dof_damping[dofs] / model.dof_damping[dofs], LOSSES),
            (drives.gain / meant.gain, GAINS),
            (drives.bias[2] / meant.bias[2], GAINS),
            (machine.body_mass[1:] / model.body_mass[1:], MASSES),
        ):
            assert 0 < np.abs(field - 1).max() <= most + 1e-6
            assert len(set(field)) == len(field)
        np.testing.assert_allclose(drives.gain, -drives.bias[1])
        # Its dry friction is that of bristles alone.
        assert not machine.dof_frictionloss.any()
        late, bristles = beside
        assert late.value("delay") == 1 / 500
        losses = [bristles.value("frictionloss", joint) for joint in meant.joints]
        off = np.array(losses[:2]) / [0.2, 0.3]
        assert 0 < np.abs(off - 1).max() <= LOSSES
        assert LITTLE[0] <= losses[2] / meant.effort_range[1, 2] <= LITTLE[1]


class TestRigs:
    @pytest.mark.parametrize(("name", "joints"), [("pendulum", 1), ("leg", 3)])
    def test_are_robots_that_the_workflow_and_the_hardware_take(self, tmp_path, name, joints):
        path = write_rig(name, tmp_path)
        assert len(load_rig(path)[1].joints) == joints
        assert len(load_robot(path).joints) == joints

    def test_the_quadruped_hangs_by_its_trunk(self, tmp_path):
        model, drives = load_rig(write_rig("hung_quadruped", tmp_path))
        assert len(drives.joints) == model.nv == 12
        assert not model.geom_contype.any()

    def test_are_off_by_no_more_than_they_may(self, tmp_path):
        real, _ = load_rig(write_rig("leg", tmp_path, nuisance=np.random.default_rng(0)))
        model, _ = load_rig(write_rig("leg", tmp_path))
        off = real.dof_armature / model.dof_armature - 1
        assert 0 < np.abs(off).max() <= NUISANCE
        assert len(set(off)) == 3
        np.testing.assert_array_equal(real.body_mass, model.body_mass)

    @pytest.mark.parametrize("name", RIGS)
    def test_have_other_numbers_as_other_robots(self, tmp_path, name):
        model, drives = load_rig(write_rig(name, tmp_path))
        (one, ones), (two, _) = (load_rig(write_rig(name, tmp_path, robot=i)) for i in (1, 2))
        assert one.body_mass.sum() != pytest.approx(two.body_mass.sum(), rel=0.05)
        weight = one.body_mass.sum() / model.body_mass.sum()
        assert HEAVIER[0] < weight < HEAVIER[1]
        np.testing.assert_allclose(one.body_inertia, weight * model.body_inertia, rtol=1e-5)
        gains = ones.gain / drives.gain / weight
        assert np.all((gains > OTHERWISE[0]) & (gains < OTHERWISE[1]))
        np.testing.assert_allclose(-ones.bias[1], ones.gain)
        np.testing.assert_allclose(ones.effort_range, weight * drives.effort_range, rtol=1e-5)

    def test_experiments_take_twelve_seconds_within_the_joints_ranges(self, tmp_path):
        path = write_rig("leg", tmp_path)
        targets = experiments("leg", path, seed=0)
        model, drives = load_rig(path)
        lower, upper = model.jnt_range[model.dof_jntid[drives.dofs]].T
        assert list(targets) == list(EXPERIMENTS)
        for of in targets.values():
            assert of.shape == (12 * RATE, 3)
            assert np.all((of >= lower) & (of <= upper))
        short = experiments("leg", path, seed=0, shorter=4.0)
        assert {len(of) for of in short.values()} == {3 * RATE}


class TestTruths:
    def test_are_by_the_names_of_the_catalogue(self):
        for name, kind in HIDEABLE.items():
            values = {parameter.name: 1.0 for parameter in kind.parameters}
            where = {"joints": ("calf",)} if kind.on == "joints" else {}
            where |= {"bodies": ("calf",)} if kind.on == "bodies" else {}
            one = HiddenEffect(effect=name, values=values, **where)
            robot = load_robot(LEG_XML)
            effect = CATALOGUE[name]
            site = "calf" if "calf" in effect.sites(robot, tuple(robot.joints)) else "*"
            known = {parameter.name for parameter in effect.parameters(robot, site)}
            assert set(truth(one, "calf" if where else "*")) <= known | {"x"}

    def test_are_those_of_the_place(self):
        friction = HiddenEffect(
            effect="coulomb_friction",
            joints=("hip", "calf"),
            values={"hip/frictionloss": 1.0, "calf/frictionloss": 2.0},
        )
        assert truth(friction, "calf") == {"frictionloss": 2.0}
        assert truth(friction, "thigh") == {}
        # One estimate for joints that differ has no truth.
        assert truth(friction, "*") == {}

    def test_of_all_joints_are_those_of_each(self):
        delay = HiddenEffect(effect="command_delay", joints=("*",), values={"delay": 0.01})
        assert truth(delay, "*") == truth(delay, "calf") == {"delay": 0.01}

    def test_are_turned_round_where_the_catalogue_says_it_otherwise(self):
        tilt = HiddenEffect(effect="base_tilt", values={"roll": 0.1, "pitch": -0.2})
        assert truth(tilt, "*") == {"roll": -0.1, "pitch": 0.2}
        gain = HiddenEffect(effect="position_gain", joints=("calf",), values={"delta_kp": 3.0})
        assert truth(gain, "calf") == {"kp": 3.0}
        soft = HiddenEffect(
            effect="series_elasticity", joints=("calf",), values={"stiffness": 50.0}
        )
        assert truth(soft, "calf") == {"compliance": 0.02}
