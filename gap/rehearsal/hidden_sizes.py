"""How large an effect is on a real robot: in proportion to its model and to what it does.

    usual = Usual.of(recordings, drives.joints)              # of a robot with nothing hidden
    sizes = joint_sizes("cogging", model, drives, usual, rng)    # {"amplitude": (n_joints,), ...}

Friction and bias go with the drives' effort limit, gains and viscosity with the servos', inertia
with the joints'; limits, stops and what a motor cannot do go with what the experiments ask for.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.rehearsal.hardware_drive import Drives

Array = NDArray[np.float64]

ASKED: Final = ("effort_limit", "torque_speed_limit", "supply_sag", "slew_limit", "end_stop")
"""Effects whose sizes go with what the experiments ask for."""

_SWING: Final = 0.5  # rad: the error that takes all effort of a servo without a limit
_REACH: Final = 1.0  # rad: the excursion of a joint of which nothing is known
_FEWEST, _MOST = 8, 40  # periods of a wave in 2π of pose


@dataclass(frozen=True, kw_only=True)
class Usual:
    """What the joints of a robot do in its experiments; arrays are (n_joints,).

    Attributes:
        effort: peak effort of the drives, N·m.
        velocity: peak velocity, rad/s.
        asked: peak velocity of the targets, or that of the joint where they are faster, rad/s.
        lower, upper: lowest and highest position, rad.
        power: peak of all joints' mechanical power together, W.
    """

    effort: Array
    velocity: Array
    asked: Array
    lower: Array
    upper: Array
    power: float

    @classmethod
    def of(cls, recordings: Sequence[Recording], joints: Sequence[str]) -> Usual:
        """What recordings of a robot with nothing hidden show.

        Args:
            recordings: experiments with positions, velocities and efforts.
            joints: names of the joints, in the order wanted.
        """

        def all_of(signal: str) -> Array:
            each = [
                np.stack([recording.columns[f"{joint}/{signal}"] for joint in joints], axis=1)
                for recording in recordings
            ]
            return np.concatenate(each)

        position, velocity, effort = map(all_of, ("position", "velocity", "effort"))
        fastest = np.abs(velocity).max(axis=0)
        # What has no targets in position moves as fast as it was asked to.
        asked = [
            np.inf
            if (target := recording.signal(joint, "position_target")) is None
            else np.abs(np.gradient(target, recording.time)).max()
            for recording in recordings
            for joint in joints
        ]
        return cls(
            effort=np.abs(effort).max(axis=0),
            velocity=fastest,
            asked=np.minimum(fastest, np.reshape(asked, (-1, len(joints))).max(axis=0)),
            lower=position.min(axis=0),
            upper=position.max(axis=0),
            power=float(np.abs(effort * velocity).sum(axis=1).max()),
        )


def joint_sizes(
    effect: str,
    model: mujoco.MjModel,
    drives: Drives,
    usual: Usual | None,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """A size of each of an effect's parameters at each joint.

    Args:
        effect: an effect of joints.
        model: the robot.
        drives: its drives, with nothing hidden.
        usual: what they do in the experiments; None only for effects that are not in `ASKED`.
        rng: source of the draw.

    Returns:
        Parameter to sizes, shape (n_joints,).
    """
    sign = rng.choice([-1.0, 1.0], len(drives.joints))
    if effect in ASKED:
        if usual is None:
            raise ValueError(f"{effect} is drawn in proportion to what the experiments ask for")
        return _asked(effect, drives, usual, rng)
    if effect not in _SIZES:
        raise ValueError(f"{effect} has no size at a joint")
    kp, inertia = drives.kp, model.dof_M0[drives.dofs]
    kd = np.where(drives.kd > 0, drives.kd, 2 * np.sqrt(kp * inertia))
    strongest = np.abs(drives.effort_range).max(axis=0)
    strongest = np.where(np.isfinite(strongest), strongest, kp * _SWING)
    if usual is not None:
        strongest = np.minimum(strongest, 3 * usual.effort)
    draw = _Draw(
        model=model,
        drives=drives,
        usual=usual,
        rng=rng,
        sign=sign,
        kp=kp,
        kd=kd,
        inertia=inertia,
        strongest=strongest,
    )
    return _SIZES[effect](draw)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Draw:
    """What sizes are in proportion to, and the source of the draw; arrays are (n_joints,).

    Attributes:
        model, drives, usual, rng: as `joint_sizes` has them.
        sign: of each joint's size, where it may be either.
        kp, kd: of the servos [N·m/rad; N·m·s/rad]; where there is no kd, that of critical damping.
        inertia: of the joints [kg·m²].
        strongest: effort of the drives [N·m].
    """

    model: mujoco.MjModel
    drives: Drives
    usual: Usual | None
    rng: np.random.Generator
    sign: Array
    kp: Array
    kd: Array
    inertia: Array
    strongest: Array

    def share(self, low: float, high: float) -> Array:
        """A number for each joint."""
        return self.rng.uniform(low, high, len(self.kp))

    def wave(self, amplitude: Array) -> dict[str, Array]:
        """A wave over the pose, of this amplitude."""
        periods = self.rng.integers(_FEWEST, _MOST, len(self.kp), endpoint=True).astype(float)
        return {"amplitude": amplitude, "periods": periods, "phase": self.share(-np.pi, np.pi)}


def _asymmetric_friction(d: _Draw) -> dict[str, Array]:
    """One way has more friction than the other."""
    more, less = d.share(0.03, 0.06) * d.strongest, d.share(0.1, 0.5)
    forward = np.where(d.sign > 0, more, less * more)
    return {"forward": forward, "backward": np.where(d.sign > 0, less * more, more)}


def _directional_efficiency(d: _Draw) -> dict[str, Array]:
    """A gear that is driven back loses more."""
    driving = d.share(0.7, 0.9)
    return {"driving": driving, "backdriving": 1.0 + d.share(0.3, 1.0) * (1.0 / driving - 1)}


def _series_elasticity(d: _Draw) -> dict[str, Array]:
    """The usual effort twists a gear by so many radians."""
    effort = d.strongest / 3 if d.usual is None else d.usual.effort
    return {"stiffness": effort / d.share(0.02, 0.06)}


def _parallel_spring(d: _Draw) -> dict[str, Array]:
    """A spring rests within a joint's range."""
    ids = d.model.dof_jntid[d.drives.dofs]
    lower, upper = np.where(d.model.jnt_limited[ids], d.model.jnt_range[ids].T, 0.0)
    return {
        "stiffness": d.share(0.017, 0.083) * d.kp,
        "springref": lower + d.share(0.1, 0.9) * (upper - lower),
    }


def _pose_bump(d: _Draw) -> dict[str, Array]:
    """A bump is somewhere between the usual poses."""
    low, high = (-_REACH, _REACH) if d.usual is None else (d.usual.lower, d.usual.upper)
    return {
        "effort": d.sign * d.share(0.05, 0.12) * d.strongest,
        "pose": low + d.share(0.25, 0.75) * (high - low),
        "reach": d.share(0.05, 0.12) * (high - low),
    }


_SIZES: Final[Mapping[str, Callable[[_Draw], dict[str, Array]]]] = {
    "viscous_friction": lambda d: {"damping": d.share(0.05, 0.2) * d.kd},
    "quadratic_drag": lambda d: {"drag": d.share(0.03, 0.1) * d.kd},
    "coulomb_friction": lambda d: {"frictionloss": d.share(0.01, 0.05) * d.strongest},
    "asymmetric_friction": _asymmetric_friction,
    "stribeck_friction": lambda d: {
        "breakaway": d.share(0.02, 0.06) * d.strongest,
        "velocity": d.share(0.1, 0.4),
    },
    "presliding_friction": lambda d: {
        "frictionloss": d.share(0.02, 0.06) * d.strongest,
        "bend": d.share(0.005, 0.02),
    },
    "load_dependent_friction": lambda d: {"coefficient": d.share(0.08, 0.25)},
    "directional_efficiency": _directional_efficiency,
    "pose_dependent_friction": lambda d: d.wave(d.share(0.03, 0.08) * d.strongest),
    "cogging": lambda d: d.wave(d.share(0.01, 0.04) * d.strongest),
    "torque_ripple": lambda d: d.wave(d.share(0.1, 0.3)),
    "kinematic_error": lambda d: d.wave(d.share(0.003, 0.012)),
    "armature": lambda d: {"armature": d.share(0.15, 0.6) * d.inertia.mean()},
    "backlash": lambda d: {"width": d.share(0.01, 0.03)},
    "series_elasticity": _series_elasticity,
    "position_gain": lambda d: {"delta_kp": d.sign * d.share(0.15, 0.35) * d.kp},
    # A servo without velocity gain has none to lose.
    "velocity_gain": lambda d: {
        "delta_kd": np.where(d.drives.bias[2] < 0, d.sign, 1) * d.share(0.25, 0.6) * d.kd
    },
    "torque_constant": lambda d: {"alpha": d.sign * d.share(0.1, 0.25)},
    "torque_bias": lambda d: {"bias": d.sign * d.share(0.017, 0.067) * d.strongest},
    "parallel_spring": _parallel_spring,
    "supply_voltage": lambda d: {"swing": d.share(0.1, 0.25)},
    "strength_drift": lambda d: {"rate": d.share(0.01, 0.03)},
    "actuator_lag": lambda d: {
        "time_constant": d.share(0.4, 1.0) * np.minimum(d.kd / d.kp, d.inertia / d.kd)
    },
    "loop_delay": lambda d: {"delay": d.share(0.4, 0.8) * (d.inertia / d.kd).min()},
    "command_delay": lambda d: {"delay": d.share(0.004, 0.016)},
    "sensor_delay": lambda d: {"delay": d.share(0.004, 0.016)},
    "sample_and_hold": lambda d: {"period": np.round(d.share(0.01, 0.03), 3)},
    "setpoint_filter": lambda d: {"time_constant": d.share(0.01, 0.04)},
    "controller_deadband": lambda d: {"width": d.share(0.008, 0.025)},
    "integral_action": lambda d: {"gain": d.share(0.5, 2.0) * d.kp},
    "velocity_filter": lambda d: {"time_constant": d.share(0.3, 0.8) * d.kd / d.kp},
    "encoder_offset": lambda d: {"offset": d.sign * d.share(0.03, 0.1)},
    "encoder_gain": lambda d: {"excess": d.sign * d.share(0.02, 0.08)},
    "random_pushes": lambda d: {"effort": d.share(0.05, 0.15) * d.strongest},
    "pose_bump": _pose_bump,
}
"""Effects of joints to the sizes of their parameters."""


def _asked(effect: str, drives: Drives, usual: Usual, rng: np.random.Generator) -> dict[str, Array]:
    """Sizes of the effects in `ASKED`."""
    n = len(drives.joints)

    def share(low: float, high: float) -> Array:
        return rng.uniform(low, high, n)

    match effect:
        case "effort_limit":
            return {"forcerange": share(0.5, 0.8) * usual.effort}
        case "torque_speed_limit":
            return {
                "saturation_effort": share(0.8, 1.3) * usual.effort,
                "velocity_limit": share(0.7, 1.2) * usual.velocity,
            }
        case "slew_limit":
            return {"rate": share(0.5, 0.85) * usual.asked}
        case "supply_sag":
            # At full power the drives have less left than they want.
            limit = np.where(np.isfinite(drives.effort_range[1]), drives.effort_range[1], 1e3)
            left = share(0.7, 1.0) * usual.effort / limit
            return {"sag": np.maximum(1.0 - left, 0.1).max(keepdims=True).repeat(n) / usual.power}
        case _:
            width = usual.upper - usual.lower
            cut, other = share(0.08, 0.2) * width, share(-0.2, 0.1) * width
            first = rng.uniform(size=n) < 0.5
            return {
                "lower": usual.lower + np.where(first, cut, other),
                "upper": usual.upper - np.where(first, other, cut),
            }
