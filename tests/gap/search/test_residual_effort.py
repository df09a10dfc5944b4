"""The effort that is missing, against the force that was applied."""

import numpy as np
import pytest

from tests.gap.stopgap import rig
from walkerkit import gap
from walkerkit.gap.search.residual_effort import residual_effort
from walkerkit.gap.stopgap.sparse import formula


def bump_and_slope(q, qd):
    return -0.15 * np.tanh(qd / 0.02) + 0.3 * q**2


@pytest.fixture
def arm(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(rig.ARM, encoding="utf-8")
    return path


def missing_of(arm, recordings):
    problem = gap.load(arm, recordings)
    return residual_effort(problem, problem.robots, (rig.JOINT,))


def test_is_the_force_that_the_model_lacks(arm):
    missing = missing_of(arm, rig.logs(beside=bump_and_slope))
    known = np.isfinite(missing.residual[:, 0])
    assert known.mean() > 0.5
    true = bump_and_slope(missing.q, missing.qd)[known]
    error = missing.residual[known] - true
    assert np.median(np.abs(error)) < 0.012
    assert np.sqrt(np.mean(error**2)) < 0.2 * np.sqrt(np.mean(true**2))
    assert missing.held_out.any()
    assert not missing.held_out.all()
    found = formula(missing, 0)
    assert found is not None
    assert found.after < 0.35 * found.before


def test_nothing_is_missing_from_the_model_itself(arm):
    missing = missing_of(arm, rig.logs())
    assert np.nanmedian(np.abs(missing.residual)) < 0.012
    assert formula(missing, 0) is None


def test_joints_that_no_recording_has(arm):
    problem = gap.load(arm, rig.logs(seconds=1.0))
    assert residual_effort(problem, problem.robots, ("elbow",)) is None
