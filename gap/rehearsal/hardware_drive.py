"""The rehearsal robot's drives: servo, transmission and friction in numpy, none of it MuJoCo's.

    model, drives = load_rig("leg.xml")
    drives.hide(effect)
    commanded = drives.commanded(targets, q, qd)     # what the drive believes it delivers
    torque = drives.delivered(commanded, q)          # what the joint gets
    drag = drives.drag(qd)                           # viscous; Bristles holds the dry friction

The model's position actuators supply the numbers and nothing else. Targets, q and qd have shape
(..., n_joints) in the order of the model's actuators; drag and friction are of every degree of
freedom, shape (..., nv).
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import InputError
from walkerkit.gap.rehearsal.hidden import HiddenEffect

Array = NDArray[np.float64]

PRESLIDING: Final = 5e-4
"""How far a bristle bends before it slides, rad (m for slide joints)."""


def load_rig(path: str | Path) -> tuple[mujoco.MjModel, Drives]:
    """The model of an MJCF file and the drives that its actuators stand for.

    Args:
        path: the file.

    Returns:
        The model as it is, and its drives with nothing hidden.

    Raises:
        InputError: the file does not load, or has actuators that are no position servos.
    """
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        why = " ".join(str(error).split())
        raise InputError(f"{path}: the model does not load: {why}. Mend the file") from error
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
        self.strength = np.ones(n)
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
            effect: the effect, one that drives can have.

        Raises:
            InputError: the effect names a joint that has no drive.
            ValueError: the effect is one of the rigid bodies.
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
            case "velocity_gain":
                self.bias[2] -= at("delta_kd")
            case "torque_constant":
                self.strength *= 1.0 + at("alpha")
            case "effort_limit":
                limit = at("forcerange", elsewhere=np.inf)
                self.effort_range = np.clip(self.effort_range, -limit, limit)
            case "encoder_offset":
                self.offset += at("offset")
            case "torque_bias":
                self.torque_bias += at("bias")
            case "parallel_spring":
                self.stiffness += at("stiffness")
                self.preload += at("stiffness") * at("springref")
            case _:
                raise ValueError(f"{effect.effect} is hidden in the rigid bodies, not in a drive")

    def commanded(self, targets: Array, q: Array, qd: Array) -> Array:
        """What the drives command and report, before anything that they do not know of, N·m.

        Args:
            targets: position targets as they arrive at the drives, shape (..., n_joints), rad.
            q: true joint positions, shape (..., n_joints), rad.
            qd: true joint velocities, shape (..., n_joints), rad/s.
        """
        target = np.clip(targets, *self.target_range)
        constant, stiffness, damping = self.bias
        effort = self.gain * target + constant + stiffness * (q + self.offset) + damping * qd
        clipped: Array = np.clip(effort, *self.effort_range)
        return clipped

    def delivered(self, commanded: Array, q: Array) -> Array:
        """What the joints get from drives and springs, friction aside, shape as given, N·m.

        Args:
            commanded: what the drives command, shape (..., n_joints), N·m.
            q: true joint positions, shape (..., n_joints), rad.
        """
        return self.strength * commanded + self.torque_bias + self.preload - self.stiffness * q

    def drag(self, qd: Array) -> Array:
        """Viscous effort on every degree of freedom, against its motion, N·m.

        Args:
            qd: velocities of all degrees of freedom, shape (..., nv), rad/s.
        """
        linear, quadratic, cubic = self.damping
        speed = np.abs(qd)
        drag: Array = -qd * (linear + speed * (quadratic + speed * cubic))
        return drag


class Bristles:
    """Dry friction as bristles that bend and then slide (Dahl; LuGre with a constant g).

    F' = σ (q̇ − |q̇| F / Fc) with σ = Fc / PRESLIDING: F springs back while it sticks and settles at
    Fc sgn q̇ in sliding. Over a step of constant velocity that is solved exactly, so that no bristle
    is too stiff for the friction itself (Canudas de Wit et al., "A new model for control of systems
    with friction", 1995).
    """

    def __init__(self, frictionloss: Array, inertia: Array, step: float, n_sims: int) -> None:
        """Bristles at rest.

        Args:
            frictionloss: dry friction Fc, shape (nv,), N·m.
            inertia: what a bristle has to hold back, shape (nv,), kg·m².
            step: time between two updates, s.
            n_sims: number of simulations.
        """
        self._limit = frictionloss
        # The bristle's spring drives the inertia explicitly: keep its frequency below 1/step.
        bend = np.maximum(PRESLIDING, frictionloss * step**2 / inertia)
        self._renewal = bend / step
        self._force = np.zeros((n_sims, frictionloss.size))

    def torque(self, qd: Array) -> Array:
        """Effort of the bristles on the joints, one step after the last call, N·m.

        Args:
            qd: velocities over that step, shape (n_sims, nv), rad/s.

        Returns:
            Effort against the motion, shape (n_sims, nv).
        """
        stay = np.exp(-np.abs(qd) / self._renewal)
        self._force = stay * self._force + (1 - stay) * self._limit * np.sign(qd)
        return -self._force


def _range(limited: NDArray[np.uint8], bounds: Array) -> Array:
    """Lower and upper bounds, infinite where there are none, shape (2, n)."""
    unlimited = np.array([-np.inf, np.inf])
    return np.where(limited[:, None].astype(bool), bounds, unlimited).T


def _check_actuators(model: mujoco.MjModel) -> None:
    if model.nu == 0:
        raise InputError(
            "the model has no actuators to simulate hardware from; give each driven joint a "
            '<position joint="..." kp="..." kv="..."/>'
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
                '<position joint="..." kp="..." kv="..."/> for each driven joint, in joint units'
            )
        seen.add(joint)
