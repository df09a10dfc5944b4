from __future__ import annotations

import numpy as np
import pytest

from tests.gap.ingest.writers import RATE
from walkerkit.gap import Recording
from walkerkit.gap.rehearsal.rehearse import rehearse
from walkerkit.walkers.leg import LEG_XML


@pytest.fixture(scope="session")
def log() -> Recording:
    """One log of our leg whose numbers are in nanoseconds and in float32, as in all formats."""
    (chirp, *_) = rehearse(LEG_XML, ["none"], seed=3, seconds=1.0).recordings
    return Recording(
        name="chirp",
        time=np.rint(chirp.time * RATE) / RATE,
        columns={n: v.astype(np.float32).astype(float) for n, v in chirp.columns.items()},
    )
