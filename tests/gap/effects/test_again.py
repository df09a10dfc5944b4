"""Effects on a robot that has them already: of a mended model, diagnosed again."""

from dataclasses import replace

import numpy as np
import pytest

from tests.gap.effects.contract import replayed
from walkerkit.gap.effects import CATALOGUE
from walkerkit.gap.search.structure import Structure, Term
from walkerkit.gap.simulation.mend import mend
from walkerkit.gap.simulation.trials import Trials

HAVE = (
    "quadratic_drag",
    "asymmetric_friction",
    "stribeck_friction",
    "presliding_friction",
    "load_dependent_friction",
    "directional_efficiency",
    "pose_dependent_friction",
    "cogging",
    "torque_ripple",
)


@pytest.mark.parametrize("name", HAVE)
def test_what_a_robot_has_stays_at_zero_and_moves_from_there(name, awkward):
    robot, recording = awkward
    term = Term(effect=CATALOGUE[name], sites=("hip",))
    structure = Structure((term,), (robot,))
    start = np.array([slot.parameter.starts[-1] for slot in structure.slots])
    mended = replace(mend(structure.trials(robot, start[None])), excursions=robot.excursions)
    again = Structure((term,), (mended,))
    lower, upper = again.bounds
    values = np.stack([again.zero, again.zero])
    more = np.array([slot.parameter.starts[0] for slot in again.slots])
    values[1] = np.where(more != again.zero, more, again.zero)
    assert (lower <= values).all()
    assert (values <= upper).all()
    expected = replayed(mended, recording, Trials(mended, 1))[0]
    same, other = replayed(mended, recording, again.trials(mended, values))
    np.testing.assert_array_equal(same, expected)
    assert np.abs(other - expected).max() > 1e-6
