"""The rehearsal robot's drives: numbers of its servos and joints, for laws not MuJoCo's.

    model, drives = load_rig("leg.xml")              # or of a compiled model
    drives.hide(effect)                              # one that is a number of the drives
    position, speed = drives.read(angle, rate)       # by the encoders
    asked = drives.asked(targets, position, speed)
    spring = drives.springs(q)
    drag = drives.drag(qd)

The model's actuators supply the numbers and nothing else, in joint units whatever their gear.
Targets, q and qd have shape (..., n_joints) in the order of the model's actuators; drag and
friction are of every degree of freedom, shape (..., nv). What needs more than a number is in the
other modules of the hardware.
"""

from __future__ import annotations

import copy
from pathlib import Path
from typing import TypeAlias

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drive import Drive, read_drive
from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hidden import HiddenEffect

Array = NDArray[np.float64]

_BANDWIDTH = 20.0  # rad/s, of the loop that a computer closes around a drive without one
_DAMPED = 0.8  # of critical
_STUCK = 0.05  # rad, of error that overcomes dry friction
_ROW = 0.002  # s, from one command to the next


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
        InputError: the file does not load, or has actuators that are neither servos nor motors.
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
        kinds: which target each takes.
        gain: effort for each unit of target, shape (n_joints,), N·m/rad for a position.
        kp, kd: of the loop that takes a joint to a position, the drive's own or that of a computer
            beside it, shape (n_joints,), N·m/rad and N·m·s/rad.
        bias: constant effort, then effort for each rad of q and rad/s of qd, shape (3, n_joints).
        effort_range: lower and upper limit of the drive's effort, shape (2, n_joints), N·m.
        target_range: lower and upper limit of the targets, shape (2, n_joints), in their unit.
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
            model: the robot's model; every actuator must be a plain servo or motor of a hinge or
                slide joint.

        Raises:
            InputError: an actuator is something else, or there is none.
        """
        drives = _read(model)
        ids = model.actuator_trnid[:, 0]
        self.joints = tuple(model.joint(i).name for i in ids)
        self.qpos, self.dofs = model.jnt_qposadr[ids], model.jnt_dofadr[ids]
        gear = model.actuator_gear[:, 0]
        slope, offset, stiffness, damping = np.array(
            [(d.slope, d.offset, d.stiffness, d.damping) for d in drives]
        ).T
        self.kinds = tuple(drive.kind for drive in drives)
        per_control = gear * model.actuator_gainprm[:, 0]
        constant = np.where(
            model.actuator_biastype == int(mujoco.mjtBias.mjBIAS_AFFINE),
            gear * model.actuator_biasprm[:, 0],
            0.0,
        )
        self.gain: Array = per_control * slope
        self.bias: Array = np.stack([per_control * offset + constant, -stiffness, -damping])
        own = _range(model.actuator_forcelimited, model.actuator_forcerange) * gear
        own = np.sort(own, axis=0)
        joint = _range(model.jnt_actfrclimited[ids], model.jnt_actfrcrange[ids])
        self.effort_range: Array = np.stack([np.maximum(own, joint)[0], np.minimum(own, joint)[1]])
        controls = _range(model.actuator_ctrllimited, model.actuator_ctrlrange)
        self.target_range: Array = np.sort((controls - offset) / slope, axis=0)
        n = len(self.joints)
        self.strength, self.slope = np.ones((2, n))
        self.torque_bias, self.offset, self.stiffness, self.preload = np.zeros((4, n))
        self.command_delay: Array = model.actuator_delay.copy()
        self.sensor_delay = np.zeros(n)
        self.damping: Array = np.vstack([model.dof_damping, model.dof_dampingpoly.T])
        turns = np.abs(gear)
        self.damping[:, self.dofs] += np.vstack(
            [model.actuator_damping, model.actuator_dampingpoly.T]
        ) * np.stack([turns**2, turns**3, turns**4])
        self.frictionloss: Array = model.dof_frictionloss.copy()
        self.kp, self.kd = self._loop(model)

    @property
    def command_range(self) -> Array:
        """Lower and upper limit of what a computer sends, shape (2, n_joints)."""
        by_effort = np.array([kind == "effort" for kind in self.kinds])
        most = np.where(by_effort, self.effort_range, [[-np.inf], [np.inf]])
        return np.stack(
            [np.maximum(most[0], self.target_range[0]), np.minimum(most[1], self.target_range[1])]
        )

    def command(self, wanted: Array, position: Array, speed: Array) -> Array:
        """What to send so that the joints go to a position, in the unit of each drive's targets.

        Args:
            wanted: where they should be, shape (..., n_joints), rad.
            position: as the encoders read it, shape as `wanted`, rad.
            speed: as the encoders read it, shape as `wanted`, rad/s.
        """
        command = np.array(wanted)
        for j, kind in enumerate(self.kinds):
            missing = wanted[..., j] - position[..., j]
            if kind == "effort":
                command[..., j] = self.kp[j] * missing - self.kd[j] * speed[..., j]
            elif kind == "velocity":
                command[..., j] = _BANDWIDTH * missing
        return command

    def _loop(self, model: mujoco.MjModel) -> tuple[Array, Array]:
        """Gains of the loops that take the joints to positions."""
        moved, freely = model.dof_M0[self.dofs], 1.0 / model.dof_invweight0[self.dofs]
        drag, dry = self.damping[0, self.dofs], self.frictionloss[self.dofs]
        # As stiff as it takes to move, and no stiffer than what is read once a row allows.
        kp = moved * _BANDWIDTH**2 + drag * _BANDWIDTH + dry / _STUCK
        kp = np.minimum(kp, np.maximum(0.1 * freely / _ROW**2, 0.2 * drag / _ROW))
        kd = np.minimum(2 * _DAMPED * moved * _BANDWIDTH, 0.3 * freely / _ROW)
        servo = np.array([kind == "position" for kind in self.kinds])
        speedy = np.array([kind == "velocity" for kind in self.kinds])
        kp = np.where(servo, self.gain, np.where(speedy, self.gain * _BANDWIDTH, kp))
        return kp, np.where(servo | speedy, -self.bias[2], kd)

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


def _read(model: mujoco.MjModel) -> list[Drive]:
    """The drives of a model's actuators.

    Raises:
        InputError: one is none that simulated hardware can have.
    """
    if model.nu == 0:
        raise InputError(
            "the model has no actuators to simulate hardware from; give each driven joint a "
            '<position joint="..." kp="..." kv="..."/>.'
        )
    drives, seen = [], set[int]()
    for i in range(model.nactuator):
        name = model.actuator(i).name or f"number {i}"
        joint = int(model.actuator_trnid[i, 0])
        fault, drive = None, None
        if model.actuator_trntype[i] != int(mujoco.mjtTrn.mjTRN_JOINT):
            fault = "does not drive a joint"
        elif model.jnt_type[joint] < int(mujoco.mjtJoint.mjJNT_SLIDE):
            fault = "drives a joint that is neither a hinge nor a slide"
        elif not model.joint(joint).name:
            fault = "drives a joint that has no name"
        elif joint in seen:
            fault = f"is the second on joint {model.joint(joint).name!r}"
        else:
            drive = read_drive(model, i)
            if (
                drive is None
                or model.actuator_dyntype[i] != int(mujoco.mjtDyn.mjDYN_NONE)
                or min(drive.stiffness, drive.damping) < 0
            ):
                fault = "is neither a plain servo nor a plain motor"
        if fault or drive is None:
            raise InputError(
                f"actuator {name!r} {fault}; simulated hardware takes one <position>, <velocity> "
                "or <motor> for each driven joint, without a filter or an activation of its own. "
                "Rehearse with a copy of the model that has those."
            )
        seen.add(joint)
        drives.append(drive)
    return drives
