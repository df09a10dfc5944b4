"""Rows of a log: the same that a history makes, scaled by and split in time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from walkerkit.actuators.networks import History
from walkerkit.actuators.networks.training_rows import TrainingRows

NONE = {"pos_scale": None, "vel_scale": None, "torque_scale": None}


def log(n_times=60, n_joints=2, seed=0):
    rng = np.random.default_rng(seed)
    return {
        name: rng.normal(scale=scale, size=(n_times, n_joints))
        for name, scale in (("position_error", 0.1), ("velocity", 5.0), ("effort", 20.0))
    }


def rows_of(signals, *, length=3, order="pos_vel", given=NONE, fraction=0.5):
    return TrainingRows.of(
        signals,
        history_length=length,
        input_order=order,
        given=given,
        validation_fraction=fraction,
    )


@given(
    st.integers(1, 5),
    st.sampled_from(["pos_vel", "vel_pos"]),
    st.integers(1, 3),
    st.integers(0, 99),
)
def test_rows_are_those_of_a_history(length, order, n_joints, seed):
    signals = log(n_joints=n_joints, seed=seed)
    rows = rows_of(signals, length=length, order=order)
    scales = rows.scales
    history = History(
        (n_joints,),
        history_length=length,
        pos_scale=scales["pos_scale"],
        vel_scale=scales["vel_scale"],
        input_order=order,
    )
    pushed = np.array(
        [
            history.push(error, velocity).copy()
            for error, velocity in zip(signals["position_error"], signals["velocity"], strict=True)
        ]
    )
    efforts = signals["effort"] / scales["torque_scale"]
    for (features, targets), times in (
        (rows.training, slice(length - 1, 30)),
        (rows.validation, slice(30 + length - 1, 60)),
    ):
        np.testing.assert_array_equal(features, pushed[times].reshape(-1, 2 * length))
        np.testing.assert_array_equal(targets, efforts[times].reshape(-1, 1))


@given(st.integers(1, 6), st.floats(0.2, 0.8), st.integers(80, 200))
def test_no_sample_is_on_both_sides(length, fraction, n_times):
    time = np.arange(1.0, n_times + 1)[:, None]
    signals = {"position_error": time, "velocity": time, "effort": time}
    ones = {"pos_scale": 1.0, "vel_scale": 1.0, "torque_scale": 1.0}
    rows = rows_of(signals, length=length, given=ones, fraction=fraction)
    training, validation = (set(part[0].ravel()) for part in (rows.training, rows.validation))
    assert max(training) + 1 == min(validation)
    assert min(training) == 1
    assert max(validation) == n_times
    assert len(validation) == round(fraction * n_times)


class TestScales:
    def test_come_from_the_training_time(self):
        signals = log()
        scales = rows_of(signals).scales
        assert scales["pos_scale"] == pytest.approx(1 / np.std(signals["position_error"][:30]))
        assert scales["vel_scale"] == pytest.approx(1 / np.std(signals["velocity"][:30]))
        assert scales["torque_scale"] == pytest.approx(np.std(signals["effort"][:30]))
        later = {name: np.vstack([s[:30], 100 * s[30:]]) for name, s in signals.items()}
        assert rows_of(later).scales == scales

    def test_given(self):
        given = {"pos_scale": 2.0, "vel_scale": 0.05, "torque_scale": 10}
        assert rows_of(log(), given=given).scales == given

    @pytest.mark.parametrize("value", [0.0, 0.3])
    def test_signal_that_never_changes(self, value):
        signals = log() | {"velocity": np.full((60, 2), value)}
        assert rows_of(signals).scales["vel_scale"] == 1.0

    @pytest.mark.parametrize("name", NONE)
    @pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf])
    def test_wrong(self, name, value):
        with pytest.raises(ValueError, match=f"`{name}` is {value}"):
            rows_of(log(), given=NONE | {name: value})


def changed(name, at, value):
    signals = log()
    signals[name][at] = value
    return signals


@pytest.mark.parametrize(
    ("signals", "message"),
    [
        (log() | {"velocity": np.zeros((60, 3))}, r"`velocity` has shape \(60, 3\), `position_err"),
        (log() | {"effort": np.zeros((59, 2))}, r"`effort` has shape \(59, 2\)"),
        (log() | {"effort": np.zeros(60)}, r"`effort` has shape \(60,\).*signal\[:, None\]"),
        (log(n_joints=0), r"`position_error` has shape \(60, 0\)"),
        (changed("effort", (7, 1), np.nan), r"`effort`\[7, 1\] is nan"),
        (changed("velocity", (0, 0), -np.inf), r"`velocity`\[0, 0\] is -inf"),
        (log(n_times=23), "each needs at least 12: give a longer log"),
        (log(n_times=0), "the signals have 0 rows"),
    ],
)
def test_wrong_signals(signals, message):
    with pytest.raises(ValueError, match=message):
        rows_of(signals)


def test_shortest():
    assert len(rows_of(log(n_times=24)).training[0]) == 2 * 10


@pytest.mark.parametrize("fraction", [0.0, 1.0, -0.1, np.nan])
def test_wrong_fraction(fraction):
    with pytest.raises(ValueError, match=r"`validation_fraction` is .* between 0 and 1"):
        rows_of(log(), fraction=fraction)
