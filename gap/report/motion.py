"""How a robot moved in a part of a recording, measured and simulated, frame by frame.

motion.qpos("measured")               # (n, nq), a row for each frame
save_motions(motions, names, "motions.npz")
motions = load_motions("diagnosis")   # of the folder of a diagnosis, on its mended models
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.base_state import POSITION
from walkerkit.gap.recordings.recording import QUATERNION
from walkerkit.gap.report.shapes import clad
from walkerkit.gap.simulation.load_robot import load_robot
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.start import rest

FloatArray = NDArray[np.float64]
Which = Literal["measured", "before", "after"]

MOTIONS = "motions.npz"
"""Its file in the folder of a diagnosis."""
WHICH: tuple[Which, ...] = get_args(Which)
POSE = (*POSITION, *QUATERNION)
"""What takes the place of joints' names for the base."""


@dataclass(frozen=True, kw_only=True)
class Motion:
    """A part of one recording, frame by frame.

    Attributes:
        recording: its name.
        held_out: whether no fit has seen it.
        robot: index of its robot among the problem's.
        model: that robot as it was given; never written to.
        time: (n,) of the recording [s].
        joints: what moves: names of joints, and of the base the columns of its pose.
        addresses: of these in qpos.
        measured, before, after: (n, n_joints) positions [rad, m, 1], simulated with the model as
            given and as mended; NaN where nothing was measured or the simulation diverged.
        absent: joints that no log has and nothing else tells.
        base_estimated: where the base is and where it heads was not measured; all three are at the
            estimate.
        whole: whether it is all of the recording.
    """

    recording: str
    held_out: bool
    robot: int
    model: mujoco.MjModel = field(repr=False)
    time: FloatArray = field(repr=False)
    joints: tuple[str, ...]
    addresses: tuple[int, ...]
    measured: FloatArray = field(repr=False)
    before: FloatArray = field(repr=False)
    after: FloatArray = field(repr=False)
    absent: tuple[str, ...] = ()
    base_estimated: bool = False
    whole: bool = True

    @property
    def mended(self) -> bool:
        """Whether the mended model moves otherwise than the given one."""
        return not np.array_equal(self.before, self.after, equal_nan=True)

    def qpos(self, which: Which, factor: float = 1.0) -> FloatArray:
        """(n, nq) positions of its model; what does not move is at rest.

        Args:
            which: measured, or simulated.
            factor: how many times as large as they are errors are made.
        """
        found = np.tile(rest(self.model).qpos, (self.time.size, 1))
        error = getattr(self, which) - self.measured
        own = getattr(self, which) if factor == 1 else self.measured + factor * error
        found[:, list(self.addresses)] = own
        return found

    def every(self, nth: int) -> Motion:
        """The same with fewer frames."""
        rows = slice(None, None, nth)
        kept = {which: getattr(self, which)[rows] for which in WHICH}
        return replace(self, time=self.time[rows], **kept)


def save_motions(motions: Sequence[Motion], models: Sequence[str], path: Path) -> None:
    """Writes motions to a file.

    Args:
        motions: at least one.
        models: names of the mended models beside it, one for each robot.
        path: the `.npz` file.
    """
    heads = [
        {
            "recording": one.recording,
            "held_out": one.held_out,
            "robot": one.robot,
            "model": models[one.robot],
            "joints": one.joints,
            "absent": one.absent,
            "base_estimated": one.base_estimated,
            "whole": one.whole,
        }
        for one in motions
    ]
    arrays: dict[str, Any] = {"about": np.array(json.dumps(heads))}
    for k, one in enumerate(motions):
        arrays[f"{k}/time"] = one.time
        arrays |= {f"{k}/{which}": getattr(one, which).astype(np.float32) for which in WHICH}
    np.savez_compressed(path, **arrays)


def load_motions(folder: str | Path, *, allow_outside: bool = False) -> tuple[Motion, ...]:
    """The motions that a diagnosis has left, on its mended models.

    Args:
        folder: of the diagnosis.
        allow_outside: let the models read files outside of it.

    Raises:
        InputError: it is no folder of a diagnosis, or has no motions.
    """
    path = Path(folder) / MOTIONS
    try:
        with path.open("rb") as opened, np.load(opened) as file:
            arrays = dict(file)
        heads = json.loads(str(arrays["about"]))
        robots = {
            name: load_robot(path.parent / name, allow_outside=allow_outside)
            for name in dict.fromkeys(head["model"] for head in heads)
        }
        models = {name: clad(robot.spec, robot.model) for name, robot in robots.items()}
        return tuple(
            _loaded(k, head, arrays, robots[head["model"]], models[head["model"]])
            for k, head in enumerate(heads)
        )
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read ({error.strerror}). Give the folder that `walkerkit diagnose "
            "--out DIR` has written; of an older version, diagnose again with --overwrite."
        ) from None
    except (KeyError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(
            f"{path}: is damaged ({error}). Diagnose again with --overwrite."
        ) from None


def _loaded(
    k: int, head: dict[str, Any], arrays: dict[str, Any], robot: Robot, model: mujoco.MjModel
) -> Motion:
    """One motion of a file."""
    values = {which: arrays[f"{k}/{which}"].astype(np.float64) for which in WHICH}
    return Motion(
        recording=head["recording"],
        held_out=head["held_out"],
        robot=head["robot"],
        model=model,
        time=arrays[f"{k}/time"],
        joints=tuple(head["joints"]),
        addresses=tuple(_address(robot, name) for name in head["joints"]),
        absent=tuple(head["absent"]),
        base_estimated=head["base_estimated"],
        whole=head["whole"],
        **values,
    )


def _address(robot: Robot, name: str) -> int:
    if name in POSE and robot.base is not None:
        return robot.base.qpos + POSE.index(name)
    return robot.joints[name].qpos
