"""What a replay needs at once, judged before anything of it is made."""

from __future__ import annotations

from collections.abc import Sequence

import mujoco

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording

MOST_BYTES = 2**32
_COPIES = 8  # of a rollout's numbers, while it is made, refined and read as a log
_PAST = 1.5  # s that are kept of the commands before each recording


def check_size(model: mujoco.MjModel, source: str, recordings: Sequence[Recording]) -> None:
    """Refuses a model whose replays of the recordings would not fit into memory.

    Args:
        model: the robot.
        source: names it in messages.
        recordings: what is to be replayed as a whole.

    Raises:
        InputError: it would need more than `MOST_BYTES`.
    """
    step = float(model.opt.timestep)
    seconds = sum(float(one.time[-1] - one.time[0]) for one in recordings)
    steps = (seconds + _PAST * len(recordings)) / step
    need = 8 * _COPIES * steps * (model.nq + 2 * model.nv + model.nu)
    if need > MOST_BYTES:
        raise InputError(
            f"{source}: {seconds:.4g} s of recordings at its timestep of {step:.3g} s are "
            f"{seconds / step:.2g} steps, which need {need / 2**30:.2g} GiB at once. Give the "
            "model a longer timestep, or cut the recordings with Recording.between."
        )
