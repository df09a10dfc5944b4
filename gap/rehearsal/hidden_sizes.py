"""How large an effect is on a real robot: in proportion to its model and to what it does.

    usual = Usual.of(recordings, drives.joints)              # of a robot with nothing hidden
    sizes = joint_sizes("cogging", model, drives, usual, rng)    # {"amplitude": (n_joints,), ...}

Friction and bias go with the drives' effort limit, gains and viscosity with the servos', inertia
with the joints'; limits, stops and what a motor cannot do go with what the experiments ask for.
"""

from __future__ import annotations

from collections.abc import Sequence
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
    n = len(drives.joints)
    sign = rng.choice([-1.0, 1.0], n)

    def share(low: float, high: float) -> Array:
        return rng.uniform(low, high, n)

    def wave(amplitude: Array) -> dict[str, Array]:
        periods = rng.integers(_FEWEST, _MOST, n, endpoint=True).astype(float)
        return {"amplitude": amplitude, "periods": periods, "phase": share(-np.pi, np.pi)}

    if effect in ASKED:
        if usual is None:
            raise ValueError(f"{effect} is drawn in proportion to what the experiments ask for")
        return _asked(effect, drives, usual, rng)
    kp, inertia = drives.kp, model.dof_M0[drives.dofs]
    kd = np.where(drives.kd > 0, drives.kd, 2 * np.sqrt(kp * inertia))
    strongest = np.abs(drives.effort_range).max(axis=0)
    strongest = np.where(np.isfinite(strongest), strongest, kp * _SWING)
    if usual is not None:
        strongest = np.minimum(strongest, 3 * usual.effort)
    match effect:
        case "viscous_friction":
            return {"damping": share(0.05, 0.2) * kd}
        case "quadratic_drag":
            return {"drag": share(0.03, 0.1) * kd}
        case "coulomb_friction":
            return {"frictionloss": share(0.01, 0.05) * strongest}
        case "asymmetric_friction":
            more, less = share(0.03, 0.06) * strongest, share(0.1, 0.5)
            forward = np.where(sign > 0, more, less * more)
            return {"forward": forward, "backward": np.where(sign > 0, less * more, more)}
        case "stribeck_friction":
            return {"breakaway": share(0.02, 0.06) * strongest, "velocity": share(0.1, 0.4)}
        case "presliding_friction":
            return {"frictionloss": share(0.02, 0.06) * strongest, "bend": share(0.005, 0.02)}
        case "load_dependent_friction":
            return {"coefficient": share(0.08, 0.25)}
        case "directional_efficiency":
            driving = share(0.7, 0.9)
            return {"driving": driving, "backdriving": 1.0 + share(0.3, 1.0) * (1.0 / driving - 1)}
        case "pose_dependent_friction":
            return wave(share(0.03, 0.08) * strongest)
        case "cogging":
            return wave(share(0.01, 0.04) * strongest)
        case "torque_ripple":
            return wave(share(0.1, 0.3))
        case "kinematic_error":
            return wave(share(0.003, 0.012))
        case "armature":
            return {"armature": share(0.15, 0.6) * inertia.mean()}
        case "backlash":
            return {"width": share(0.01, 0.03)}
        case "series_elasticity":
            effort = strongest / 3 if usual is None else usual.effort
            return {"stiffness": effort / share(0.02, 0.06)}
        case "position_gain":
            return {"delta_kp": sign * share(0.15, 0.35) * kp}
        case "velocity_gain":
            # A servo without velocity gain has none to lose.
            return {"delta_kd": np.where(drives.bias[2] < 0, sign, 1) * share(0.25, 0.6) * kd}
        case "torque_constant":
            return {"alpha": sign * share(0.1, 0.25)}
        case "torque_bias":
            return {"bias": sign * share(0.017, 0.067) * strongest}
        case "parallel_spring":
            ids = model.dof_jntid[drives.dofs]
            lower, upper = np.where(model.jnt_limited[ids], model.jnt_range[ids].T, 0.0)
            return {
                "stiffness": share(0.017, 0.083) * kp,
                "springref": lower + share(0.1, 0.9) * (upper - lower),
            }
        case "supply_voltage":
            return {"swing": share(0.1, 0.25)}
        case "strength_drift":
            return {"rate": share(0.01, 0.03)}
        case "actuator_lag":
            return {"time_constant": share(0.4, 1.0) * np.minimum(kd / kp, inertia / kd)}
        case "loop_delay":
            return {"delay": share(0.4, 0.8) * (inertia / kd).min()}
        case "command_delay" | "sensor_delay":
            return {"delay": share(0.004, 0.016)}
        case "sample_and_hold":
            return {"period": np.round(share(0.01, 0.03), 3)}
        case "setpoint_filter":
            return {"time_constant": share(0.01, 0.04)}
        case "controller_deadband":
            return {"width": share(0.008, 0.025)}
        case "integral_action":
            return {"gain": share(0.5, 2.0) * kp}
        case "velocity_filter":
            return {"time_constant": share(0.3, 0.8) * kd / kp}
        case "encoder_offset":
            return {"offset": sign * share(0.03, 0.1)}
        case "encoder_gain":
            return {"excess": sign * share(0.02, 0.08)}
        case "random_pushes":
            return {"effort": share(0.05, 0.15) * strongest}
        case "pose_bump":
            low, high = (-_REACH, _REACH) if usual is None else (usual.lower, usual.upper)
            return {
                "effort": sign * share(0.05, 0.12) * strongest,
                "pose": low + share(0.25, 0.75) * (high - low),
                "reach": share(0.05, 0.12) * (high - low),
            }
    raise ValueError(f"{effect} has no size at a joint")


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
