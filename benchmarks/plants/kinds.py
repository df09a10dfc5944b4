"""Kinds of errors that are planted in the best model of a real log, or in the log.

    error = KINDS["payload"](rng, Setting(robots, recordings))
    error.effect, error.place, error.truth     # what undoes it, where, by how much
    error.robot(trials)                        # the model with it
    error.recording(recording)                 # the log with it

An error of the model is a wrong number of it; the machine is what it is. What a diagnosis should
say is what leads back to the best model: a model with 0.2 kg too little lacks a payload of 0.2 kg.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.effects import CATALOGUE, EVERYWHERE
from walkerkit.gap.recordings.recording import TARGETS, Recording
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]

SIGN_FLIP: Final = "sign_flip"
"""What a diagnosis calls a column with the wrong sign; no effect, but an error of wiring."""

_LEAST_LEFT = 0.4  # of a body's own mass, where the model has too little
_FELT = 1e-3  # of the largest effort of gravity
_POSE = 0.3  # rad, in which that is looked at


@dataclass(frozen=True, kw_only=True)
class Setting:
    """Where an error is to be planted.

    Attributes:
        robots: the best model of each experiment.
        recordings: all recordings.
    """

    robots: tuple[Robot, ...]
    recordings: tuple[Recording, ...]

    @property
    def robot(self) -> Robot:
        """The first model, of which the sizes are."""
        return self.robots[0]

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that are measured."""
        return self.recordings[0].joints

    @property
    def signals(self) -> frozenset[str]:
        """What the logs have of the joints."""
        return frozenset(name.rpartition("/")[2] for name in self.recordings[0].columns)


@dataclass(frozen=True, kw_only=True)
class Planted:
    """An error with its place and size.

    Attributes:
        effect: name of what undoes it: an effect of the catalogue, or `sign_flip`.
        place: joint, body or `*`.
        truth: parameter of the effect to the value that leads back.
        text: for people.
        robot: writes it to a variant of a model.
        recording: writes it to a log.
    """

    effect: str
    place: str
    truth: Mapping[str, float]
    text: str
    robot: Callable[[Trials], None] = lambda trials: None
    recording: Callable[[Recording], Recording] = lambda recording: recording


Kind = Callable[[np.random.Generator, Setting], Planted | None]
"""Draws an error for a setting; None where it cannot have such."""


def gain(factor: float) -> Kind:
    """A servo's position gain that nobody knew: the model has so many times that of the machine."""

    def planted(rng: np.random.Generator, setting: Setting) -> Planted | None:
        effect = "position_gain"
        joint = _drawn(rng, CATALOGUE[effect].sites(setting.robot, setting.joints))
        if joint is None:
            return None

        def robot(trials: Trials) -> None:
            _apply(trials, effect, joint, kp=(factor - 1) * _stiffness(trials.robot, joint))

        kp = _stiffness(setting.robot, joint)
        return Planted(
            effect=effect,
            place=joint,
            truth={"kp": (1 - factor) * kp},
            text=f"kp of {joint} times {factor:g}",
            robot=robot,
        )

    return planted


def strength(*factors: float, joint: str | None = None) -> Kind:
    """A motor that the model takes for stronger or weaker than it is.

    Args:
        factors: one that is used as it is, or two between which one is drawn, or one over it.
        joint: where; drawn by default.
    """

    def planted(rng: np.random.Generator, setting: Setting) -> Planted | None:
        place = joint or _drawn(rng, setting.joints)
        factor = factors[0]
        if len(factors) > 1:
            factor = float(rng.uniform(*factors)) ** float(rng.choice([-1, 1]))
        return place and _of_model(
            "torque_constant",
            place,
            f"motor of {place} times {factor:.3g}",
            {"strength": factor - 1},
            {"strength": 1 / factor - 1},
        )

    return planted


def payload(rng: np.random.Generator, setting: Setting) -> Planted | None:
    """A body that is lighter or heavier than the model says."""
    body = _drawn(rng, CATALOGUE["payload"].sites(setting.robot, setting.joints))
    if body is None:
        return None
    of = setting.robot.model.body(body)
    size = float(rng.uniform(0.15, 0.4) * of.subtreemass[0] * rng.choice([-1, 1]))
    size = max(size, -_LEAST_LEFT * float(of.mass[0]))
    return _of_model("payload", body, f"{size:+.3g} kg at {body}", {"mass": size})


def base_tilt(rng: np.random.Generator, setting: Setting) -> Planted | None:
    """A base that the model has level, or not level enough."""
    angles = [angle for angle in ("roll", "pitch") if _felt(setting.robot, angle)]
    angle = _drawn(rng, angles)
    if angle is None:
        return None
    size = float(rng.uniform(0.05, 0.12) * rng.choice([-1, 1]))
    return _of_model("base_tilt", EVERYWHERE, f"{angle} {size:+.3g} rad", {angle: size})


def armature(rng: np.random.Generator, setting: Setting) -> Planted | None:
    """A rotor that the model takes for heavier than it is."""
    joint = _drawn(rng, setting.joints)
    if joint is None:
        return None
    inertia = float(setting.robot.model.dof_M0[setting.robot.joints[joint].dof])
    size = float(rng.uniform(0.3, 1.0)) * inertia
    return _of_model("armature", joint, f"{size:+.3g} kg·m² at {joint}", {"armature": size})


def taken_away(effect: str, parameter: str, field: str) -> Kind:
    """A model without what its best has of friction at a joint."""

    def planted(rng: np.random.Generator, setting: Setting) -> Planted | None:
        own = getattr(setting.robot.model, field)
        has = {joint: float(own[setting.robot.joints[joint].dof]) for joint in setting.joints}
        joint = _drawn(rng, [joint for joint, size in has.items() if size > 0])
        return joint and _of_model(
            effect,
            joint,
            f"{parameter} of {joint} {has[joint]:.3g} taken away",
            {parameter: -has[joint]},
        )

    return planted


def delay(rng: np.random.Generator, setting: Setting) -> Planted | None:
    """A log whose targets are stamped before they were sent, by a whole number of rows."""
    step = float(np.median(np.diff(setting.recordings[0].time)))
    rows = max(1, round(float(rng.uniform(0.008, 0.025)) / step))

    def recording(log: Recording) -> Recording:
        later = np.minimum(np.arange(len(log.time)) + rows, len(log.time) - 1)
        return _with(log, {n: v[later] for n, v in log.columns.items() if _signal(n) in TARGETS})

    return Planted(
        effect="command_delay",
        place=EVERYWHERE,
        truth={"delay": rows * step},
        text=f"targets logged {1000 * rows * step:.1f} ms before they were sent",
        recording=recording,
    )


def encoder_offset(rng: np.random.Generator, setting: Setting) -> Planted | None:
    """An encoder with another zero, for the servo and the log."""
    joint = _drawn(rng, [j for j in setting.joints if not setting.robot.joints[j].slide])
    if joint is None:
        return None
    size = float(rng.uniform(0.04, 0.1) * rng.choice([-1, 1]))

    def recording(log: Recording) -> Recording:
        names = [f"{joint}/position", f"{joint}/position_target"]
        return _with(log, {n: log.columns[n] + size for n in names if n in log.columns})

    return Planted(
        effect="encoder_offset",
        place=joint,
        truth={"ref": size},
        text=f"{joint} reads {size:+.3g} rad",
        recording=recording,
    )


def encoder_gain(rng: np.random.Generator, setting: Setting) -> Planted | None:
    """An encoder that reads too steeply or too little, for the servo and the log.

    The servo's gains are per radian of its own reading, and so become those of the model.
    """
    joint = _drawn(rng, setting.joints)
    if joint is None:
        return None
    excess = float(rng.uniform(0.05, 0.12) * rng.choice([-1, 1]))
    servo = setting.robot.joints[joint].drive("position") is not None
    signals = ("position", "velocity", "position_target", "velocity_target")

    def robot(trials: Trials) -> None:
        drive = trials.robot.joints[joint].drive("position")
        if drive is not None:
            trials.field("actuator_gainprm")[:, drive.actuator, 0] /= 1 + excess
            trials.field("actuator_biasprm")[:, drive.actuator, 1:3] /= 1 + excess

    def recording(log: Recording) -> Recording:
        names = [f"{joint}/{signal}" for signal in signals]
        return _with(log, {n: (1 + excess) * log.columns[n] for n in names if n in log.columns})

    return Planted(
        effect="encoder_gain",
        place=joint,
        truth={"excess": excess},
        text=f"{joint} and its {'servo' if servo else 'log'} read {excess:+.1%} too much",
        robot=robot,
        recording=recording,
    )


def sign_flip(rng: np.random.Generator, setting: Setting) -> Planted | None:
    """A joint whose encoder counts the other way."""
    joint = _drawn(rng, setting.joints)
    if joint is None:
        return None

    def recording(log: Recording) -> Recording:
        names = [f"{joint}/position", f"{joint}/velocity"]
        return _with(log, {n: -log.columns[n] for n in names if n in log.columns})

    return Planted(
        effect=SIGN_FLIP,
        place=joint,
        truth={},
        text=f"{joint} is logged with the other sign",
        recording=recording,
    )


KINDS: Final[Mapping[str, Kind]] = MappingProxyType(
    {
        "gain_0.3": gain(0.3),
        "gain_0.5": gain(0.5),
        "gain_2": gain(2.0),
        "gain_3": gain(3.0),
        "shoulder_1.2": strength(1.2, joint="shoulder"),
        "shoulder_0.85": strength(0.85, joint="shoulder"),
        "torque_constant": strength(1.15, 1.35),
        "payload": payload,
        "base_tilt": base_tilt,
        "coulomb_friction": taken_away("coulomb_friction", "frictionloss", "dof_frictionloss"),
        "viscous_friction": taken_away("viscous_friction", "damping", "dof_damping"),
        "armature": armature,
        "delay": delay,
        "encoder_offset": encoder_offset,
        "encoder_gain": encoder_gain,
        "sign_flip": sign_flip,
    }
)
"""The kinds by name."""


def _of_model(
    effect: str,
    place: str,
    text: str,
    values: Mapping[str, float],
    truth: Mapping[str, float] | None = None,
) -> Planted:
    """An error that is an effect of the catalogue; what undoes it is less of the same."""
    return Planted(
        effect=effect,
        place=place,
        truth={name: -value for name, value in values.items()} if truth is None else truth,
        text=text,
        robot=lambda trials: _apply(trials, effect, place, **values),
    )


def _apply(trials: Trials, effect: str, place: str, **values: float) -> None:
    parameters = CATALOGUE[effect].parameters(trials.robot, place)
    row = [values.get(parameter.name, parameter.zero) for parameter in parameters]
    CATALOGUE[effect].apply(trials, place, np.array([row] * trials.n))


def _drawn(rng: np.random.Generator, names: Sequence[str]) -> str | None:
    return names[int(rng.integers(len(names)))] if names else None


def _stiffness(robot: Robot, joint: str) -> float:
    drive = robot.joints[joint].drive("position")
    return drive.stiffness if drive else 0.0


def _felt(robot: Robot, angle: str) -> bool:
    """Whether gravity makes another effort at some joint where the base is tilted."""
    trials = Trials(robot, 1)
    _apply(trials, "base_tilt", EVERYWHERE, **{angle: 0.1})
    efforts = []
    for gravity in (robot.model.opt.gravity, trials.field("opt.gravity")[0]):
        model = robot.spec.compile()
        model.opt.gravity = gravity
        data = mujoco.MjData(model)
        data.qpos[:] += _POSE
        mujoco.mj_forward(model, data)
        efforts.append(data.qfrc_bias.copy())
    least = _FELT * float(np.abs(efforts[0]).max())
    return bool(np.abs(efforts[1] - efforts[0]).max() > least)


def _signal(column: str) -> str:
    return column.rpartition("/")[2]


def _with(recording: Recording, columns: Mapping[str, FloatArray]) -> Recording:
    return replace(recording, columns={**recording.columns, **columns})
