"""An existing actuator, read in joint units.

For a joint driven through a scalar transmission of gear G, MuJoCo's affine actuators make

    joint effort = G (g0 ctrl + b0 + b1 G q + b2 G q̇)

(MuJoCo XML reference, `actuator/general`). Solved for the control that asks for a target in rad,
rad/s or N·m, this also serves dm_control's scaled actuators, whose control is normalised:

    drive = drives_of_joint(model, joint_id)[0]
    data.ctrl[drive.ctrl] = drive.control(0.3)         # 0.3 rad
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

TargetKind = Literal["position", "velocity", "effort"]
Number = TypeVar("Number", float, NDArray[np.float64])

_CTRL_IS_POSITION, _CTRL_IS_VELOCITY = 1, 2  # mjModel.actuator_ctrlspec of <position>, <velocity>
_JOINT_TRANSMISSIONS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
_BIASES = (int(mujoco.mjtBias.mjBIAS_NONE), int(mujoco.mjtBias.mjBIAS_AFFINE))
_DYNAMICS = (
    int(mujoco.mjtDyn.mjDYN_NONE),
    int(mujoco.mjtDyn.mjDYN_FILTER),
    int(mujoco.mjtDyn.mjDYN_FILTEREXACT),
)


@dataclass(frozen=True, kw_only=True)
class Drive:
    """One actuator of one joint.

    Attributes:
        actuator: the actuator's id.
        ctrl: index of its control, which is not the id behind an actuator with several inputs.
        kind: which target it takes.
        slope: control per unit of target.
        offset: control at a target of zero.
        stiffness: −∂(joint effort)/∂q [N·m/rad, or N/m].
        damping: −∂(joint effort)/∂q̇ [N·m·s/rad, or N·s/m].
        in_joint_units: the control is the target itself (times the gear), so that a constant bias
            of the actuator is effort and not an offset of the target.
        late: how old targets are that reach it, beside what MuJoCo's own delay makes of them [s].
        in_python: its law runs in Python, and MuJoCo's actuator is a motor that makes its effort;
            `ctrl` is then no control of MuJoCo's.
    """

    actuator: int
    ctrl: int
    kind: TargetKind
    slope: float
    offset: float
    stiffness: float
    damping: float
    in_joint_units: bool
    late: float = 0.0
    in_python: bool = False

    def control(self, target: Number) -> Number:
        """The control that asks for `target` [rad, rad/s or N·m; m, m/s or N on a slide joint]."""
        return self.slope * target + self.offset


def drives_of_joint(model: mujoco.MjModel, joint: int) -> tuple[Drive, ...]:
    """The actuators of a joint whose law is affine, in the order of the model.

    Args:
        model: the compiled model.
        joint: joint id.

    Returns:
        The drives; actuators with another law (muscles, dcmotor, activation that integrates) are
        left out, since no target in joint units can be read into their control.
    """
    drives = (
        read_drive(model, actuator)
        for actuator in range(model.nactuator)
        if model.actuator_trntype[actuator] in _JOINT_TRANSMISSIONS
        and model.actuator_trnid[actuator, 0] == joint
    )
    return tuple(drive for drive in drives if drive is not None)


def read_drive(model: mujoco.MjModel, actuator: int) -> Drive | None:
    """An actuator in units of what it drives, or None where its law is not affine.

    Args:
        model: the compiled model.
        actuator: the actuator's id; its transmission has a scalar gear.
    """
    if (
        model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_gainprm[actuator, 0] != 0
        and model.actuator_gear[model.actuator_outadr[actuator], 0] != 0
        and model.actuator_biastype[actuator] in _BIASES
        and model.actuator_dyntype[actuator] in _DYNAMICS
    ):
        return _drive(model, actuator)
    return None


def _drive(model: mujoco.MjModel, actuator: int) -> Drive:
    gain = float(model.actuator_gainprm[actuator, 0])
    gear = float(model.actuator_gear[model.actuator_outadr[actuator], 0])
    b0 = b1 = b2 = 0.0
    if model.actuator_biastype[actuator] == mujoco.mjtBias.mjBIAS_AFFINE:
        b0, b1, b2 = (float(b) for b in model.actuator_biasprm[actuator, :3])
    unit = int(model.actuator_ctrlspec[actuator])
    kind: TargetKind
    if b1 != 0:
        kind, slope, offset = "position", -b1 * gear / gain, -b0 / gain
        in_joint_units = unit == _CTRL_IS_POSITION
    elif b2 != 0:
        kind, slope, offset = "velocity", -b2 * gear / gain, -b0 / gain
        in_joint_units = unit == _CTRL_IS_VELOCITY
    else:
        kind, slope, offset = "effort", 1.0 / (gear * gain), 0.0
        in_joint_units = False
    if in_joint_units:
        # The control is the target itself, and a constant bias is effort, not an offset of it.
        slope, offset = gear, 0.0
    return Drive(
        actuator=actuator,
        ctrl=int(model.actuator_ctrladr[actuator]),
        kind=kind,
        slope=slope,
        offset=offset,
        stiffness=-b1 * gear * gear,
        damping=-b2 * gear * gear,
        in_joint_units=in_joint_units,
    )
