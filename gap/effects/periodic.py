"""Effects that come back with the pose: magnets, gear teeth, eccentric bearings.

How often they come back is not known. The starts of their fits are the waves that the recordings
show in `Excursion.waves`; where those are unknown, a few periods over the joint's range.
"""

from __future__ import annotations

import abc
from typing import ClassVar

import numpy as np

from walkerkit.actuators import drivetrain
from walkerkit.gap.effects.effect import Parameter
from walkerkit.gap.effects.law_effect import LawEffect
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.wave import Wave, WaveForm

_UNKNOWN = (4.0, 15.0)  # periods over the joint's range, where no recording tells
_FEWEST, _MOST = 0.5, 800.0  # periods over the joint's range
_TURNS = 3 * np.pi  # rad; phases are found within one turn, and may run over


class _Periodic(LawEffect):
    """A law with amplitude, periods and phase.

    Attributes:
        form: how the wave shows in the recordings.
        swing: the law's amplitude over that of the wave.
    """

    form: ClassVar[WaveForm]
    swing: ClassVar[float] = 1.0

    @abc.abstractmethod
    def size(self, robot: Robot, joint: str) -> tuple[float, float]:
        """A small amplitude, and the largest [N·m; N; 1]."""

    def waves(self, robot: Robot, joint: str) -> tuple[Wave, ...]:
        """The waves to start from; where the joint has one already, more and less of it."""
        size, most = self.size(robot, joint)
        excursion, known = robot.excursion(joint), self.known(robot, joint)
        if known["amplitude"]:
            return tuple(
                Wave(
                    form=self.form,
                    periods=known["periods"],
                    amplitude=min(factor * known["amplitude"], max(most, known["amplitude"])),
                    phase=known["phase"],
                )
                for factor in (0.7, 1.3)
            )
        found = excursion.waves(self.form) or tuple(
            Wave(
                form=self.form,
                periods=2 * np.pi * turns / excursion.range,
                amplitude=size,
                phase=0.0,
                mean=size,
            )
            for turns in _UNKNOWN
        )
        return tuple(
            Wave(
                form=self.form,
                periods=wave.periods,
                amplitude=float(np.clip(self.swing * wave.amplitude, 0.1 * size, most)),
                phase=wave.phase,
                mean=wave.mean,
            )
            for wave in found
        )

    def shape(self, robot: Robot, joint: str) -> tuple[Parameter, ...]:
        """The parameters of the wave."""
        size, most = self.size(robot, joint)
        starts, known = self.waves(robot, joint), self.known(robot, joint)
        turn = 2 * np.pi / robot.excursion(joint).range
        slide, factor = robot.joints[joint].slide, self.form == "effort"
        fewest, highest = min(_FEWEST * turn, known["periods"]), max(_MOST * turn, known["periods"])
        return (
            Parameter(
                name="amplitude",
                unit="1" if factor else "N" if slide else "N·m",
                zero=known["amplitude"],
                lower=0.0,
                upper=max(most, known["amplitude"]),
                scale=size,
                starts=tuple(wave.amplitude for wave in starts),
            ),
            Parameter(
                name="periods",
                unit="1/m" if slide else "1/rad",
                zero=known["periods"],
                lower=fewest,
                upper=highest,
                scale=0.1 * turn,
                starts=tuple(float(np.clip(wave.periods, fewest, highest)) for wave in starts),
                shape=not known["amplitude"],
            ),
            Parameter(
                name="phase",
                unit="rad",
                zero=known["phase"],
                lower=-_TURNS,
                upper=_TURNS,
                scale=0.5,
                starts=tuple(wave.phase for wave in starts),
                shape=not known["amplitude"],
            ),
        )


class PoseDependentFriction(_Periodic):
    """Dry friction that comes back with the pose: a bent shaft, an eccentric bearing."""

    law = drivetrain.PoseDependentFriction
    dry = True
    form = "friction"
    swing = 2.0  # it goes from nothing to A
    name = "pose_dependent_friction"
    part = "friction"
    equation = (
        "τ = −(Fc + A (1 + sin(N q + φ))/2) sgn q̇; Fc: frictionloss, more than the model's [N·m], "
        "A: amplitude [N·m], N: periods [1/rad], φ: phase [rad]"
    )
    symptom = "repeats with q"
    added_as = "joint frictionloss, and a drivetrain law in actuators.json"
    source = (
        "Armstrong-Hélouvry, Control of Machines with Friction, 1991, position-dependent friction"
    )
    extends = ("coulomb_friction",)

    def size(self, robot: Robot, joint: str) -> tuple[float, float]:
        """Parts of the effort."""
        effort = robot.excursion(joint).effort
        return 0.05 * effort, 2.0 * effort

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The dry friction that every pose has, and the wave on top of it."""
        effort = robot.excursion(site).effort
        own = float(robot.model.dof_frictionloss[robot.joints[site].dof])
        known, starts = self.known(robot, site), self.waves(robot, site)
        least = (
            [0.0 for _ in starts]
            if known["amplitude"]
            else [max(wave.mean - 0.5 * wave.amplitude, -own) for wave in starts]
        )
        return (
            Parameter(
                name="frictionloss",
                unit="N" if robot.joints[site].slide else "N·m",
                lower=-own,
                upper=2 * effort,
                scale=0.1 * effort,
                starts=tuple(min(value, 2 * effort) for value in least),
            ),
            *self.shape(robot, site),
        )


class Cogging(_Periodic):
    """Magnets that pull the motor into certain poses."""

    law = drivetrain.Cogging
    driven = True
    form = "pose"
    name = "cogging"
    part = "pose"
    equation = "τ = A sin(N q + φ); A: amplitude [N·m], N: periods [1/rad], φ: phase [rad]"
    symptom = "periodic in q"
    source = "MuJoCo XML reference, actuator/dcmotor/cogging"
    extends = ("torque_bias", "parallel_spring")

    def size(self, robot: Robot, joint: str) -> tuple[float, float]:
        """Parts of the effort."""
        effort = robot.excursion(joint).effort
        return 0.02 * effort, 2.0 * effort

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The wave."""
        return self.shape(robot, site)


class TorqueRipple(_Periodic):
    """A motor whose torque constant varies with the pose."""

    law = drivetrain.TorqueRipple
    driven = True
    form = "effort"
    name = "torque_ripple"
    part = "pose"
    equation = (
        "τ (1 + A sin(N q + φ)) of the drive's τ; A: amplitude [1], N: periods [1/rad], "
        "φ: phase [rad]"
    )
    symptom = "periodic, grows with effort"
    source = "Jahns, Soong, Pulsating torque minimization, IEEE Trans. Ind. Electronics 43, 1996"
    extends = ("torque_constant",)

    def size(self, robot: Robot, joint: str) -> tuple[float, float]:
        """Parts of the effort."""
        return 0.03, 0.95

    def parameters(self, robot: Robot, site: str) -> tuple[Parameter, ...]:
        """The wave."""
        return self.shape(robot, site)
