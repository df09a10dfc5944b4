"""One table of structures: weights, confidence, what could be exchanged, what is worth a name."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.special import gammaln

from tests.gap.search.test_naming import LEG, problem_of
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.compare import (
    Member,
    Table,
    described,
    is_worth_a_name,
    leaves_smaller_gaps,
)
from walkerkit.gap.search.decision import (
    CONFUSION,
    LEAST_GAIN,
    PRICE_PLACE,
    PRICE_RARE,
    TAILS,
    TEMPERATURE,
)
from walkerkit.gap.search.problem import Problem
from walkerkit.gap.search.score import Scores
from walkerkit.gap.search.structure import Fit, Structure, Term

BLOCKS, ROWS = 40, 20
FLOOR = 1e-3


@pytest.fixture(scope="module")
def problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    model = tmp_path_factory.mktemp("leg") / "leg.xml"
    model.write_text(LEG)
    return problem_of(model, ())


def scores(*sizes: float, wild: float = 0.0) -> Scores:
    """Blocks of a channel each, whose residuals have such sizes; one block may be wild."""
    squares = ROWS * np.tile(np.square(sizes), (BLOCKS, 1))
    squares *= np.linspace(0.8, 1.2, BLOCKS)[:, None]
    if wild:
        squares[0] = ROWS * wild**2
    return Scores(
        squares=squares,
        elsewhere=squares,
        count=np.full_like(squares, ROWS),
        memory=np.ones(len(sizes)),
        floor=np.full(len(sizes), FLOOR),
    )


def member(problem: Problem, effects: dict[str, tuple[str, ...]], of: Scores) -> Member:
    nothing = Fit(structure=problem.nothing, values=np.zeros(0), score=0.0, mean_square=np.zeros(1))
    return Member(effects=effects, scores=of, fit=nothing, kept=np.arange(0), values=np.zeros(0))


def test_a_block_is_scored_by_a_student_t() -> None:
    one = scores(0.02)
    (density, *_) = one.elpd(one)
    # The variance is that at which the density of all blocks is largest.
    variance = np.linspace(0.9, 1.1, 2001) * 0.02**2

    def log_t(square: float, v: np.ndarray) -> np.ndarray:
        return (
            gammaln(0.5 * (TAILS + ROWS))
            - gammaln(0.5 * TAILS)
            - 0.5 * ROWS * np.log(TAILS * np.pi * v)
            - 0.5 * (TAILS + ROWS) * np.log1p(square / (TAILS * v))
        )

    every = np.sum([log_t(square, variance) for square in one.squares[:, 0]], axis=0)
    best = variance[int(np.argmax(every))]
    assert density == pytest.approx(float(log_t(one.squares[0, 0], best)), abs=1e-2)


def test_samples_that_are_alike_count_as_fewer() -> None:
    """Of memory 4, twenty samples tell what five do whose squares are a fourth."""
    alike = replace(scores(0.02), memory=np.full(1, 4.0))
    fewer = scores(0.02)
    fewer = replace(
        fewer,
        squares=fewer.squares / 4,
        elsewhere=fewer.elsewhere / 4,
        count=np.full_like(fewer.count, ROWS / 4),
    )
    assert alike.elpd(alike) == pytest.approx(fewer.elpd(fewer))


def test_a_wild_block_does_not_outvote_the_rest(problem: Problem) -> None:
    right = member(problem, {"armature": ("knee",)}, scores(0.01, wild=10.0))
    wrong = member(problem, {"payload": ("shin",)}, scores(0.02, wild=1.0))
    assert Table((wrong, right)).best is right


def test_weights_go_with_the_prior_and_the_elpd(problem: Problem) -> None:
    same = scores(0.01)
    usual = member(problem, {"armature": ("knee",)}, same)
    rare = member(problem, {"payload": ("shin",)}, same)
    table = Table((usual, rare))
    assert table.weights.sum() == pytest.approx(1)
    assert table.weights[0] / table.weights[1] == pytest.approx(np.exp(PRICE_RARE))
    assert usual.log_prior == -PRICE_PLACE
    assert rare.log_prior == -PRICE_RARE - PRICE_PLACE
    nothing = member(problem, {}, same)
    assert Table((nothing, usual)).best is nothing


def test_what_is_doubted_costs_nothing_where_it_is_doubted(problem: Problem) -> None:
    one = member(problem, {"payload": ("shin", "thigh")}, scores(0.01))

    def doubting(*bodies: str) -> float:
        sites = ("shin", "thigh")
        term = Term(effect=CATALOGUE["payload"], sites=sites, doubted=frozenset(bodies))
        structure = Structure((term,), problem.robots)
        fit = replace(one.fit, structure=structure, values=structure.zero)
        return replace(one, fit=fit, values=fit.values).log_prior

    assert doubting() == one.log_prior
    assert doubting("shin") - one.log_prior == pytest.approx(PRICE_PLACE)
    assert doubting("shin", "thigh") == 0


def test_a_number_costs_the_more_the_larger_it_is_and_a_choice_nothing(problem: Problem) -> None:
    one = member(problem, {"payload": ("shin",), "timestep": ("*",)}, scores(0.01))
    (size,) = CATALOGUE["payload"].parameters(problem.robots[0], "shin")
    terms = (
        Term(effect=CATALOGUE["payload"], sites=("shin",)),
        *problem.terms([CATALOGUE["timestep"]]),
    )
    structure = Structure(terms, problem.robots)
    fit = replace(one.fit, structure=structure, values=structure.zero)
    chosen = structure.zero[1:] + 2.0

    def weighing(mass: float) -> float:
        values = np.array([mass, *chosen])
        return replace(one, fit=fit, values=values, kept=np.arange(len(values))).log_prior

    for times in (1.0, 5.0):
        surprise = 0.5 * TAILS * np.log1p(times**2 / TAILS)
        assert weighing(0.0) - weighing(times * size.prior) == pytest.approx(surprise)
    assert weighing(0.0) == one.log_prior
    # What is not kept costs nothing.
    left_out = replace(one, fit=fit, values=structure.zero + size.prior, kept=np.arange(0))
    assert left_out.log_prior == one.log_prior


def test_the_order_of_effects_makes_no_other_structure(problem: Problem) -> None:
    both = {"armature": ("knee",), "payload": ("shin",)}
    one = member(problem, both, scores(0.01))
    other = member(problem, dict(reversed(both.items())), scores(0.01))
    assert one.key == other.key


def test_a_structure_that_several_fits_end_at_counts_once(problem: Problem) -> None:
    usual = member(problem, {"armature": ("knee",)}, scores(0.01))
    rare = member(problem, {"payload": ("shin",)}, scores(0.01))
    worse = replace(rare, scores=scores(0.0101))
    once, twice = Table((usual, rare)), Table((usual, worse, rare))
    assert twice.weights[[0, 2]] == pytest.approx(once.weights)
    assert twice.weights[1] == 0
    assert len(twice.frame()) == 2


def test_confidence_is_the_weight_of_all_that_have_it(problem: Problem) -> None:
    good, bad = scores(0.01), scores(0.05)
    table = Table(
        (
            member(problem, {"armature": ("knee",)}, good),
            member(problem, {"armature": ("knee",), "viscous_friction": ("knee",)}, good),
            member(problem, {}, bad),
        )
    )
    assert table.confidence([{"armature"}]) == pytest.approx(1, abs=1e-6)
    assert table.confidence([{"viscous_friction"}]) == pytest.approx(table.weights[1])
    assert table.confidence([{"payload"}]) == 0


def test_what_could_be_exchanged_lacks_nothing_else(problem: Problem) -> None:
    alike = scores(0.01)
    both = {"armature": ("knee",), "viscous_friction": ("knee",)}
    table = Table(
        (
            member(problem, both, alike),
            member(problem, {"armature": ("knee",), "velocity_gain": ("knee",)}, alike),
            member(problem, {"coulomb_friction": ("knee",)}, alike),
        )
    )
    assert table.best.effects == {"coulomb_friction": ("knee",)}
    assert set(table.exchanges("coulomb_friction", {"coulomb_friction"})) == {
        *both,
        "velocity_gain",
    }
    # What has it by another name has nothing else in its place.
    told = {"coulomb_friction"}
    assert set(table.exchanges("coulomb_friction", told, [{"velocity_gain"}])) == {*both}
    far = Table((member(problem, both, alike), member(problem, {}, scores(0.1))))
    assert far.weights[0] > CONFUSION
    assert far.exchanges("armature", both.keys()) == {}


def test_what_is_ordinary_may_follow_what_is_in_a_rare_effects_place(problem: Problem) -> None:
    told = {"payload": ("shin",), "armature": ("knee",), "command_delay": ("*",)}
    other = {"torque_constant": ("knee",), "command_delay": ("*",)}
    table = Table((member(problem, told, scores(0.01)), member(problem, other, scores(0.01005))))
    assert set(table.exchanges("payload", told.keys())) == {"torque_constant"}
    assert table.exchanges("armature", told.keys()) == {}


def test_what_is_told_though_another_is_better_has_that_in_its_place(problem: Problem) -> None:
    told, better = {"armature": ("knee",), "payload": ("shin",)}, {"backlash": ("knee",)}
    table = Table((member(problem, told, scores(0.01)), member(problem, better, scores(0.0099))))
    assert table.best.effects == better
    assert set(table.exchanges("payload", told.keys())) == {"backlash"}
    assert set(table.exchanges("payload", {"payload"})) == {"backlash"}


def test_two_that_leave_the_same_log_together_are_another_name(problem: Problem) -> None:
    alike, ways = scores(0.01), [{"asymmetric_friction"}, {"coulomb_friction", "torque_bias"}]
    told, pair, part = (
        member(problem, dict.fromkeys(names, ("knee",)), alike)
        for names in (ways[0], sorted(ways[1]), ["torque_bias"])
    )
    table = Table((told, pair, part))
    assert table.confidence(ways) == pytest.approx(table.weights[:2].sum())
    assert set(table.exchanges("asymmetric_friction", ways[0], ways)) == {"torque_bias"}
    assert table.share(ways, ["position"]) == 0.0  # the best without it leaves as much


def test_what_a_choice_owes_to_all_blocks_is_taken_off_their_densities(problem: Problem) -> None:
    one = member(problem, {"cogging": ("knee",)}, scores(0.01))
    owed = np.linspace(0.0, 1.0, BLOCKS)
    less = replace(one, too_good=owed)
    (full, rest) = Table((one, less)).blocks
    np.testing.assert_allclose(full - rest, owed)


def test_what_is_exchanged_together_comes_in_the_order_of_its_structure(problem: Problem) -> None:
    names = (
        *("velocity_gain", "armature", "viscous_friction"),
        *("command_delay", "coulomb_friction", "position_gain"),
    )
    told = member(problem, {"asymmetric_friction": ("knee",)}, scores(0.01))
    other = member(problem, dict.fromkeys(names, ("knee",)), scores(0.01005))
    table = Table((told, other))
    assert table.best is told
    assert tuple(table.exchanges("asymmetric_friction", {"asymmetric_friction"})) == names


def test_the_frame_has_a_row_for_each(problem: Problem) -> None:
    better, worse = scores(0.01), scores(0.02, wild=0.1)
    table = Table(
        (member(problem, {}, worse), member(problem, {"payload": ("shin", "thigh")}, better))
    )
    frame = table.frame()
    assert list(frame.structure) == ["payload (shin, thigh)", "nothing"]
    assert frame.difference[0] == 0
    assert frame.difference[1] < 0
    expected = (table.blocks[0] - table.blocks[1]).sum()
    assert frame.difference[1] == pytest.approx(expected)
    assert frame.weight[1] < np.exp(-frame.se[1] / TEMPERATURE)
    # Of a sum over blocks, as Vehtari, Gelman and Gabry (2017) have it.
    of_blocks = table.blocks[0] - table.blocks[1]
    assert frame.se[1] == pytest.approx(np.sqrt(BLOCKS) * np.std(of_blocks))


def test_effects_of_all_joints_need_no_places() -> None:
    assert described({"command_delay": ("*",), "armature": ("a", "b")}) == (
        "command_delay + armature (a, b)"
    )


@pytest.mark.parametrize(
    ("before", "after", "worth"),
    [
        (0.02, 0.01, True),
        (0.02, 0.02 * np.exp(-1.9 * LEAST_GAIN), False),
        (0.02, 0.02 * np.exp(-2.1 * LEAST_GAIN), True),
        (0.2 * FLOOR, 0.1 * FLOOR, False),  # below the floor nothing is worth anything
        (0.01, 0.02, False),
    ],
)
def test_what_is_worth_a_name(problem: Problem, before: float, after: float, worth: bool) -> None:
    old, new = (member(problem, {}, scores(size, 0.02)) for size in (before, after))
    assert is_worth_a_name(old, new, ["knee", "ankle"]) is worth


def test_the_typical_block_is_enough(problem: Problem) -> None:
    old = member(problem, {}, scores(0.02, wild=5.0))
    new = member(problem, {}, scores(0.01, wild=5.0))
    assert is_worth_a_name(old, new, ["knee"])


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_and_so_is_a_wild_one_that_holds_much_of_all(part: float) -> None:
    """Over all blocks the gap shrinks by a part of LEAST_GAIN, in the typical one by less."""
    after = np.full((BLOCKS, 1), ROWS * 0.02**2)
    before = after.copy()
    before[0] += after.sum() * (np.exp(2 * part * LEAST_GAIN) - 1)
    assert 0.5 * np.log(before[0] / after[0]) / BLOCKS < 0.8 * LEAST_GAIN
    count = np.full_like(before, ROWS)
    worth = leaves_smaller_gaps(before, after, count=count, floor=np.full(1, 1e-6), joints=["knee"])
    assert worth is (part > 1)


@pytest.mark.parametrize("part", [0.9, 1.1])
def test_what_is_below_the_floor_is_as_small_as_the_floor(part: float) -> None:
    count = np.full((BLOCKS, 1), ROWS)
    after = count * (0.1 * FLOOR) ** 2
    before = count * (2 * np.exp(2 * part * LEAST_GAIN) - 1) * FLOOR**2
    worth = leaves_smaller_gaps(
        before, after, count=count, floor=np.full(1, FLOOR), joints=["knee"]
    )
    assert worth is (part > 1)


def test_blocks_in_which_a_channel_was_not_measured_say_nothing_of_it() -> None:
    count = np.full((BLOCKS, 1), ROWS)
    count[1:] = 0
    after = count * 0.02**2
    gains = {part: np.exp(2 * part * LEAST_GAIN) for part in (0.9, 1.1)}
    for part, gain in gains.items():
        found = leaves_smaller_gaps(
            gain * after, after, count=count, floor=np.full(1, 1e-6), joints=["knee"]
        )
        assert found is (part > 1)


def test_what_comes_back_without_an_effect(problem: Problem) -> None:
    """Of squares over both joints: 5 without it, 2 with it, 10 with nothing; of effort half."""
    nothing = member(problem, {}, scores(3.0, 1.0, 2.0))
    without = member(problem, {"armature": ("knee",)}, scores(2.0, 1.0, 1.5))
    both = {"armature": ("knee",), "payload": ("shin",)}
    best = member(problem, both, scores(1.0, 1.0, 0.5))
    table = Table((nothing, without, best))
    assert table.best is best
    expected = np.mean([(5 - 2) / 10, (1.5**2 - 0.5**2) / 2**2])
    share = table.share([{"payload"}], ["position", "position", "effort"])
    assert share == pytest.approx(expected)
    assert Table((best,)).share([{"payload"}], ["position", "position", "effort"]) == np.inf


def test_what_comes_back_is_of_blocks_of_other_recordings_too(problem: Problem) -> None:
    """Of squares: without it 1 beside what was fitted, 7 in other recordings; with it a quarter."""
    of = scores(1.0)
    without = member(problem, {}, replace(of, elsewhere=7 * of.squares))
    best = member(problem, {"payload": ("shin",)}, scores(0.5))
    assert Table((without, best)).share([{"payload"}], ["position"]) == pytest.approx(
        (4 - 0.25) / 4
    )


def test_of_those_that_hardly_differ_the_smallest_is_told(problem: Problem) -> None:
    def fitted(kept: int, size: float) -> Member:
        one = member(problem, {"armature": ("knee",)}, scores(size))
        return replace(one, kept=np.arange(0), values=np.zeros(0), effects={f"e{kept}": ("knee",)})

    smaller = replace(fitted(1, 0.01), kept=np.arange(0))
    table = Table((fitted(2, 0.01), smaller))
    near = np.array([0.0, -0.5 * PRICE_PLACE])
    kept = {id(one): k for k, one in enumerate(table.members)}
    assert kept[id(table.best_by(near))] == 0  # as many numbers, the first
    assert table.best_by(np.array([-0.6 * PRICE_PLACE, 0.0])) is smaller
    larger = replace(fitted(2, 0.01), kept=np.arange(3))
    of_two = Table((larger, smaller))
    for worth in (0.0, 100.0, -100.0):
        near, far = (np.array([worth, worth - part * PRICE_PLACE]) for part in (0.4, 0.6))
        assert of_two.best_by(near) is smaller
        assert of_two.best_by(far) is larger
    assert table.best_of([smaller.key]) is smaller
    assert table.worth_of(smaller) == table.worth[1]


def test_at_one_joint_a_gap_has_to_shrink_twice_as_far(problem: Problem) -> None:
    def worth(gain: float) -> bool:
        old = member(problem, {}, scores(0.02, 0.02, 0.02))
        new = member(problem, {}, scores(0.02 * np.exp(-gain), 0.02, 0.02))
        return is_worth_a_name(old, new, ["knee", "ankle", "hip"])

    assert not worth(1.9 * LEAST_GAIN)
    assert worth(2.1 * LEAST_GAIN)


def test_what_changes_less_than_half_the_noise_is_worth_no_name(problem: Problem) -> None:
    def even(size: float) -> Member:
        squares = np.full((BLOCKS, 1), ROWS * size**2)
        return member(problem, {}, replace(scores(size), squares=squares))

    # Both leave gaps that are smaller by LEAST_GAIN.
    for gone, worth in ((0.49, False), (0.51, True)):
        before, after = even(FLOOR * np.hypot(1, gone)), even(FLOOR)
        assert is_worth_a_name(before, after, ["knee"]) is worth
