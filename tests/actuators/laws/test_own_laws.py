"""What a law of a user's own does wrong is said when it is bound, by name."""

from __future__ import annotations

import numpy as np
import pytest

from walkerkit.actuators import Law


class Spring(Law):
    """A law that does as a test says."""

    def __init__(self, made):
        super().__init__({"stiffness": np.full(2, 3.0)})
        self.made = made
        self.resets = 0

    def effort(self, position, velocity, effort, q, qd):
        asked = self.get("stiffness") * (position - q)
        return self.made(asked, q)

    def reset(self, rows):
        self.resets += 1


def raising(asked, q):
    raise RuntimeError("the sensor is lost")


def writing(asked, q):
    q += 1.0
    return asked, asked


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (raising, "raised RuntimeError: the sensor is lost"),
        (writing, "raised ValueError: .*read-only"),
        (lambda asked, q: None, "returned None; it should return two new arrays of floats"),
        (lambda asked, q: asked, r"returned an array of shape \(2,\)"),
        (lambda asked, q: (asked, asked, q), "returned a tuple of 3"),
        (lambda asked, q: (asked[:1], asked[:1]), r"returned an array of shape \(1,\) and float64"),
        (lambda asked, q: (asked, [0.0, 0.0]), "returned a list of 2 in it"),
        (lambda asked, q: (asked > 0, asked > 0), "returned an array .* and bool in it; it should"),
        (lambda asked, q: (asked / 0 * 0, asked), "returned .*nan.* for targets.* of zero"),
    ],
)
@pytest.mark.filterwarnings("ignore:invalid value")
def test_a_law_that_does_not_say_efforts_is_refused(made, message):
    with pytest.raises(ValueError, match=rf"test_own_laws\.Spring\.effort {message}"):
        Spring(made).allocate((2,))


@pytest.mark.parametrize("shape", [(2,), (5, 2)])
def test_a_law_starts_without_a_past(shape):
    law = Spring(lambda asked, q: (asked, asked.astype(np.float32)))
    law.allocate(shape)
    assert law.resets == 2
