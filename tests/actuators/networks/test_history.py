"""Input rows against queues in plain Python, one for each joint of each simulation."""

from collections import deque

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from walkerkit.actuators.networks import History


class Queues:
    """The same rows, for one joint, without arrays."""

    def __init__(self, length, pos_scale, vel_scale, order):
        self.length, self.scales, self.order = length, (pos_scale, vel_scale), order
        self.queues = None

    def reset(self):
        self.queues = None

    def push(self, *sample):
        if self.queues is None:
            self.queues = [deque([value] * self.length, maxlen=self.length) for value in sample]
        else:
            for queue, value in zip(self.queues, sample, strict=True):
                queue.appendleft(value)
        blocks = [
            [scale * value for value in queue]
            for queue, scale in zip(self.queues, self.scales, strict=True)
        ]
        errors, velocities = blocks
        return errors + velocities if self.order == "pos_vel" else velocities + errors


@given(
    length=st.integers(1, 5),
    order=st.sampled_from(["pos_vel", "vel_pos"]),
    sims=st.integers(0, 4),
    joints=st.integers(1, 4),
    steps=st.integers(1, 12),
    seed=st.integers(0, 1000),
)
def test_is_the_scalar_reference(length, order, sims, joints, steps, seed):
    """With resets of some simulations along the way; sims=0 is one without that axis."""
    rng = np.random.default_rng(seed)
    shape = (sims, joints) if sims else (joints,)
    scales = rng.uniform(0.1, 3.0, (2, joints))
    history = History(
        shape,
        history_length=length,
        pos_scale=scales[0],
        vel_scale=scales[1],
        input_order=order,
    )
    queues = [
        [Queues(length, *scales[:, joint], order) for joint in range(joints)]
        for _ in range(max(sims, 1))
    ]
    for _ in range(steps):
        if sims and rng.random() < 0.3:
            chosen = np.flatnonzero(rng.random(sims) < 0.5)
            history.reset(chosen)
            for sim in chosen:
                for queue in queues[sim]:
                    queue.reset()
        error, velocity = rng.normal(size=(2, *shape))
        features = history.push(error, velocity).reshape(-1, joints, 2 * length)
        for sim, joint in np.ndindex(features.shape[:2]):
            expected = queues[sim][joint].push(
                error.reshape(-1, joints)[sim, joint], velocity.reshape(-1, joints)[sim, joint]
            )
            assert features[sim, joint].tolist() == expected


def test_order_and_backfill():
    history = History((1,), history_length=3, pos_scale=2.0, vel_scale=10.0)
    assert history.push(np.array([1.0]), np.array([0.1])).tolist() == [[2, 2, 2, 1, 1, 1]]
    assert history.push(np.array([3.0]), np.array([0.2])).tolist() == [[6, 2, 2, 2, 1, 1]]
    history = History((1,), history_length=2, input_order="vel_pos")
    history.push(np.array([1.0]), np.array([5.0]))
    assert history.push(np.array([2.0]), np.array([6.0])).tolist() == [[6, 5, 2, 1]]


class TestReset:
    def push(self, history, value):
        shape = history.shape
        return history.push(np.full(shape, value), np.full(shape, -value)).copy()

    def test_twice_is_once(self):
        history = History((3, 2), history_length=3)
        self.push(history, 1.0)
        history.reset()
        history.reset()
        first = self.push(history, 4.0)
        assert (first[..., :3] == 4.0).all()
        assert (first[..., 3:] == -4.0).all()

    @pytest.mark.parametrize("rows", [[1], np.array([1]), (1,), np.array([False, True, False])])
    def test_some_leave_the_others_alone(self, rows):
        history, untouched = (History((3, 2), history_length=3) for _ in range(2))
        for value in (1.0, 2.0):
            self.push(history, value)
            self.push(untouched, value)
        history.reset(rows)
        for value in (3.0, 5.0):
            found, expected = self.push(history, value), self.push(untouched, value)
            np.testing.assert_array_equal(found[[0, 2]], expected[[0, 2]])
        assert found[1, 0].tolist() == [5, 3, 3, -5, -3, -3]

    def test_none_of_them(self):
        history = History((2, 1), history_length=2)
        self.push(history, 1.0)
        history.reset([])
        assert self.push(history, 2.0)[0].tolist() == [[2, 1, -2, -1]]

    @pytest.mark.parametrize(
        ("rows", "message"),
        [
            ([3], "names simulation 3, there are 3: use 0 to 2"),
            ([-1], "names simulation -1"),
            ([0.5], "expected the numbers of simulations"),
            ([[0]], "expected the numbers of simulations"),
            ([True, False], r"`rows` has shape \(2,\), expected \(3,\)"),
        ],
    )
    def test_wrong_rows(self, rows, message):
        with pytest.raises(ValueError, match=message):
            History((3, 2), history_length=1).reset(rows)

    def test_rows_without_simulations(self):
        with pytest.raises(ValueError, match="no axis of simulations"):
            History((3,), history_length=1).reset([0])


def test_features_cannot_be_changed():
    history = History((2,), history_length=2)
    features = history.push(np.ones(2), np.ones(2))
    with pytest.raises(ValueError, match="read-only"):
        features[0] = 7.0


@pytest.mark.parametrize("name", ["error", "velocity"])
@pytest.mark.parametrize("shape", [(), (1,), (2,), (1, 2), (3, 1)])
def test_wrong_shape(name, shape):
    """Also of what would broadcast."""
    arrays = {"error": np.zeros((3, 2)), "velocity": np.zeros((3, 2)), name: np.zeros(shape)}
    with pytest.raises(ValueError, match=rf"`{name}` has shape .* expected \(3, 2\)"):
        History((3, 2), history_length=2).push(**arrays)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"history_length": 0}, "`history_length` is 0"),
        ({"history_length": 2.0}, r"`history_length` is 2\.0"),
        ({"history_length": True}, "`history_length` is True"),
        ({"input_order": "velocity"}, "`input_order` is 'velocity': use 'pos_vel' or 'vel_pos'"),
        ({"pos_scale": np.nan}, "`pos_scale` is nan"),
        ({"vel_scale": [1.0, 2.0]}, r"`vel_scale` has shape \(2,\), expected one number or \(3,\)"),
        ({"shape": ()}, r"`shape` is \(\)"),
    ],
)
def test_wrong_argument(change, message):
    arguments = {"shape": (3,), "history_length": 2} | change
    with pytest.raises(ValueError, match=message):
        History(arguments.pop("shape"), **arguments)
