"""Draws decision.svg: how blocks decide between two structures of the worked example.

    python docs/_decision.py $WALKERKIT_DATA/go2_leg

Of the front left leg of a real Go2: the best, and the best whose dry friction goes with the pose.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))
from _plot import Panel, drawing

from walkerkit import gap
from walkerkit.gap.search.compare import Table
from walkerkit.gap.search.decision import TEMPERATURE
from walkerkit.gap.search.objective import BLOCK

WITH = "pose_dependent_friction"
CHANNEL = "FL_hip"


def picture(table: Table, channel: int) -> str:
    """The blocks of the best structure and of the best with one effect more, as an SVG file.

    Args:
        table: the comparison.
        channel: index of the scored channel whose residual is drawn.
    """
    best = table.members.index(table.best)
    has = [WITH in member.effects for member in table.members]
    other = int(np.argmax(np.where(has, table.worth, -np.inf)))
    residuals = []
    for k in (best, other):
        scores = table.members[k].scores
        count = np.maximum(scores.count[:, channel], 1)
        residuals.append(1e3 * np.sqrt(scores.squares[:, channel] / count))
    densities = table.blocks[best], table.blocks[other]
    time = BLOCK * np.arange(len(densities[0]))
    adds_up = np.cumsum(densities[1] - densities[0])
    panels = [
        ("residual, rms [mrad]", list(zip(("before", "after"), residuals, strict=True))),
        ("density of a block", list(zip(("before", "after"), densities, strict=True))),
        (f"adds up, / T = {TEMPERATURE:g}", [("difference", adds_up / TEMPERATURE)]),
    ]
    return drawing(
        f"{CHANNEL} of a Go2, blocks that no fit saw",
        [[Panel(label=label, x=time, lines=lines) for label, lines in panels]],
        words={
            "before": "best",
            "after": "with pose-dependent friction",
            "difference": "with − best",
        },
    )


def main(folder: Path) -> None:
    """Diagnoses the leg and writes the picture beside this file."""
    (model,) = folder.glob("*.xml")
    result = gap.diagnose(model, sorted(folder.glob("*.csv")), held_out=["leg_part3"])
    channels = [(one.joint, one.signal) for one in result.problem.channels]
    channel = next(
        k for k, one in enumerate(channels) if CHANNEL in one[0] and one[1] == "position"
    )
    drawn = picture(result.table, channel)
    Path(__file__).with_name("decision.svg").write_text(drawn, encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
