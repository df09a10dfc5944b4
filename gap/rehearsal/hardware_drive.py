"""The rehearsal robot's drives: numbers of its servos and joints, for laws not MuJoCo's.

    model, drives = load_rig("leg.xml")              # or of a compiled model
    drives.hide(effect)                              # one that is a number of the drives
    position, speed = drives.read(angle, rate)       # by the encoders
    asked = drives.asked(targets, position, speed)
    spring = drives.springs(q)
    drag = drives.drag(qd)

The model's position actuators supply the numbers and nothing else. Targets, q and qd have shape
(..., n_joints) in the order of the model's actuators; drag and friction are of every degree of
freedom, shape (..., nv). What needs more than a number is in the other modules of the hardware.
"""

from __future__ import annotations

import copy
from pathlib import Path
from typing import TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hidden import HiddenEffect

Array = NDArray[np.float64]


Source: TypeAlias = str | Path | mujoco.MjSpec | mujoco.MjModel
"""A robot: its MJCF, the spec of one, or what was compiled of that."""


def spec_of(source: str | Path | mujoco.MjSpec) -> mujoco.MjSpec:
    """The spec of a robot, which is not to be written to.

    Raises:
        InputError: the file does not load.
    """
    if isinstance(source, mujoco.MjSpec):
        return source
    try:
        return mujoco.MjSpec.from_file(str(source))
    except ValueError as error:
        why = " ".join(str(error).split())
        raise InputError(f"{source}: the model does not load: {why}. Mend the file") from error


def load_rig(source: Source) -> tuple[mujoco.MjModel, Drives]:
    """The model of an MJCF file and the drives that its actuators stand for.

    Args:
        source: the file, its spec, or what was compiled of one, which is left as it is.

    Returns:
        The model as it is, and its drives with nothing hidden.

    Raises:
        InputError: the file does not load, or has actuators that are no position servos.
    """
    if isinstance(source, mujoco.MjModel):
        model = copy.copy(source)
        return model, Drives(model)
    if isinstance(source, mujoco.MjSpec):
        model = source.copy().compile()
        return model, Drives(model)
    try:
        model = mujoco.MjModel.from_xml_path(str(source))
    except ValueError as error:
        why = " ".join(str(error).split())
        raise InputError(f"{source}: the model does not load: {why}. Mend the file") from error
    return model, Drives(model)


class Drives:
    """Every drive of one robot, with what is hidden in it.

    Attributes:
        joints: names of the driven joints, in the order of the model's actuators.
        qpos: their addresses in qpos, shape (n_joints,).
        dofs: their addresses in qvel, shape (n_joints,).
        gain: effort for each radian of target, shape (n_joints,), N·m/rad.
        bias: constant effort, then effort for each rad of q and rad/s of qd, shape (3, n_joints).
        effort_range: lower and upper limit of the drive's effort, shape (2, n_joints), N·m.
        target_range: lower and upper limit of the targets, shape (2, n_joints), rad.
        strength: delivered over commanded effort, shape (n_joints,).
        torque_bias: constant effort that is delivered on top, shape (n_joints,), N·m.
        offset: what the encoder reads too much, shape (n_joints,), rad.
        slope: of the encoder's reading over the angle, shape (n_joints,).
        command_delay: of the targets, shape (n_joints,), s.
        sensor_delay: of the logged position and velocity, shape (n_joints,), s.
        stiffness: of springs beside the drives, shape (n_joints,), N·m/rad.
        preload: effort of those springs at q = 0, shape (n_joints,), N·m.
        damping: drag for qd, qd|qd| and qd³, shape (3, nv).
        frictionloss: dry friction, shape (nv,), N·m.
    """

    def __init__(self, model: mujoco.MjModel) -> None:
        """Reads the numbers of the model's drives and joints.

        Args:
            model: the robot's model; every actuator must be a plain position servo of a hinge or
                slide joint.

        Raises:
            InputError: an actuator is something else, or there is none.
        """
        _check_actuators(model)
        ids = model.actuator_trnid[:, 0]
        self.joints = tuple(model.joint(i).name for i in ids)
        self.qpos, self.dofs = model.jnt_qposadr[ids], model.jnt_dofadr[ids]
        self.gain: Array = model.actuator_gainprm[:, 0].copy()
        self.bias: Array = model.actuator_biasprm[:, :3].T.copy()
        own = _range(model.actuator_forcelimited, model.actuator_forcerange)
        joint = _range(model.jnt_actfrclimited[ids], model.jnt_actfrcrange[ids])
        self.effort_range: Array = np.stack([np.maximum(own, joint)[0], np.minimum(own, joint)[1]])
        self.target_range = _range(model.actuator_ctrllimited, model.actuator_ctrlrange)
        n = len(self.joints)
        self.strength, self.slope = np.ones((2, n))
        self.torque_bias, self.offset, self.stiffness, self.preload = np.zeros((4, n))
        self.command_delay: Array = model.actuator_delay.copy()
        self.sensor_delay = np.zeros(n)
        self.damping: Array = np.vstack([model.dof_damping, model.dof_dampingpoly.T])
        self.damping[:, self.dofs] += np.vstack(
            [model.actuator_damping, model.actuator_dampingpoly.T]
        )
        self.frictionloss: Array = model.dof_frictionloss.copy()

    def hide(self, effect: HiddenEffect) -> None:
        """Takes an effect in, on top of what is hidden already.

        Args:
            effect: the effect; one that is no number of the drives is left alone.

        Raises:
            InputError: the effect names a joint that has no drive.
        """

        def at(parameter: str, elsewhere: float = 0.0) -> Array:
            return effect.spread(parameter, self.joints, elsewhere=elsewhere)

        match effect.effect:
            case "viscous_friction":
                self.damping[0, self.dofs] += at("damping")
            case "coulomb_friction":
                self.frictionloss[self.dofs] += at("frictionloss")
            case "command_delay":
                self.command_delay += at("delay")
            case "sensor_delay":
                self.sensor_delay += at("delay")
            case "position_gain":
                self.gain += at("delta_kp")
                self.bias[1] -= at("delta_kp")
            case "quadratic_drag":
                self.damping[1, self.dofs] += at("drag")
            case "velocity_gain":
                self.bias[2] -= at("delta_kd")
            case "torque_constant":
                self.strength *= 1.0 + at("alpha")
            case "effort_limit":
                limit = at("forcerange", elsewhere=np.inf)
                self.effort_range = np.clip(self.effort_range, -limit, limit)
            case "encoder_offset":
                self.offset += at("offset")
            case "encoder_gain":
                self.slope *= 1.0 + at("excess")
            case "torque_bias":
                self.torque_bias += at("bias")
            case "parallel_spring":
                self.stiffness += at("stiffness")
                self.preload += at("stiffness") * at("springref")

    def read(self, angle: Array, speed: Array) -> tuple[Array, Array]:
        """What the encoders read.

        Args:
            angle: true angles, shape (..., n_joints), rad.
            speed: true speeds, shape (..., n_joints), rad/s.
        """
        return self.slope * angle + self.offset, self.slope * speed

    def asked(self, targets: Array, position: Array, speed: Array) -> Array:
        """What the servos ask for before any limit, N·m.

        Args:
            targets: position targets, shape (..., n_joints), rad.
            position: as the encoders read it, shape (..., n_joints), rad.
            speed: as the encoders read it, shape (..., n_joints), rad/s.
        """
        constant, stiffness, damping = self.bias
        asked: Array = self.gain * targets + constant + stiffness * position + damping * speed
        return asked

    def springs(self, q: Array) -> Array:
        """Effort of the springs beside the drives, N·m.

        Args:
            q: true joint positions, shape (..., n_joints), rad.
        """
        return self.preload - self.stiffness * q

    def drag(self, qd: Array) -> Array:
        """Viscous effort on every degree of freedom, against its motion, N·m.

        Args:
            qd: velocities of all degrees of freedom, shape (..., nv), rad/s.
        """
        linear, quadratic, cubic = self.damping
        drag: Array = -qd * linear
        if self.damping[1:].any():
            drag -= qd * (speed := np.abs(qd)) * (quadratic + speed * cubic)
        return drag


def limited(values: Array, low: Array, high: Array) -> Array:
    """Values no lower and no higher than they may be; `numpy.clip` takes four times as long."""
    bounded: Array = np.minimum(np.maximum(values, low), high)
    return bounded


def _range(is_limited: NDArray[np.uint8], bounds: Array) -> Array:
    """Lower and upper bounds, infinite where there are none, shape (2, n)."""
    unlimited = np.array([-np.inf, np.inf])
    return np.where(is_limited[:, None].astype(bool), bounds, unlimited).T


def _check_actuators(model: mujoco.MjModel) -> None:
    if model.nu == 0:
        raise InputError(
            "the model has no actuators to simulate hardware from; give each driven joint a "
            '<position joint="..." kp="..." kv="..."/>.'
        )
    seen: set[int] = set()
    for i in range(model.nu):
        name = model.actuator(i).name or f"number {i}"
        joint = int(model.actuator_trnid[i, 0])
        fault = None
        if model.actuator_trntype[i] != int(mujoco.mjtTrn.mjTRN_JOINT):
            fault = "does not drive a joint"
        elif model.jnt_type[joint] < int(mujoco.mjtJoint.mjJNT_SLIDE):
            fault = "drives a joint that is neither a hinge nor a slide"
        elif not model.joint(joint).name:
            fault = "drives a joint that has no name"
        elif joint in seen:
            fault = f"is the second on joint {model.joint(joint).name!r}"
        elif model.actuator_gear[i, 0] != 1:
            fault = f"has gear {model.actuator_gear[i, 0]:g} where 1 is needed"
        elif (
            model.actuator_dyntype[i] != int(mujoco.mjtDyn.mjDYN_NONE)
            or model.actuator_gaintype[i] != int(mujoco.mjtGain.mjGAIN_FIXED)
            or model.actuator_biastype[i] != int(mujoco.mjtBias.mjBIAS_AFFINE)
            or model.actuator_gainprm[i, 0] <= 0
            or model.actuator_biasprm[i, 1] >= 0
        ):
            fault = "is not a plain position servo"
        if fault:
            raise InputError(
                f"actuator {name!r} {fault}; simulated hardware takes one "
                '<position joint="..." kp="..." kv="..."/> for each driven joint, in joint units: '
                "it sends positions, and has no controller for what takes efforts or speeds."
            )
        seen.add(joint)
