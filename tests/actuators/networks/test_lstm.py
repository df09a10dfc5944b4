"""LSTM networks against the equations in plain Python, cell by cell."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from walkerkit.actuators.networks import Lstm


def network(inputs=2, hidden=3, layers=2, outputs=1, seed=0):
    rng = np.random.default_rng(seed)
    sizes = [inputs, *[hidden] * (layers - 1)]
    return Lstm(
        weights_ih=[rng.normal(size=(4 * hidden, size)) for size in sizes],
        weights_hh=[rng.normal(size=(4 * hidden, hidden)) for _ in sizes],
        biases_ih=[rng.normal(size=4 * hidden) for _ in sizes],
        biases_hh=[rng.normal(size=4 * hidden) for _ in sizes],
        head_weight=rng.normal(size=(outputs, hidden)),
        head_bias=rng.normal(size=outputs),
    )


def sigmoid(x):
    return 1 / (1 + math.exp(-x))


def dot(line, values):
    return sum(float(a) * b for a, b in zip(line, values, strict=True))


def scalar_forward(lstm, rows):
    """Outputs of one sequence of rows, from rest."""
    n = lstm.n_hidden
    h = [[0.0] * n for _ in lstm.weights_ih]
    c = [[0.0] * n for _ in lstm.weights_ih]
    outputs = []
    for row in rows:
        x = [float(value) for value in row]
        for k in range(lstm.n_layers):
            gates = [
                dot(lstm.weights_ih[k][r], x)
                + dot(lstm.weights_hh[k][r], h[k])
                + float(lstm.biases_ih[k][r])
                + float(lstm.biases_hh[k][r])
                for r in range(4 * n)
            ]
            for cell in range(n):
                i, f, o = (sigmoid(gates[cell + gate * n]) for gate in (0, 1, 3))
                c[k][cell] = f * c[k][cell] + i * math.tanh(gates[cell + 2 * n])
                h[k][cell] = o * math.tanh(c[k][cell])
            x = list(h[k])
        outputs.append(
            [dot(w, x) + float(b) for w, b in zip(lstm.head_weight, lstm.head_bias, strict=True)]
        )
    return outputs


networks = st.builds(
    network, st.integers(1, 4), st.integers(1, 5), st.integers(1, 3), st.integers(1, 2),
    st.integers(0, 1000),
)  # fmt: skip


class TestForward:
    @given(networks, st.integers(1, 8), st.integers(1, 5))
    def test_is_the_scalar_reference(self, lstm, steps, rows):
        x = np.random.default_rng(steps).normal(size=(steps, rows, lstm.n_inputs))
        expected = np.stack([scalar_forward(lstm, x[:, row]) for row in range(rows)], axis=1)
        np.testing.assert_allclose(lstm(x), expected, rtol=1e-10, atol=1e-12)

    @given(networks, st.integers(1, 4), st.integers(1, 13))
    def test_batch_is_each_simulation_bit_for_bit(self, lstm, sims, joints):
        x = np.random.default_rng(sims).normal(size=(6, sims, joints, lstm.n_inputs))
        y = lstm(x)
        for sim in range(sims):
            np.testing.assert_array_equal(lstm(x[:, sim]), y[:, sim])

    def test_one_row(self):
        lstm = network()
        x = np.random.default_rng(0).normal(size=(5, 2))
        np.testing.assert_allclose(lstm(x), scalar_forward(lstm, x), rtol=1e-12)
        forward = lstm.forward(())
        assert forward(x[0]).shape == (1,)
        assert forward.hidden[0].shape == (3,)

    def test_saturated_without_overflow(self):
        lstm = network(seed=3)
        y = lstm(np.full((4, 2), 1e6))
        assert np.isfinite(y).all()

    @pytest.mark.parametrize("shape", [(5, 3), (4, 2), (2,), (1, 5, 2)])
    def test_wrong_shape(self, shape):
        with pytest.raises(ValueError, match=r"`x` has shape .*, expected \(5, 2\)"):
            network().forward((5,))(np.zeros(shape))

    def test_call_without_steps(self):
        with pytest.raises(ValueError, match="add an axis of steps"):
            network()(np.zeros(2))


class TestState:
    def test_is_seen_and_not_changed_from_outside(self):
        lstm = network()
        forward = lstm.forward((4,))
        x = np.random.default_rng(0).normal(size=(4, 2))
        y = forward(x).copy()
        assert [h.shape for h in forward.hidden] == [(4, 3), (4, 3)]
        np.testing.assert_allclose(
            forward.hidden[-1] @ lstm.head_weight.T + lstm.head_bias, y, rtol=1e-12
        )
        assert np.abs(forward.cell[0]).min() > 0
        for array in (*forward.hidden, *forward.cell):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0.0

    def test_reset_twice_is_a_new_start(self):
        lstm = network()
        x = np.random.default_rng(0).normal(size=(5, 4, 2))
        forward = lstm.forward((4,))
        first = np.array([forward(row).copy() for row in x])
        assert not np.array_equal(forward(x[0]), first[0])
        forward.reset()
        forward.reset()
        assert not any(array.any() for array in (*forward.hidden, *forward.cell))
        np.testing.assert_array_equal([forward(row).copy() for row in x], first)

    @pytest.mark.parametrize("rows", [[1], np.array([False, True, False])])
    def test_partial_reset_leaves_the_others_alone(self, rows):
        lstm = network()
        x = np.random.default_rng(0).normal(size=(6, 3, 4, 2))
        forward, untouched = lstm.forward((3, 4)), lstm.forward((3, 4))
        for row in x[:3]:
            forward(row)
            untouched(row)
        forward.reset(rows)
        for row in x[3:]:
            found, expected = forward(row).copy(), untouched(row).copy()
            np.testing.assert_array_equal(found[[0, 2]], expected[[0, 2]])
        np.testing.assert_array_equal(found[1], lstm(x[3:, 1])[-1])

    def test_wrong_rows(self):
        with pytest.raises(ValueError, match="names simulation 3"):
            network().forward((3, 4)).reset([3])
        with pytest.raises(ValueError, match="no axis of simulations"):
            network().forward((3,)).reset([0])


def arrays_of(lstm):
    arrays = {"format": np.array("walkerkit.lstm"), "version": np.array(1)}
    for k in range(lstm.n_layers):
        arrays |= {
            f"weight_ih_{k}": lstm.weights_ih[k],
            f"weight_hh_{k}": lstm.weights_hh[k],
            f"bias_ih_{k}": lstm.biases_ih[k],
            f"bias_hh_{k}": lstm.biases_hh[k],
        }
    return arrays | {"head_weight": lstm.head_weight, "head_bias": lstm.head_bias}


class TestSaved:
    @given(networks)
    def test_comes_back_the_same(self, tmp_path_factory, lstm):
        path = tmp_path_factory.mktemp("saved") / "net.npz"
        lstm.save(path)
        before, after = arrays_of(lstm), arrays_of(Lstm.load(path))
        assert before.keys() == after.keys()
        for name, array in before.items():
            np.testing.assert_array_equal(array, after[name])

    def test_documented_format(self, tmp_path):
        lstm = network()
        path = tmp_path / "net.npz"
        np.savez(path, **arrays_of(lstm))
        x = np.ones((4, 2))
        np.testing.assert_array_equal(Lstm.load(path)(x), lstm(x))

    @pytest.mark.parametrize("name", list(arrays_of(network())))
    def test_missing_array(self, tmp_path, name):
        path = tmp_path / "net.npz"
        np.savez(path, **{k: v for k, v in arrays_of(network()).items() if k != name})
        with pytest.raises(ValueError) as caught:
            Lstm.load(path)
        told = "no use for `weight_hh_1`" if name == "weight_ih_1" else f"`{name}` is missing"
        assert told in str(caught.value)
        assert str(caught.value).startswith(f"{path}: ")

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"weight_ih_0": np.ones((11, 2))}, "`weight_ih_0` has shape (11, 2), expected (12,"),
            ({"weight_ih_1": np.ones((12, 2))}, "`weight_ih_1` has shape (12, 2), expected (12, 3"),
            ({"weight_hh_0": np.ones((12, 4))}, "`weight_hh_0` has shape (12, 4), expected (12, 3"),
            ({"bias_hh_1": np.ones(3)}, "`bias_hh_1` has shape (3,), expected (12)"),
            ({"bias_ih_0": np.full(12, np.nan)}, "`bias_ih_0`[0] is nan"),
            ({"head_weight": np.ones((1, 4))}, "`weight_ih_0` has shape (12, 2), expected (16,"),
            ({"head_bias": np.ones(2)}, "`head_bias` has shape (2,), expected (1)"),
            ({"bias_ih_0": np.ones(12, dtype=int)}, "array `bias_ih_0` has dtype int64"),
            ({"weight_ih_3": np.ones((12, 3))}, "no use for `weight_ih_3`"),
            ({"format": np.array("walkerkit.mlp")}, "array `format` is 'walkerkit.mlp'"),
        ],
    )
    def test_wrong_array(self, tmp_path, change, message):
        path = tmp_path / "net.npz"
        np.savez(path, **arrays_of(network()) | change)
        with pytest.raises(ValueError) as caught:
            Lstm.load(path)
        assert message in str(caught.value)

    def test_truncated(self, tmp_path):
        path = tmp_path / "net.npz"
        network().save(path)
        path.write_bytes(path.read_bytes()[:-100])
        with pytest.raises(ValueError, match=r"should be a complete \.npz"):
            Lstm.load(path)


def test_arrays_are_read_only_copies():
    lstm = network()
    for array in (*lstm.weights_ih, *lstm.weights_hh, *lstm.biases_ih, lstm.head_weight):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0.0


def test_no_layer():
    with pytest.raises(ValueError, match="got \\[0, 0, 0, 0\\]"):
        Lstm(
            weights_ih=[],
            weights_hh=[],
            biases_ih=[],
            biases_hh=[],
            head_weight=np.ones((1, 1)),
            head_bias=np.ones(1),
        )
