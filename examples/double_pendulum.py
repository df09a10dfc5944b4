"""Two quasi-direct drives, torque commanded: friction that the makers' model lacks.

    python examples/double_pendulum.py [OUT]

Ten recordings of a double pendulum with AK80-6 motors (DFKI, BSD-3); two of them are held out.
The joints are driven by effort, so the replays restart from the measured state every 0.5 s.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from _arguments import argument
from _data import folder

from walkerkit import gap

HELD_OUT = ("20230629-144003.csv", "20230629-144115.csv")


def main(out: Path, effects: Sequence[str] | None = None) -> gap.Result:
    """Diagnoses the recordings, with the whole catalogue or some effects, and writes the result."""
    data = folder("double_pendulum")
    result = gap.diagnose(
        data / "double_pendulum.xml",
        sorted(data.glob("*.csv")),
        held_out=[data / name for name in HELD_OUT],
        effects=effects,
    )
    result.save(out)
    return result


if __name__ == "__main__":
    print(main(argument(__doc__, "OUT", Path("double_pendulum-diagnosis"))))
