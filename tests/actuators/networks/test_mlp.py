"""Multilayer perceptrons against nested loops in plain Python."""

import dataclasses
import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from walkerkit.actuators.networks import Mlp

NAMES = ("elu", "relu", "tanh", "softsign", "sigmoid", "identity")


def network(sizes, activations, seed=0):
    rng = np.random.default_rng(seed)
    return Mlp(
        weights=[rng.normal(size=(b, a)) for a, b in pairwise(sizes)],
        biases=[rng.normal(size=b) for b in sizes[1:]],
        activations=activations,
    )


def scalar_activation(name, x):
    if name == "elu":
        return x if x > 0 else math.exp(x) - 1
    if name == "relu":
        return x if x > 0 else 0.0
    if name == "tanh":
        return math.tanh(x)
    if name == "softsign":
        return x / (1 + abs(x))
    if name == "sigmoid":
        return 1 / (1 + math.exp(-x))
    return x


def scalar_forward(mlp, row):
    values = [float(v) for v in row]
    for weight, bias, name in zip(mlp.weights, mlp.biases, mlp.activations, strict=True):
        values = [
            scalar_activation(
                name, float(bias[i]) + sum(float(w) * v for w, v in zip(line, values, strict=True))
            )
            for i, line in enumerate(weight)
        ]
    return values


networks = st.integers(1, 4).flatmap(
    lambda n_layers: st.builds(
        network,
        st.lists(st.integers(1, 9), min_size=n_layers + 1, max_size=n_layers + 1),
        st.lists(st.sampled_from(NAMES), min_size=n_layers, max_size=n_layers),
        st.integers(0, 1000),
    )
)


class TestForward:
    @given(networks, st.integers(1, 15), st.integers(0, 1000))
    def test_is_the_scalar_reference(self, mlp, rows, seed):
        x = np.random.default_rng(seed).normal(size=(rows, mlp.n_inputs))
        expected = [scalar_forward(mlp, row) for row in x]
        np.testing.assert_allclose(mlp(x), expected, rtol=1e-9, atol=1e-9)

    @given(networks, st.integers(1, 5), st.integers(1, 15), st.integers(0, 1000))
    def test_batch_is_each_simulation_bit_for_bit(self, mlp, sims, joints, seed):
        x = np.random.default_rng(seed).normal(size=(sims, joints, mlp.n_inputs))
        y = mlp(x)
        assert y.shape == (sims, joints, mlp.n_outputs)
        for sim in range(sims):
            np.testing.assert_array_equal(y[sim], mlp(x[sim]))

    @given(networks, st.integers(1, 15), st.integers(0, 1000))
    def test_rows_are_independent(self, mlp, rows, seed):
        rng = np.random.default_rng(seed)
        x = rng.normal(size=(rows, mlp.n_inputs))
        y, row = mlp(x), rng.integers(rows)
        np.testing.assert_allclose(mlp(x[row]), y[row], rtol=1e-11, atol=1e-11)
        x[np.arange(rows) != row] = 0.3
        np.testing.assert_array_equal(mlp(x)[row], y[row])

    def test_leaves_no_trace_between_calls(self):
        mlp = network((3, 8, 2), ("elu", "sigmoid"))
        forward = mlp.forward((5,))
        x = np.random.default_rng(0).normal(size=(2, 5, 3))
        first = forward(x[0]).copy()
        forward(x[1])
        np.testing.assert_array_equal(forward(x[0]), first)
        np.testing.assert_array_equal(first, mlp(x[0]))

    def test_leaves_the_input_alone(self):
        x = np.random.default_rng(0).normal(size=(4, 3))
        kept = x.copy()
        network((3, 2), ("tanh",))(x)
        np.testing.assert_array_equal(x, kept)

    def test_layout_of_the_input_does_not_matter(self):
        mlp = network((3, 8, 2), ("tanh", "identity"))
        x = np.random.default_rng(0).normal(size=(6, 5, 3))
        y = mlp(x)
        np.testing.assert_array_equal(mlp(np.asfortranarray(x)), y)
        np.testing.assert_array_equal(mlp(x[::2]), y[::2])

    def test_call_gives_a_new_array(self):
        mlp = network((3, 1), ("identity",))
        y = mlp(np.zeros((2, 3)))
        kept = y.copy()
        mlp(np.ones((2, 3)))
        np.testing.assert_array_equal(y, kept)

    def test_one_row_no_row_and_float32(self):
        mlp = network((3, 4, 2), ("elu", "identity"))
        assert mlp(np.zeros(3)).shape == (2,)
        assert mlp(np.zeros((0, 3))).shape == (0, 2)
        single = np.random.default_rng(0).normal(size=(5, 3)).astype(np.float32)
        np.testing.assert_array_equal(mlp(single), mlp(single.astype(float)))

    @pytest.mark.parametrize("shape", [(5, 4), (4, 3), (3,), (1, 5, 3)])
    def test_wrong_shape(self, shape):
        forward = network((3, 2), ("tanh",)).forward((5,))
        with pytest.raises(ValueError, match=r"`x` has shape .*, expected \(5, 3\)") as caught:
            forward(np.zeros(shape))
        assert str(shape) in str(caught.value)

    def test_call_with_wrong_inputs(self):
        with pytest.raises(ValueError, match=r"shape \(5, 4\), expected \(5, 3\)"):
            network((3, 2), ("tanh",))(np.zeros((5, 4)))


class TestArrays:
    def test_are_read_only_copies(self):
        weight, bias = np.ones((1, 2)), np.zeros(1)
        mlp = Mlp(weights=[weight], biases=[bias], activations=["relu"])
        weight[:] = 7.0
        assert mlp.weights[0].tolist() == [[1.0, 1.0]]
        for array in (*mlp.weights, *mlp.biases):
            with pytest.raises(ValueError, match="read-only"):
                array[...] = 0.0
        with pytest.raises(dataclasses.FrozenInstanceError):
            mlp.weights = ()

    @pytest.mark.parametrize(
        ("change", "message"),
        [
            ({"weights": [np.ones((4, 3)), np.ones((1, 5))]}, r"`weight_1` has shape \(1, 5\)"),
            ({"weights": [np.ones(3), np.ones((1, 4))]}, r"`weight_0` has shape \(3,\)"),
            ({"weights": [np.ones((4, 0)), np.ones((1, 4))]}, r"`weight_0` has shape \(4, 0\)"),
            ({"biases": [np.ones(4), np.ones(2)]}, r"`bias_1` has shape \(2,\), expected \(1\)"),
            ({"biases": [np.ones((4, 1)), np.ones(1)]}, r"`bias_0` has shape \(4, 1\)"),
            ({"biases": [np.ones(4)]}, "2, 1 and 2"),
            ({"weights": [], "biases": [], "activations": []}, "0, 0 and 0"),
            ({"activations": ["elu"]}, "2, 2 and 1"),
            ({"activations": ["elu", "lineal"]}, r"`activations`\[1\] is 'lineal'"),
            ({"activations": "elu"}, r"use \('elu',\)"),
            ({"biases": [np.array([0, 0, np.nan, 0]), np.ones(1)]}, r"`bias_0`\[2\] is nan"),
            ({"weights": [np.ones((4, 3)), np.full((1, 4), np.inf)]}, r"`weight_1`\[0, 0\] is inf"),
            ({"biases": [np.array(["a"] * 4), np.ones(1)]}, "`bias_0` has dtype <U1"),
        ],
    )
    def test_wrong(self, change, message):
        good = {
            "weights": [np.ones((4, 3)), np.ones((1, 4))],
            "biases": [np.ones(4), np.ones(1)],
            "activations": ["elu", "identity"],
        }
        assert Mlp(**good).n_outputs == 1
        with pytest.raises(ValueError, match=message):
            Mlp(**good | change)


class TestSaved:
    @given(networks)
    def test_comes_back_the_same(self, tmp_path_factory, mlp):
        path = tmp_path_factory.mktemp("saved") / "net.npz"
        mlp.save(path)
        again = Mlp.load(path)
        assert again.activations == mlp.activations
        for before, after in zip(
            (*mlp.weights, *mlp.biases), (*again.weights, *again.biases), strict=True
        ):
            assert after.dtype == np.float64
            assert not after.flags.writeable
            np.testing.assert_array_equal(before, after)
        bytes_before = path.read_bytes()
        again.save(path)
        assert path.read_bytes() == bytes_before

    def test_arrays_of_the_documented_format(self, tmp_path):
        path = tmp_path / "net.npz"
        np.savez(
            path,
            format="walkerkit.mlp",
            version=1,
            activations=["relu", "identity"],
            weight_0=np.array([[1.0, -1.0], [2.0, 0.5]], dtype=np.float32),
            bias_0=[0.0, -1.0],
            weight_1=[[10.0, 1.0]],
            bias_1=[0.25],
        )
        mlp = Mlp.load(str(path))
        assert mlp([3.0, 1.0]).tolist() == [10 * 2.0 + 5.5 + 0.25]
        assert mlp([1.0, 3.0]).tolist() == [0.0 + 2.5 + 0.25]
