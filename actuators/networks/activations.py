"""Activation functions that work in place, by name.

    apply = activation("leaky_relu(0.2)")
    apply(x, scratch)  # x becomes max(x, 0) + 0.2 min(x, 0)

Each is what PyTorch computes under the same name, to rounding, and none overflows on its way to a
finite result. Two have a number: `elu(alpha)` and `leaky_relu(slope)`; without it they are those
of alpha 1 and slope 0.01, as in PyTorch. `gelu` is the exact one, `gelu_tanh` its approximation.
"""

from __future__ import annotations

import difflib
import math
import re
from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

FloatArray = NDArray[np.float64]
Activation = Callable[[FloatArray, FloatArray], None]

# Arrays, since a ufunc takes 0.2 µs longer to convert a Python number.
_ZERO, _HALF, _ONE = (np.array(number) for number in (0.0, 0.5, 1.0))
_ROOT_HALF, _ROOT_TWO_OVER_PI = (np.array(number) for number in (0.5**0.5, (2 / math.pi) ** 0.5))
_CUBIC, _FAR = np.array(0.044715), np.array(30.0)
NUMBERS: Mapping[str, float] = MappingProxyType({"elu": 1.0, "leaky_relu": 0.01})
"""Those that have a number, with what it is where none is given."""
_CALL = re.compile(r"(?P<name>\w+)\((?P<number>[^()]*)\)")


def check_activation(where: str, name: object) -> None:
    """Refuses a name that `ACTIVATIONS` does not have.

    Raises:
        ValueError: The name is unknown; it is told with the closest one.
    """
    if isinstance(name, str) and _parsed(name) is not None:
        return
    raise _unknown(where, name)


def _unknown(where: str, name: object) -> ValueError:
    closest = difflib.get_close_matches(str(name).lower(), ACTIVATIONS, n=1, cutoff=0.5)
    return ValueError(
        f"{where} is {name!r}: "
        + (f"did you mean {closest[0]!r}? " if closest else "")
        + f"Use one of {', '.join(ACTIVATIONS)}; elu(0.5) and leaky_relu(0.2) have a number"
    )


def activation(name: str) -> Activation:
    """The function of a name, with its number where it has one.

    Raises:
        ValueError: The name is unknown; it is told with the closest one.
    """
    plain, number = _understood(name)
    return ACTIVATIONS[plain] if number is None else _WITH_NUMBER[plain](number)


def named(plain: str, number: float) -> str:
    """The name of an activation with its number, as files have it.

    Args:
        plain: one of `NUMBERS`.
        number: its number.
    """
    return plain if number == NUMBERS[plain] else f"{plain}({number!r})"


def split(name: str) -> tuple[str, float | None]:
    """An activation's plain name and its number; None for one that has none.

    Raises:
        ValueError: The name is unknown; it is told with the closest one.
    """
    plain, number = _understood(name)
    return plain, NUMBERS.get(plain) if number is None else number


def _understood(name: str) -> tuple[str, float | None]:
    found = _parsed(name)
    if found is None:
        raise _unknown("the activation", name)
    return found


def _parsed(name: str) -> tuple[str, float | None] | None:
    if name in ACTIVATIONS:
        return name, None
    found = _CALL.fullmatch(name)
    if found is None or found["name"] not in NUMBERS:
        return None
    try:
        number = float(found["number"])
    except ValueError:
        return None
    return (found["name"], number) if math.isfinite(number) else None


def _elu_of(alpha: float) -> Activation:
    factor = np.array(alpha)

    def apply(x: FloatArray, scratch: FloatArray) -> None:
        _negative_part(x, scratch)
        np.multiply(scratch, factor, out=scratch)
        np.add(x, scratch, out=x)

    return apply


def _leaky_relu_of(slope: float) -> Activation:
    factor = np.array(slope)

    def apply(x: FloatArray, scratch: FloatArray) -> None:
        np.minimum(x, _ZERO, out=scratch)
        np.multiply(scratch, factor, out=scratch)
        np.maximum(x, _ZERO, out=x)
        np.add(x, scratch, out=x)

    return apply


def _negative_part(x: FloatArray, scratch: FloatArray) -> None:
    """Leaves max(x, 0) in x and expm1(min(x, 0)) in the scratch."""
    np.minimum(x, _ZERO, out=scratch)
    np.expm1(scratch, out=scratch)
    np.maximum(x, _ZERO, out=x)


def _elu(x: FloatArray, scratch: FloatArray) -> None:
    _negative_part(x, scratch)
    np.add(x, scratch, out=x)


def _silu(x: FloatArray, scratch: FloatArray) -> None:
    # σ(x) with an exponential that does not overflow.
    np.absolute(x, out=scratch)
    np.negative(scratch, out=scratch)
    np.exp(scratch, out=scratch)
    share = np.where(x >= 0, _ONE, scratch)
    np.add(scratch, _ONE, out=scratch)
    np.divide(share, scratch, out=share)
    np.multiply(x, share, out=x)


def _gelu(x: FloatArray, scratch: FloatArray) -> None:
    np.multiply(x, _ROOT_HALF, out=scratch)
    erf(scratch, out=scratch)
    np.add(scratch, _ONE, out=scratch)
    np.multiply(scratch, _HALF, out=scratch)
    np.multiply(x, scratch, out=x)


def _gelu_tanh(x: FloatArray, scratch: FloatArray) -> None:
    # Beyond ±30 it is x or 0, and its cube would overflow.
    np.clip(x, -_FAR, _FAR, out=scratch)
    cube = scratch**3
    np.multiply(cube, _CUBIC, out=cube)
    np.add(scratch, cube, out=scratch)
    np.multiply(scratch, _ROOT_TWO_OVER_PI, out=scratch)
    np.tanh(scratch, out=scratch)
    np.add(scratch, _ONE, out=scratch)
    np.multiply(scratch, _HALF, out=scratch)
    np.multiply(x, scratch, out=x)


def _relu(x: FloatArray, _: FloatArray) -> None:
    np.maximum(x, _ZERO, out=x)


def _tanh(x: FloatArray, _: FloatArray) -> None:
    np.tanh(x, out=x)


def _softsign(x: FloatArray, scratch: FloatArray) -> None:
    np.absolute(x, out=scratch)
    np.add(scratch, _ONE, out=scratch)
    np.divide(x, scratch, out=x)


def _sigmoid(x: FloatArray, _: FloatArray) -> None:
    # 1 / (1 + exp(-x)) without the overflow of its exponential.
    np.multiply(x, _HALF, out=x)
    np.tanh(x, out=x)
    np.multiply(x, _HALF, out=x)
    np.add(x, _HALF, out=x)


def _identity(_: FloatArray, __: FloatArray) -> None:
    pass


ACTIVATIONS: Mapping[str, Activation] = MappingProxyType(
    {
        "elu": _elu,
        "relu": _relu,
        "tanh": _tanh,
        "softsign": _softsign,
        "sigmoid": _sigmoid,
        "leaky_relu": _leaky_relu_of(NUMBERS["leaky_relu"]),
        "silu": _silu,
        "gelu": _gelu,
        "gelu_tanh": _gelu_tanh,
        "identity": _identity,
    }
)
_WITH_NUMBER: Mapping[str, Callable[[float], Activation]] = MappingProxyType(
    {"elu": _elu_of, "leaky_relu": _leaky_relu_of}
)
