"""An effort that the catalogue has no name for: free in pose, speed and load, and small.

    free = Term(effect=FREE_EFFORT, sites=("knee",))

It is a drivetrain law like others, so that it is simulated, fitted and compared as they are. It is
in no catalogue, is never told and never written into a model.
"""

from __future__ import annotations

from dataclasses import make_dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.config_fields import number
from walkerkit.actuators.drivetrain import DrivetrainLaw
from walkerkit.actuators.drivetrain.drivetrain_law import Parameters, Stage, State, Step, clipped
from walkerkit.gap.effects import LawEffect, Parameter
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]

_WAVES = 12  # over a joint's range, of half a period and more
_TURNS, _BENDS = 0.05, 0.25  # of a joint's peak speed, over which friction turns and bends
_BEYOND = 1.2  # of what the recordings show, as far as it is free
_PLAUSIBLE = 0.02  # of a joint's peak effort: what each of its numbers is, if it is there
_NUMBERS = tuple(f"w{k}" for k in range(_WAVES + 11))
_SCALES = ("center", "reach", "speed", "load")  # of the joint, which are not fitted


def shapes(q: FloatArray, qd: FloatArray, effort: FloatArray) -> FloatArray:
    """(n_numbers, ...) what the numbers of a free effort go with, each 1 in size at most or so.

    A constant and cosines of the pose, drag and friction, the load and friction that grows with it,
    and friction that goes with the pose.

    Args:
        q: positions from the middle of the range, over half of it, (...).
        qd: velocities over the peak, (...).
        effort: of the drive over its peak, (...).
    """
    found = np.empty((len(_NUMBERS), *q.shape))
    waves = np.arange(_WAVES + 1).reshape(-1, *(1 for _ in q.shape))
    of_pose = found[: _WAVES + 1]
    np.cos(0.5 * np.pi * waves * (q + 1.0), out=of_pose)
    dry, speed, load = np.tanh(qd / _TURNS), np.abs(qd), np.abs(effort)
    others = (
        *(qd, qd * speed, dry, np.tanh(qd / _BENDS)),
        *(effort, effort * load, load * dry, effort * speed),
        *(dry * of_pose[1], dry * of_pose[2]),
    )
    for row, values in zip(found[_WAVES + 1 :], others, strict=True):
        row[...] = values
    return found


def _apply(step: Step, p: Parameters, state: State) -> None:
    """As in `DrivetrainLaw`."""
    q = clipped((step.q - p["center"]) / p["reach"], -_BEYOND, _BEYOND)
    qd = clipped(step.qd / p["speed"], -_BEYOND, _BEYOND)
    effort = clipped(step.effort / p["load"], -_BEYOND, _BEYOND)
    step.extra += np.einsum("k...,k...->...", p["weights"], shapes(q, qd, effort))


def _prepared(p: Parameters, dt: float) -> Parameters:
    """As in `DrivetrainLaw`, with all weights in one."""
    return {**p, "weights": np.stack([p[name] for name in _NUMBERS])}


_FIELDS = {**dict.fromkeys(_NUMBERS, 0.0), **dict.fromkeys(_SCALES, 1.0)}
_NAME = "free_effort"
_STAGE: Stage = "joint"
FreeEffortLaw: type[DrivetrainLaw] = make_dataclass(
    "FreeEffortLaw",
    [(name, float, number(default=neutral)) for name, neutral in _FIELDS.items()],
    bases=(DrivetrainLaw,),
    namespace={
        "__module__": __name__,
        "name": _NAME,
        "stage": _STAGE,
        "sizes": len(_NUMBERS),
        "neutral": _FIELDS,
        "apply": staticmethod(_apply),
        "prepared": staticmethod(_prepared),
    },
    frozen=True,
    kw_only=True,
)


class FreeEffort(LawEffect, listed=False):
    """An effort at a joint that goes with its pose, its speed and its load in any smooth way."""

    law: ClassVar[type[DrivetrainLaw]] = FreeEffortLaw
    name = _NAME
    equation = "τ = f(q, q̇, τ_drive), a sum of cosines of q and of friction, drag and load"
    symptom = "goes with pose, speed or load"
    source = "Kennedy, O'Hagan, Bayesian calibration of computer models, JRSS B 63, 2001"

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The weights."""
        effort = robot.excursion(site).effort
        size = _PLAUSIBLE * effort
        return tuple(
            Parameter(
                name=name,
                unit="N" if robot.joints[site].slide else "N·m",
                lower=-2 * effort,
                upper=2 * effort,
                scale=size,
                starts=(size,),
            )
            for name in _NUMBERS
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Writes the weights, and what they are scaled by."""
        super().apply(trials, site, values)
        excursion = trials.robot.excursion(site)
        own = trials.law(self.law, site)
        own["center"][:] = 0.5 * (excursion.lower + excursion.upper)
        own["reach"][:] = 0.5 * excursion.range
        own["speed"][:] = excursion.velocity
        own["load"][:] = excursion.effort


FREE_EFFORT = FreeEffort()
