"""The leg of `machine`, in its plain and in its awkward form, each with a log of itself."""

import pytest

from tests.gap.effects.machine import AWKWARD, PLAIN, robot_of


@pytest.fixture(scope="session")
def plain():
    return robot_of(PLAIN)


@pytest.fixture(scope="session")
def awkward():
    return robot_of(AWKWARD)
