"""A motor with ball screw and carriage in a closed position loop: judged on effort.

    python examples/emps.py [OUT]

The electro-mechanical positioning system of Janot, Gautier and Brunot (2019): fitted on one
recording, held out on another in which known force pulses were added. The loop hides the error of
the position; the effort shows it.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from _data import folder

from walkerkit import gap


def main(out: Path, effects: Sequence[str] | None = None) -> gap.Result:
    """Diagnoses the recordings, with the whole catalogue or some effects, and writes the result."""
    data = folder("emps")
    result = gap.diagnose(
        data / "emps.xml",
        [data / "identification.csv", data / "pulses.csv"],
        held_out=[data / "pulses.csv"],
        effects=effects,
    )
    result.save(out)
    return result


def relative_effort_error(result: gap.Result) -> tuple[float, float]:
    """RMS effort error over RMS effort of the held-out recording, before and after."""
    measured = next(
        trace.measured
        for trace in result.diagnosis.traces
        if trace.held_out and trace.signal == "effort"
    )
    size = float(np.sqrt(np.mean(measured**2)))
    effort = result.diagnosis.gap.signals["effort"]
    return effort.before / size, effort.after / size


if __name__ == "__main__":
    found = main(Path(sys.argv[1] if len(sys.argv) > 1 else "emps-diagnosis"))
    print(found)
    before, after = relative_effort_error(found)
    print(f"relative effort error on pulses.csv: {before:.1%} before, {after:.1%} after")
