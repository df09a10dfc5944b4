"""Activations against their formulas in plain Python."""

import math

import numpy as np
import pytest

from walkerkit.actuators.networks.activations import (
    ACTIVATIONS,
    activation,
    check_activation,
    named,
    split,
)

FORMULAS = {
    "elu": lambda x: x if x > 0 else math.expm1(x),
    "relu": lambda x: max(x, 0.0),
    "tanh": math.tanh,
    "softsign": lambda x: x / (1 + abs(x)),
    "sigmoid": lambda x: 1 / (1 + math.exp(-x)) if x > 0 else math.exp(x) / (1 + math.exp(x)),
    "leaky_relu": lambda x: x if x > 0 else 0.01 * x,
    "silu": lambda x: x * FORMULAS["sigmoid"](x),
    "gelu": lambda x: 0.5 * x * (1 + math.erf(x / math.sqrt(2))),
    "gelu_tanh": lambda x: (
        0.5 * x * (1 + math.tanh(math.sqrt(2 / math.pi) * (x + 0.044715 * min(x, 1e3) ** 3)))
        if x > -1e3
        else 0.0
    ),
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
    # A small rest of tanh has few digits.
    atol = 1e-14 if name == "gelu_tanh" else 2e-16
    np.testing.assert_allclose(y[:, 0], expected, rtol=1e-14, atol=atol)


@pytest.mark.parametrize(
    ("name", "formula"),
    [
        ("elu(0.5)", lambda x: x if x > 0 else 0.5 * math.expm1(x)),
        ("elu(1.0)", FORMULAS["elu"]),
        ("leaky_relu(0.2)", lambda x: x if x > 0 else 0.2 * x),
        ("leaky_relu(-1)", abs),
    ],
)
def test_formula_with_a_number(name, formula):
    x = np.concatenate([np.linspace(-30, 30, 601), [-800.0, 800.0]])
    y = x.reshape(-1, 1).copy()
    activation(name)(y, np.full_like(y, np.nan))
    np.testing.assert_allclose(y[:, 0], [formula(v) for v in x], rtol=1e-14, atol=2e-16)


def test_names_with_numbers():
    assert named("elu", 1.0) == "elu"
    assert named("elu", 0.5) == "elu(0.5)"
    assert split("leaky_relu(0.2)") == ("leaky_relu", 0.2)
    assert split("leaky_relu") == ("leaky_relu", 0.01)
    assert split("tanh") == ("tanh", None)


UNKNOWN = ["Elu", "ELU", "rleu", "gleu", "tanh(1)", "elu(a)", "elu(nan)", None, 3, ["elu"]]


@pytest.mark.parametrize("name", UNKNOWN)
def test_unknown(name):
    with pytest.raises(ValueError, match="elu, relu, tanh, softsign, sigmoid") as caught:
        check_activation("layer 1", name)
    assert repr(name) in str(caught.value)
    assert str(caught.value).startswith("layer 1 is ")


def test_closest_is_named():
    with pytest.raises(ValueError, match="did you mean 'softsign'"):
        check_activation("x", "SoftSign")
