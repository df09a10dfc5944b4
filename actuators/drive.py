"""An existing actuator, read in joint units.

For a joint driven through a scalar transmission of gear G, MuJoCo's affine actuators make

    joint effort = G (g0 ctrl + b0 + b1 G q + b2 G q̇)

(MuJoCo XML reference, `actuator/general`). Solved for the control that asks for a target in rad,
rad/s or N·m, this also serves dm_control's scaled actuators, whose control is normalised:

    drive = drives_of_joint(model, joint_id)[0]
    data.ctrl[drive.ctrl] = drive.control(0.3)         # 0.3 rad

MuJoCo's `<dcmotor>` and `<pid>` take targets as well, one of each kind for each of their inputs:
`read_inputs` reads those, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeVar

import mujoco
import numpy as np
from numpy.typing import NDArray

TargetKind = Literal["position", "velocity", "effort", "voltage"]
Number = TypeVar("Number", float, NDArray[np.float64])

_CTRL_IS_POSITION, _CTRL_IS_VELOCITY = 1, 2  # mjModel.actuator_ctrlspec of <position>, <velocity>
# Bits of mjModel.actuator_ctrlspec, in the order of the inputs that an actuator with several has.
_INPUTS: tuple[tuple[int, TargetKind], ...] = (
    (_CTRL_IS_POSITION, "position"),
    (_CTRL_IS_VELOCITY, "velocity"),
    (4, "effort"),
    (8, "voltage"),
)
JOINT_TRANSMISSIONS = (int(mujoco.mjtTrn.mjTRN_JOINT), int(mujoco.mjtTrn.mjTRN_JOINTINPARENT))
SCALAR_JOINTS = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
_SCALAR_GEARS = (int(mujoco.mjtTrn.mjTRN_TENDON), int(mujoco.mjtTrn.mjTRN_SLIDERCRANK))
_PLUGGED = {  # laws with inputs of their own
    int(mujoco.mjtGain.mjGAIN_DCMOTOR): "dcmotor",
    int(mujoco.mjtGain.mjGAIN_PID): "pid",
}
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
        law: `affine`, `dcmotor` or `pid`; stiffness and damping are those of an affine law, else 0.
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
    law: Literal["affine", "dcmotor", "pid"] = "affine"

    def control(self, target: Number) -> Number:
        """The control that asks for a target.

        Args:
            target: [rad, rad/s or N·m; m, m/s or N on a slide joint; V for a voltage].
        """
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
        if on_joint(model, actuator) == joint
    )
    return tuple(drive for drive in drives if drive is not None)


def inputs_of_joint(model: mujoco.MjModel, joint: int) -> tuple[Drive, ...]:
    """What the `<dcmotor>` and `<pid>` actuators of a joint take, in the order of the model.

    Args:
        model: the compiled model.
        joint: joint id.
    """
    return tuple(
        drive
        for actuator in range(model.nactuator)
        if on_joint(model, actuator) == joint
        for drive in read_inputs(model, actuator)
        if drive.law != "affine"
    )


def on_joint(model: mujoco.MjModel, actuator: int) -> int | None:
    """The hinge or slide joint that an actuator drives and nothing else, or None.

    Args:
        model: the compiled model.
        actuator: the actuator's id.
    """
    joint = int(model.actuator_trnid[actuator, 0])
    if model.actuator_trntype[actuator] not in JOINT_TRANSMISSIONS:
        return None
    return joint if model.jnt_type[joint] in SCALAR_JOINTS else None


def read_inputs(model: mujoco.MjModel, actuator: int) -> tuple[Drive, ...]:
    """The targets that an actuator takes, one for each of its inputs.

    Args:
        model: the compiled model.
        actuator: the actuator's id.

    Returns:
        None of them where no target can be read into its controls: see `uncomparable`.
    """
    drive = read_drive(model, actuator)
    if drive is not None:
        return (drive,)
    law = _PLUGGED.get(int(model.actuator_gaintype[actuator]))
    gear = _gear(model, actuator)
    spec, first = int(model.actuator_ctrlspec[actuator]), int(model.actuator_ctrladr[actuator])
    kinds = [kind for bit, kind in _INPUTS if spec & bit]
    if law is None or gear == 0 or len(kinds) != model.actuator_ctrlnum[actuator]:
        return ()
    power: dict[TargetKind, int] = {"effort": -1, "voltage": 0}
    return tuple(
        Drive(
            actuator=actuator,
            ctrl=first + place,
            kind=kind,
            slope=gear ** power.get(kind, 1),
            offset=0.0,
            stiffness=0.0,
            damping=0.0,
            in_joint_units=True,
            law="dcmotor" if law == "dcmotor" else "pid",
        )
        for place, kind in enumerate(kinds)
    )


def uncomparable(model: mujoco.MjModel, actuator: int) -> str:
    """Why no target can be read into the controls of an actuator, as what it "is".

    Args:
        model: the compiled model.
        actuator: the actuator's id; one of which `read_inputs` finds nothing.
    """
    dynamics, gain = int(model.actuator_dyntype[actuator]), int(model.actuator_gaintype[actuator])
    if mujoco.mjtDyn.mjDYN_MUSCLE == dynamics or mujoco.mjtGain.mjGAIN_MUSCLE == gain:
        return "a muscle, whose control is an excitation"
    if mujoco.mjtDyn.mjDYN_INTEGRATOR == dynamics:
        return "one that integrates its control, as <intvelocity> does, to a state that no log has"
    if mujoco.mjtGain.mjGAIN_AFFINE == gain:
        return "one whose gain depends on the motion, as that of a <damper>"
    if gain in _PLUGGED:
        inputs = int(model.actuator_ctrlnum[actuator])
        return f"a {_PLUGGED[gain]} with {inputs} inputs that are not targets of its joint"
    if model.actuator_gainprm[actuator, 0] == 0 or _gear(model, actuator) == 0:
        return "one without gain or gear, which makes nothing of its control"
    return "one whose law is not affine in its control"


def read_drive(model: mujoco.MjModel, actuator: int) -> Drive | None:
    """An actuator in units of what it drives, or None where its law is not affine.

    Args:
        model: the compiled model.
        actuator: the actuator's id. Where its gear is a direction, as on a site, its targets are
            along that.
    """
    if (
        model.actuator_gaintype[actuator] == mujoco.mjtGain.mjGAIN_FIXED
        and model.actuator_gainprm[actuator, 0] != 0
        and _gear(model, actuator) != 0
        and model.actuator_biastype[actuator] in _BIASES
        and model.actuator_dyntype[actuator] in _DYNAMICS
    ):
        return _drive(model, actuator)
    return None


def _gear(model: mujoco.MjModel, actuator: int) -> float:
    """The gear of a joint, tendon or slider-crank; one where it is a direction."""
    if on_joint(model, actuator) is None and model.actuator_trntype[actuator] not in _SCALAR_GEARS:
        return 1.0
    return float(model.actuator_gear[model.actuator_outadr[actuator], 0])


def _drive(model: mujoco.MjModel, actuator: int) -> Drive:
    gain = float(model.actuator_gainprm[actuator, 0])
    gear = _gear(model, actuator)
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
