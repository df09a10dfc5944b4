import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from walkerkit.actuators.draws import check_pair, draw, draw_whole, support, vary

N = 200_000
SHARE = np.random.default_rng(0).uniform(size=N)


class TestDistributions:
    def test_uniform_is_flat(self):
        draws = draw((0.5, 2.0), "uniform", SHARE)
        counts, _ = np.histogram(draws, bins=10, range=(0.5, 2.0))
        np.testing.assert_allclose(counts, N / 10, rtol=0.02)
        assert draws.mean() == pytest.approx(1.25, abs=0.005)

    def test_log_uniform_is_flat_in_the_logarithm(self):
        draws = draw((0.1, 10.0), "log_uniform", SHARE)
        counts, _ = np.histogram(np.log(draws), bins=10, range=np.log((0.1, 10.0)))
        np.testing.assert_allclose(counts, N / 10, rtol=0.02)
        assert np.median(draws) == pytest.approx(1.0, rel=0.02)

    def test_gaussian_has_mean_and_deviation_and_ends(self):
        draws = draw((2.0, 0.5), "gaussian", SHARE)
        assert draws.mean() == pytest.approx(2.0, abs=0.005)
        # A normal distribution cut at 3 σ has 0.98658 of its standard deviation.
        assert draws.std() == pytest.approx(0.98658 * 0.5, rel=0.005)
        assert np.mean(np.abs(draws - 2.0) < 0.5) == pytest.approx(0.6827, abs=0.005)
        assert draws.min() >= 0.5
        assert draws.max() <= 3.5
        assert draws.min() < 0.6

    def test_whole_draws_are_alike_at_the_ends(self):
        draws = draw_whole((2.0, 5.0), SHARE)
        values, counts = np.unique(draws, return_counts=True)
        assert values.tolist() == [2, 3, 4, 5]
        np.testing.assert_allclose(counts, N / 4, rtol=0.02)

    @pytest.mark.parametrize("distribution", ["uniform", "log_uniform", "gaussian"])
    def test_a_range_without_width_is_its_value(self, distribution):
        pair = (1.3, 0.0) if distribution == "gaussian" else (1.3, 1.3)
        np.testing.assert_allclose(draw(pair, distribution, SHARE[:100]), 1.3, rtol=1e-15)

    @given(
        distribution=st.sampled_from(["uniform", "log_uniform", "gaussian"]),
        first=st.floats(1e-3, 1e3),
        width=st.floats(0, 1e3),
        share=st.floats(0, 1, exclude_max=True),
    )
    def test_no_draw_leaves_the_support(self, distribution, first, width, share):
        pair = (first, width if distribution == "gaussian" else first + width)
        low, high = support(pair, distribution)
        assert low <= draw(pair, distribution, np.array([share])).item() <= high

    @given(share=st.floats(0, 1, exclude_max=True), low=st.integers(0, 9), n=st.integers(0, 9))
    def test_whole_draws_stay_within(self, share, low, n):
        drawn = draw_whole((low, low + n), np.array([share])).item()
        assert low <= drawn <= low + n
        assert drawn == int(drawn)


class TestPairs:
    @pytest.mark.parametrize("value", [(0.8, 1.2), [0.8, 1.2], np.array([0.8, 1.2])])
    def test_takes_any_two_numbers(self, value):
        assert check_pair("it", value, "uniform") == (0.8, 1.2)

    @pytest.mark.parametrize("value", [1.0, (1.0,), (1.0, 2.0, 3.0), "ab", None, {1: 2, 3: 4}])
    def test_refuses_what_is_no_pair(self, value):
        with pytest.raises(TypeError, match=r"it should be two numbers \(low, high\)"):
            check_pair("it", value, "uniform")

    def test_refuses_what_is_no_number(self):
        with pytest.raises(TypeError, match=r"`it, \[1\]` should be a number, got 'x'"):
            check_pair("it", (1.0, "x"), "uniform")
        with pytest.raises(ValueError, match=r"`it, \[0\]` should be finite, got nan"):
            check_pair("it", (np.nan, 1.0), "uniform")

    def test_refuses_a_falling_range(self):
        with pytest.raises(ValueError, match=r"rise .* got \(1.2, 0.8\): use \(0.8, 1.2\)"):
            check_pair("it", (1.2, 0.8), "uniform")

    @pytest.mark.parametrize("low", [0.0, -1.0])
    def test_refuses_a_logarithm_of_nothing(self, low):
        with pytest.raises(ValueError, match="above 0 with log_uniform"):
            check_pair("it", (low, 1.0), "log_uniform")

    def test_a_gaussian_need_not_rise_but_its_deviation_is_not_negative(self):
        assert check_pair("it", (1.0, 0.2), "gaussian") == (1.0, 0.2)
        with pytest.raises(ValueError, match=r"got \(1, -0.2\), whose standard deviation"):
            check_pair("it", (1.0, -0.2), "gaussian")


class TestVary:
    def test_sees_one_simulation_at_a_time(self):
        seen = []

        def variation(initial, current, random_state):
            seen.append((initial, current))
            return random_state.uniform()

        initial, current = np.array([1.0, 2.0]), np.arange(6.0).reshape(3, 2)
        draws = vary(variation, initial, current, np.random.RandomState(0))
        assert [c.tolist() for _, c in seen] == [[0, 1], [2, 3], [4, 5]]
        assert all(i.tolist() == [1, 2] for i, _ in seen)
        # One number is for all joints of a simulation, and another one of the next.
        assert (draws[:, 0] == draws[:, 1]).all()
        assert len({*draws[:, 0]}) == 3

    def test_moves_the_generator_on(self):
        rng = np.random.default_rng(0)
        one = np.zeros(1)
        first = vary(lambda i, c, r: r.randint(10**9), one, one, rng)
        second = vary(lambda i, c, r: r.randint(10**9), one, one, rng)
        assert first != second

    def test_refuses_another_number_of_values(self):
        one = np.zeros(2)
        with pytest.raises(ValueError, match=r"returned \[1, 2, 3\] and should return a number"):
            vary(lambda i, c, r: [1, 2, 3], one, one, np.random.default_rng(0))
