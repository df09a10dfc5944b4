"""What each effect of the catalogue keeps.

A subclass of `EffectContract` names an effect and plants it in a machine by other means than the
effect itself: plain model fields, or the machine's own delays and offsets.
"""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from dm_control import mjcf

from tests.gap.effects.machine import JOINTS, NOISE, Machine, replay_of
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.certainty import covariance
from walkerkit.gap.search.fit import evaluate, fit
from walkerkit.gap.search.objective import Objective
from walkerkit.gap.search.screen import screen
from walkerkit.gap.search.structure import Structure, candidate_terms
from walkerkit.gap.simulation.excursion import excursions
from walkerkit.gap.simulation.load_robot import load_robot, robot_from_spec
from walkerkit.gap.simulation.mend import mend, write_model
from walkerkit.gap.simulation.sidecar import FILE, sidecar, with_sidecar
from walkerkit.gap.simulation.trials import Trials

BRIEF = 0.8  # s, in which everything moves; equal bit for bit or not shows at once


def replayed(robot, recording, trials):
    return replay_of(robot, recording).predict(trials)


class EffectContract:
    """What every effect of the catalogue promises.

    Attributes:
        name: the effect.
        seconds: of the log that it takes to show and to be found.
        may_be_out_of_reach: whether some of its starts may lie where the motion never gets.
        noises_left: the largest gap that the fit may leave, in noises.
        rounding: how far the digits of the mended files may move positions and efforts.
        chosen: whether its values are chosen among its starts and not fitted.
        idle: parameters that mean nothing where there is nothing of the effect, such as a limit.
    """

    name = ""
    seconds = 4.0
    may_be_out_of_reach = False
    noises_left = 2.0
    rounding = 1e-6
    chosen = False
    idle: tuple[str, ...] = ()

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

    def log_of(self, variant, request):
        """A robot, and the beginning of its log."""
        robot, recording = request.getfixturevalue(variant)
        return robot, recording.between(0.0, self.seconds)

    def test_says_what_it_is(self):
        effect = self.effect
        assert effect.name == self.name
        for text in (
            effect.equation,
            effect.symptom,
            effect.added_as,
            effect.source,
            effect.part,
        ):
            assert text
            assert text == text.strip()
        assert type(effect).__doc__

    @pytest.mark.parametrize("variant", ["plain", "awkward"])
    def test_zero_changes_nothing_bit_for_bit(self, variant, request):
        robot, recording = self.log_of(variant, request)
        recording = recording.between(0.0, BRIEF)
        structure = Structure((self.term(robot),), (robot,))
        trials = structure.trials(robot, np.stack([structure.zero, structure.zero]))
        expected = replayed(robot, recording, Trials(robot, 1))
        np.testing.assert_array_equal(
            replayed(robot, recording, trials), np.concatenate([expected, expected])
        )
        assert structure.trials(robot, np.empty((0, len(structure.slots)))).n == 0

    @pytest.mark.parametrize("variant", ["plain", "awkward"])
    def test_what_shapes_it_changes_nothing_by_itself(self, variant, request):
        robot, recording = self.log_of(variant, request)
        structure = Structure((self.term(robot),), (robot,))
        every = np.array([slot.parameter.starts[-1] for slot in structure.slots])
        shapes = np.array([slot.parameter.shape for slot in structure.slots])
        values = np.stack([structure.zero, np.where(shapes, every, structure.zero)])
        nothing, shaped = replayed(
            robot, recording.between(0.0, BRIEF), structure.trials(robot, values)
        )
        np.testing.assert_array_equal(shaped, nothing)
        for place in structure.terms[0].places:
            assert not shapes[structure.columns(structure.terms[0], place)].all()

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
        robot, recording = self.log_of(variant, request)
        term = self.term(robot)
        structure = Structure((term,), (robot,))
        rows, cases = [], []
        for place in term.places:
            columns = structure.columns(term, place)
            starts = np.array([structure.slots[c].parameter.starts for c in columns]).T
            for start in starts:
                if self.chosen:  # from nothing to each start, instead of from there
                    values = np.tile(structure.zero, (2, 1))
                    values[1, columns] = start
                else:
                    fitted = [c for c in columns if not structure.slots[c].parameter.choice]
                    values = np.tile(structure.zero, (len(fitted) + 1, 1))
                    values[:, columns] = start
                    for row, column in enumerate(fitted, start=1):
                        move = 0.02 * structure.scale[column]
                        inside = values[row, column] + move <= structure.bounds[1][column]
                        values[row, column] += move if inside else -move
                cases.append((place, slice(len(rows), len(rows) + len(values))))
                rows.extend(values)
        predicted = replayed(robot, recording, structure.trials(robot, np.array(rows)))
        seen = {place: [] for place in term.places}
        for place, case in cases:
            changes = predicted[case][1:] - predicted[case][0]
            assert np.isfinite(changes).all()
            seen[place].append((np.abs(changes).max(axis=(1, 2)) > 1e-9).all())
        for place, found in seen.items():
            assert any(found) if self.may_be_out_of_reach else all(found), (place, found)

    def test_planted_values_are_recovered(self, plain):
        robot, _ = plain
        machine = Machine(robot)
        truth = self.plant(machine)
        recording = machine.log(self.seconds, seed=sum(map(ord, self.name)))
        robot = replace(robot, excursions=excursions(robot, [recording], JOINTS))
        replay = replay_of(robot, recording)
        noise = np.array([NOISE[channel.quantity] for channel in replay.channels])
        objective = Objective([replay], replay.channels, 0.5 * noise)
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
            if slot.place in truth and slot.parameter.choice:
                size = 0.0
            elif slot.place in truth:
                size = max(0.05 * abs(wanted), 3 * sigma)
                assert 3 * sigma < 0.5 * abs(wanted)
            elif slot.parameter.name in self.idle:
                continue
            else:
                size = max(0.2 * slot.parameter.scale, 3 * sigma)
            assert value == pytest.approx(wanted, abs=size), (slot.place, slot.parameter.name)
        residual = np.sqrt(found.mean_square)
        np.testing.assert_array_less(residual, self.noises_left * noise)

    @pytest.mark.parametrize("variant", ["plain", "awkward"])
    def test_mended_model_moves_as_the_trial_did(self, variant, request, tmp_path):
        robot, recording = self.log_of(variant, request)
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
        """A value with many digits that does something, unlike all starts; or the usual choice."""
        if parameter.choice:
            return parameter.starts[0]
        return parameter.starts[-1] * 0.8127364523 + parameter.starts[0] * 0.1234567

    def close(self, got, expected):
        assert np.isfinite(expected).all()
        np.testing.assert_allclose(got, expected, rtol=1e-6, atol=self.rounding)
