from __future__ import annotations

import numpy as np
import pytest

from walkerkit.gap.simulation.interpolate import delayed

PAST, STEPS = 3, 5


@pytest.mark.parametrize("ages", [(0.0, 0.0), (1.0, 1.0), (0.25, 2.5), (1e-20, 1e-20), (9.0, 3.0)])
def test_commands_are_those_between_the_steps_of_long_ago(ages: tuple[float, float]) -> None:
    """Of values that end where the last command without a delay does."""
    values = np.random.default_rng(0).normal(size=(2, PAST + STEPS, 1))
    late = delayed(values, PAST, STEPS, np.array(ages).reshape(1, 2, 1))
    at = np.arange(PAST + STEPS)
    for some, age in enumerate(ages):
        # No command is known that was sent before the first.
        wanted = np.arange(PAST, PAST + STEPS) - min(age, PAST)
        expected = np.interp(wanted, at, values[some, :, 0])
        np.testing.assert_allclose(late[0, some, :, 0], expected, rtol=1e-12, atol=1e-12)
