"""Variants of one robot, side by side: what an effect changes when it is added.

    trials = Trials(robot, n=3)
    trials.field("dof_damping")[:, dof] += [0.0, 0.1, 0.2]
    trials.command_delay["knee"] += 0.01

A variant differs from the model in model fields (simulated without recompiling), in the way from
the command to the drive, and in the way from the joint to the log. Each effect of the catalogue is
a few lines that write here; replay and the writer of the mended model read it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain import DrivetrainLaw, law_named
from walkerkit.gap.simulation.robot import Robot

FloatArray = NDArray[np.float64]

_PLAY = ("width", "compliance", "damping_ratio", "armature")
_MOUNT = ("compliance", "damping_ratio")


class Trials:
    """`n` variants of one robot; arrays have one row each.

    Args:
        robot: the robot as it is.
        n: number of variants.

    Attributes:
        command_delay: joint to (n,) extra age of its targets at the drive [s].
        position_delay: joint to (n,) age of its logged position and velocity [s].
        effort_scale: joint to (n,) logged effort over the drive's effort at the joint.
        effort_offset: joint to (n,) added to the logged effort [N·m].
        encoder_gain: joint to (n,) logged over true position and velocity [1].
        position_error: joint to (n, 3) amplitude, periods and phase of A sin(N q + φ), which is
            added to the logged position [rad; 1/rad; rad].
        clock_skew: joint to (n,) ε: what happens t after the log's first sample is stamped
            t (1 + ε) [1].
        load_side: joint to (n,) how much of its play lies before the encoder that is logged and
            fed back [1].
        start_errors: joint to (n, 2) how far a segment starts from its measured position and
            velocity, in standard deviations of these [1].
        fields: model field to its (n, *shape) values, of the fields that were asked for.
        laws: drivetrain law, joint and parameter to its (n,) values, of the laws asked for.
        plays: joint and number to its (n,) values, of the joints whose play was asked for.
        mounts: number to its (n,) values, where the mount was asked for.
        numbers: joint and name to (n,) values of the numbers of laws in Python that were asked for.
    """

    def __init__(self, robot: Robot, n: int):
        self.robot = robot
        self.n = n
        self.command_delay = {name: np.zeros(n) for name in robot.joints}
        known = {name: robot.measured(name) for name in robot.joints}
        self.position_delay = {j: np.full(n, known[j].position_delay) for j in known}
        self.effort_scale = {j: np.full(n, known[j].effort_scale) for j in known}
        self.effort_offset = {j: np.full(n, known[j].effort_offset) for j in known}
        self.encoder_gain = {j: np.full(n, known[j].encoder_gain) for j in known}
        self.position_error = {
            j: np.tile([k.error_amplitude, k.error_periods, k.error_phase], (n, 1))
            for j, k in known.items()
        }
        self.clock_skew = {j: np.full(n, known[j].clock_skew) for j in known}
        self.load_side = {j: np.full(n, known[j].load_side) for j in known}
        self.start_errors = {j: np.zeros((n, 2)) for j in known}
        self.fields: dict[str, NDArray[Any]] = {}
        self.laws: dict[tuple[type[DrivetrainLaw], str, str], FloatArray] = {
            (law_named(law), joint, name): np.full(n, value)
            for joint, laws in robot.laws.items()
            for law, parameters in laws.items()
            for name, value in parameters.items()
        }
        self.plays: dict[tuple[str, str], FloatArray] = {}
        self.mounts: dict[str, FloatArray] = {}
        self.numbers: dict[tuple[str, str], FloatArray] = {}

    def field(self, name: str) -> NDArray[Any]:
        """The (n, *shape) values of a model field, or of an `opt.` field, to write to."""
        if name not in self.fields:
            self.fields[name] = self.own(name)
        return self.fields[name]

    def own(self, name: str) -> NDArray[Any]:
        """The (n, *shape) values that the model itself has."""
        return np.repeat(model_field(self.robot.model, name)[None], self.n, axis=0)

    def law(self, law: type[DrivetrainLaw], joint: str) -> dict[str, FloatArray]:
        """The (n,) parameters of a law at a joint, neutral at first, to write to."""
        for name in law.parameter_names():
            if (law, joint, name) not in self.laws:
                self.laws[law, joint, name] = np.full(self.n, law.neutral[name])
        return {name: self.laws[law, joint, name] for name in law.parameter_names()}

    def number(self, joint: str, name: str) -> FloatArray:
        """The (n,) values of a number of a joint's law in Python, infinite where it has none."""
        if (joint, name) not in self.numbers:
            known = self.robot.number(joint, name)
            self.numbers[joint, name] = np.full(self.n, np.inf if known is None else known)
        return self.numbers[joint, name]

    def play(self, joint: str) -> dict[str, FloatArray]:
        """The play between a joint and its link, (n,) values each, none at first, to write to.

        `width` of a gap [rad; m]; `compliance` of the gear [rad/(N·m); m/N] and its
        `damping_ratio`, for rotor against link; there is play where one of the first two is not 0.
        `armature` is then added to the joint's, which is that of its rotor [kg·m²; kg].
        """
        for name in _PLAY:
            if (joint, name) not in self.plays:
                self.plays[joint, name] = np.zeros(self.n)
        return {name: self.plays[joint, name] for name in _PLAY}

    def mount(self) -> dict[str, FloatArray]:
        """What the robot is mounted on, (n,) values each, stiff at first, to write to.

        `compliance` [rad/(N·m)], and `damping_ratio` of what it carries [1].
        """
        for name in _MOUNT:
            if name not in self.mounts:
                self.mounts[name] = np.zeros(self.n)
        return self.mounts

    @property
    def with_laws(self) -> NDArray[np.bool_]:
        """(n,) whether a law does anything in a variant, one of a drive in Python among them."""
        if self.robot.programs:
            return np.ones(self.n, dtype=bool)
        return self._acting(list(self.laws))

    @property
    def stepwise(self) -> NDArray[np.bool_]:
        """(n,) whether a law does anything that is not known before the simulation."""
        if self.robot.programs:
            return np.ones(self.n, dtype=bool)
        return self._acting([k for k in self.laws if not (k[0].targets_only or k[0].constant)])

    def _acting(self, laws: Sequence[tuple[type[DrivetrainLaw], str, str]]) -> NDArray[np.bool_]:
        active = np.zeros(self.n, dtype=bool)
        for law, joint, name in laws:
            if name in law.parameter_names()[: law.sizes]:
                active |= self.laws[law, joint, name] != law.neutral[name]
        return active

    def rows(self, rows: slice | NDArray[np.intp]) -> Trials:
        """Some of the variants."""
        part = Trials(self.robot, len(np.arange(self.n)[rows]))
        for mine, theirs in zip(self._columns(), part._columns(), strict=True):
            theirs.update({name: values[rows] for name, values in mine.items()})
        return part

    def on(self, robot: Robot, carried: Callable[[str, NDArray[Any]], NDArray[Any]]) -> Trials:
        """The variants on a robot that has their plays, and more, in its model.

        Args:
            robot: the robot, with all joints of this one.
            carried: a model field's name and its (n, *shape) values here → its values there.
        """
        there = Trials(robot, self.n)
        for mine, theirs in zip(self._columns(), there._columns(), strict=True):
            theirs.update({name: values.copy() for name, values in mine.items()})
        there.fields.update({name: carried(name, own) for name, own in self.fields.items()})
        there.plays.clear()
        there.mounts.clear()
        return there

    @classmethod
    def joined(cls, blocks: Sequence[Trials]) -> Trials:
        """The variants of several blocks of one robot, one after the other."""
        whole = cls(blocks[0].robot, sum(block.n for block in blocks))
        for name in dict.fromkeys(name for block in blocks for name in block.fields):
            for block in blocks:
                block.field(name)
        for law, joint in dict.fromkeys((law, j) for block in blocks for law, j, _ in block.laws):
            for block in blocks:
                block.law(law, joint)
        for joint in dict.fromkeys(joint for block in blocks for joint, _ in block.plays):
            for block in blocks:
                block.play(joint)
        if any(block.mounts for block in blocks):
            for block in blocks:
                block.mount()
        for joint, name in dict.fromkeys(key for block in blocks for key in block.numbers):
            for block in blocks:
                block.number(joint, name)
        for k, columns in enumerate(whole._columns()):
            parts = [block._columns()[k] for block in blocks]
            columns.update({name: np.concatenate([p[name] for p in parts]) for name in parts[0]})
        return whole

    def _columns(self) -> tuple[dict[Any, NDArray[Any]], ...]:
        return (
            self.command_delay,
            self.position_delay,
            self.effort_scale,
            self.effort_offset,
            self.encoder_gain,
            self.position_error,
            self.clock_skew,
            self.load_side,
            self.start_errors,
            self.fields,
            self.laws,
            self.plays,
            self.mounts,
            self.numbers,
        )


def model_field(model: mujoco.MjModel, name: str) -> NDArray[Any]:
    """A field of the model, or with the prefix `opt.` of its options, as an array."""
    if name.startswith("opt."):
        return np.asarray(getattr(model.opt, name.removeprefix("opt.")))
    return np.asarray(getattr(model, name))
