"""Actuators that drive something else than one joint, or by a law that no target can be read into.

    mover = movers(model)[0]
    mover.through                 # "the tendon 'split'"
    mover.joints                  # ("left_finger", "right_finger")
    [d.kind for d in mover.inputs]    # ["position"], what `<actuator>/position_target` is for

A recording has a column of the actuator's own for each of these, since no joint's column can say
what it was sent.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco

from walkerkit.actuators.drive import (
    SCALAR_JOINTS,
    Drive,
    on_joint,
    read_inputs,
    uncomparable,
)
from walkerkit.gap.simulation.start import rest

_BALL = int(mujoco.mjtJoint.mjJNT_BALL)


@dataclass(frozen=True, kw_only=True)
class Mover:
    """One of them.

    Attributes:
        actuator: its id.
        name: its name in the model, may be empty.
        through: what it drives, in words.
        joints: names of the hinges and slides that it moves.
        inputs: the targets that it takes, none where no target can be read into its controls.
        why_not: what it is, where it takes none.
    """

    actuator: int
    name: str
    through: str
    joints: tuple[str, ...]
    inputs: tuple[Drive, ...]
    why_not: str = ""

    @property
    def called(self) -> str:
        """Its name, or its number where it has none."""
        return repr(self.name) if self.name else f"number {self.actuator}"

    @property
    def columns(self) -> tuple[str, ...]:
        """What a recording calls its targets."""
        return tuple(f"{self.name}/{drive.kind}_target" for drive in self.inputs)


def movers(model: mujoco.MjModel) -> tuple[Mover, ...]:
    """The actuators of a model that are not one hinge's or slide's, or take no target.

    Args:
        model: the compiled model.
    """
    moved = _moved(model)
    found = []
    for actuator in range(model.nactuator):
        inputs = read_inputs(model, actuator)
        if inputs and on_joint(model, actuator) is not None:
            continue
        found.append(
            Mover(
                actuator=actuator,
                name=model.actuator(actuator).name,
                through=_through(model, actuator),
                joints=moved[actuator],
                inputs=inputs,
                why_not="" if inputs else uncomparable(model, actuator),
            )
        )
    return tuple(found)


def named_inputs(model: mujoco.MjModel) -> dict[str, tuple[Drive, ...]]:
    """The targets that the actuators with a name take, by that name.

    Args:
        model: the compiled model.
    """
    every = ((model.actuator(a).name, read_inputs(model, a)) for a in range(model.nactuator))
    return {name: inputs for name, inputs in every if name and inputs}


def _moved(model: mujoco.MjModel) -> list[tuple[str, ...]]:
    """Names of the hinges and slides on which each actuator has a grip somewhere."""
    data = rest(model)
    mujoco.mj_fwdPosition(model, data)
    found = []
    for actuator in range(model.nactuator):
        first = int(model.actuator_outadr[actuator])
        dofs: list[int] = []
        for output in range(first, first + int(model.actuator_outnum[actuator])):
            start, n = int(data.moment_rowadr[output]), int(data.moment_rownnz[output])
            dofs += data.moment_colind[start : start + n].tolist()
        joints = sorted({int(joint) for joint in model.dof_jntid[dofs]})
        scalar = (j for j in joints if model.jnt_type[j] in SCALAR_JOINTS)
        found.append(tuple(model.joint(j).name for j in scalar if model.joint(j).name))
    return found


def _through(model: mujoco.MjModel, actuator: int) -> str:
    """What an actuator drives, in words."""
    kind, target = int(model.actuator_trntype[actuator]), int(model.actuator_trnid[actuator, 0])
    match mujoco.mjtTrn(kind):
        case mujoco.mjtTrn.mjTRN_TENDON:
            what, name = "tendon", model.tendon(target).name
        case mujoco.mjtTrn.mjTRN_SITE:
            what, name = "site", model.site(target).name
        case mujoco.mjtTrn.mjTRN_SLIDERCRANK:
            what, name = "slider-crank", model.site(target).name
        case mujoco.mjtTrn.mjTRN_BODY:
            what, name = "body", model.body(target).name
        case _:
            ball = model.jnt_type[target] == _BALL
            what = "ball joint" if ball else "joint"
            name = model.joint(target).name
    return f"the {what} {name!r}" if name else f"a {what} without a name"
