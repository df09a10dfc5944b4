"""Activations against their formulas in plain Python."""

import math

import numpy as np
import pytest

from walkerkit.actuators.networks.activations import ACTIVATIONS, check_activation

FORMULAS = {
    "elu": lambda x: x if x > 0 else math.expm1(x),
    "relu": lambda x: max(x, 0.0),
    "tanh": math.tanh,
    "softsign": lambda x: x / (1 + abs(x)),
    "sigmoid": lambda x: 1 / (1 + math.exp(-x)) if x > 0 else math.exp(x) / (1 + math.exp(x)),
    "identity": lambda x: x,
}


def test_every_activation_has_a_formula_here():
    assert FORMULAS.keys() == ACTIVATIONS.keys()


@pytest.mark.parametrize("name", FORMULAS)
def test_formula_in_place_and_without_overflow(name):
    x = np.concatenate([np.linspace(-30, 30, 601), [-1e300, -800.0, -1e-300, 1e-300, 800.0, 1e300]])
    y = x.reshape(-1, 1).copy()
    ACTIVATIONS[name](y, np.full_like(y, np.nan))
    expected = [FORMULAS[name](value) for value in x]
    np.testing.assert_allclose(y[:, 0], expected, rtol=1e-14, atol=2e-16)


@pytest.mark.parametrize("name", ["Elu", "ELU", "rleu", "gelu", None, 3, ["elu"]])
def test_unknown(name):
    with pytest.raises(ValueError, match="elu, relu, tanh, softsign, sigmoid, identity") as caught:
        check_activation("layer 1", name)
    assert repr(name) in str(caught.value)
    assert str(caught.value).startswith("layer 1 is ")


def test_closest_is_named():
    with pytest.raises(ValueError, match="did you mean 'softsign'"):
        check_activation("x", "SoftSign")
