"""Draws docs/gap.svg: the gap of the demonstration, shrinking.

    python examples/picture.py [SEED]

Needs matplotlib, which `make` installs for developers.
"""

from __future__ import annotations

import os
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "disable")

import matplotlib as mpl
import numpy as np
from _arguments import argument
from matplotlib import pyplot as plt

from walkerkit.gap.rehearsal.demo import run

PICTURE = Path(__file__).resolve().parent.parent / "docs" / "gap.svg"
BLUE, ORANGE, GREY = "#0072B2", "#D55E00", "#555555"  # Okabe and Ito
SHOWN = (2.0, 5.0)  # s


def main(seed: int) -> None:
    """Runs the demonstration and draws it."""
    result, rehearsal = run(seed=seed)
    diagnosis = result.diagnosis
    worst = max(diagnosis.gap.joints, key=lambda joint: diagnosis.gap.joints[joint].before)
    trace = next(
        t for t in diagnosis.traces if t.held_out and t.joint == worst and t.signal == "position"
    )
    mpl.rcParams.update({"svg.hashsalt": "walkerkit", "font.size": 10, "svg.fonttype": "none"})
    figure, (left, right) = plt.subplots(
        1, 2, figsize=(10, 3.2), width_ratios=(3, 1), layout="constrained"
    )
    shown = (trace.time >= SHOWN[0]) & (trace.time <= SHOWN[1])
    time = trace.time[shown]
    for values, color, dash, label in (
        (trace.before, ORANGE, "--", "model as given"),
        (trace.after, BLUE, "-", "model with the named effect"),
    ):
        error = 1e3 * (values - trace.measured)[shown]
        left.plot(time, error, color=color, linestyle=dash, linewidth=1.2, label=label)
    left.set(xlabel="time [s]", ylabel=f"{worst}: simulated − measured [mrad]")
    left.legend(frameon=False, loc="lower right")
    named = diagnosis.effects[0].effect if diagnosis.effects else "nothing named"
    left.set_title(f"held out: {trace.recording};  named: {named}", loc="left", fontsize=10)

    gap = diagnosis.gap
    sizes = 1e3 * np.array([gap.position.before, gap.position.after])
    bars = right.bar(["before", "after"], sizes, color=[ORANGE, BLUE], width=0.6)
    right.bar_label(bars, fmt="%.2g")
    floor = 1e3 * np.hypot(gap.position.noise_floor, gap.numerical_floor)
    right.axhline(floor, color=GREY, linestyle=":", label="noise and timestep")
    right.set(ylabel="position gap, RMS [mrad]")
    right.legend(frameon=False, loc="upper right")
    for axes in (left, right):
        axes.spines[["top", "right"]].set_visible(False)
    PICTURE.parent.mkdir(exist_ok=True)
    figure.savefig(PICTURE, metadata={"Date": None})
    print(result)
    print("hidden:", "; ".join(effect.describe() for effect in rehearsal.hidden))


if __name__ == "__main__":
    main(argument(__doc__, "SEED", 0))
