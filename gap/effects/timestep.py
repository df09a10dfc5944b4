"""Nothing physical: the simulation itself."""

from __future__ import annotations

from collections.abc import Sequence
from types import MappingProxyType

import mujoco
import numpy as np

from walkerkit.gap.effects import fields
from walkerkit.gap.effects.effect import EVERYWHERE, Effect, FloatArray, Parameter
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

_FINEST = 8  # steps in place of one
_EULER = int(mujoco.mjtIntegrator.mjINT_EULER)
_IMPLICIT = int(mujoco.mjtIntegrator.mjINT_IMPLICITFAST)


def _step(robot: Robot, site: str, given: Robot) -> float:
    return float(robot.model.opt.timestep)


def _exchanged(robot: Robot, site: str, given: Robot) -> float:
    """1 where the integrator is another than that of the robot as it was given."""
    return float(robot.model.opt.integrator != given.model.opt.integrator)


class Timestep(Effect):
    """The model is simulated in steps too long for what it does, or by another integrator.

    Its numbers are chosen among their starts and never fitted: whole numbers of steps in place of
    one, so that targets change where they did. The search takes numerical error out of every
    prediction by itself; this is for naming it, and for a model that has to go without it.
    """

    name = "timestep"
    part = "timing"
    equation = (
        "h: timestep [s], a whole part of the model's; explicit integration of actuators exchanged "
        "for implicit, or the other way round, where integrator [1] is 1"
    )
    symptom = "shrinks when replayed in shorter steps"
    added_as = "option timestep, integrator"
    source = "MuJoCo documentation, Computation: Numerical integration"
    fields = MappingProxyType(
        {
            "timestep": fields.Field(path="option/timestep", read=_step),
            "integrator": fields.Field(path="option/integrator", read=_exchanged),
        }
    )
    kind = "robot"
    fitted = False

    def sites(self, robot: Robot, joints: Sequence[str]) -> tuple[str, ...]:
        """The robot as a whole."""
        return (EVERYWHERE,)

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The timestep, and whether the integrator is the other one."""
        own = _as_read(robot)
        return (
            Parameter(
                name="timestep",
                unit="s",
                zero=own,
                lower=own / _FINEST,
                upper=own,
                scale=own / _FINEST,
                starts=(own / 2, own / 4, own, own / 4),
                choice=True,
            ),
            Parameter(
                name="integrator",
                unit="1",
                lower=0.0,
                upper=1.0,
                scale=0.5,
                starts=(0.0, 0.0, 1.0, 1.0),
                choice=True,
            ),
        )

    def apply(self, trials: Trials, site: str, values: FloatArray) -> None:
        """Sets `opt.timestep` and `opt.integrator`, which takes a robot that is compiled anew.

        A robot with another timestep than its model's, which shows the numerical error, makes as
        many steps in place of one: what is chosen has a numerical error of its own.
        """
        option = trials.robot.model.opt
        parts = np.clip(np.round(_as_read(trials.robot) / values[:, 0]), 1, None)
        other = values[:, 1] > 0.5
        if (parts > 1).any():
            trials.field("opt.timestep")[:] = option.timestep / parts
        if other.any():
            exchanged = _IMPLICIT if option.integrator == _EULER else _EULER
            trials.field("opt.integrator")[other] = exchanged


def _as_read(robot: Robot) -> float:
    """The timestep of a robot's model [s]."""
    return float(robot.model.opt.timestep * robot.finer)
