"""The drivetrain laws of all variants of a robot in all segments, as a replay needs them.

    laws = Laws(model, joints, fields, trials, n_segments)
    ctrl, ahead = laws.controlled(ctrl, time)   # what the controllers make of the targets
    if laws.runs:                               # something is left to be run step by step
        rollout, changed = rollout_with_laws(batch, state, laws=laws, ctrl=..., time=..., ...)
    else:
        effort, friction = laws.constant()      # what the others add to every step

Laws of the controller that see nothing but targets are run over all of these beforehand, and what
others add to every step alike is added to the model, so that the simulation itself runs natively
where there are no others.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet
from copy import copy
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.actuators.drivetrain import DrivetrainLaw, LawBank, Step, SupplyVoltage, in_order
from walkerkit.gap.simulation.drive_forces import DRIVE_FIELDS, DriveForces
from walkerkit.gap.simulation.programs_at_work import ProgramsAtWork
from walkerkit.gap.simulation.robot import Joint
from walkerkit.gap.simulation.trials import Trials

FloatArray = NDArray[np.float64]
Numbers = dict[str, FloatArray]
_Law = tuple[type[DrivetrainLaw], Numbers]


class Laws:
    """Laws and drives of some joints, in n_variants · n_segments simulations.

    Args:
        model: the model.
        joints: the joints.
        fields: model fields of which each variant has its own, (n_variants, *shape).
        trials: the variants.
        n_segments: segments of each.
        columns: controls that the logs have targets for.

    Attributes:
        joints: the joints.
        programs: laws in Python of drives, or None where there is none.
        forces: their drives.
        of_targets: the laws that are run beforehand, each with its parameters.
        stepwise: the others.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        joints: Sequence[Joint],
        fields: Mapping[str, NDArray[Any]],
        trials: Trials,
        n_segments: int,
        columns: AbstractSet[int] = frozenset(),
    ):
        self.joints = tuple(joints)
        self.dt = float(model.opt.timestep)
        self.shape = (trials.n * n_segments, len(joints))
        repeated = {
            name: np.repeat(values, n_segments, axis=0)
            for name, values in fields.items()
            if name in DRIVE_FIELDS
        }
        self.programs = (
            ProgramsAtWork(trials, n_segments, columns, repeated) if trials.robot.programs else None
        )
        number = None if self.programs is None else self.programs.number
        self.forces = DriveForces(model, joints, repeated, self.shape[0], number)
        names = [joint.name for joint in joints]
        found: dict[type[DrivetrainLaw], Numbers] = {}
        for (law, joint, name), values in trials.laws.items():
            if joint in names:
                neutral = {p: np.full(self.shape, law.neutral[p]) for p in law.neutral}
                found.setdefault(law, neutral)[name][:, names.index(joint)] = np.repeat(
                    values, n_segments
                )
        # In the order in which those of a stage act.
        each = [(law, found[law]) for law in in_order(found) if law.acting(found[law]).any()]
        self.of_targets = [(law, p) for law, p in each if law.targets_only]
        self.stepwise = [(law, p) for law, p in each if not law.targets_only]

    @property
    def of_supply(self) -> bool:
        """Whether one of them reads the voltage of the supply."""
        return any(law is SupplyVoltage for law, _ in self.stepwise)

    def joins(self, other: Laws) -> bool:
        """Whether these laws and others can be run as one."""
        return (
            self.dt == other.dt
            and [joint.name for joint in self.joints] == [joint.name for joint in other.joints]
            and [joint.play for joint in self.joints] == [joint.play for joint in other.joints]
            and self.forces.joins(other.forces)
            and (self.programs is None) == (other.programs is None)
            and (
                self.programs is None
                or other.programs is None
                or self.programs.joins(other.programs)
            )
        )

    @classmethod
    def joined(cls, parts: Sequence[Laws]) -> Laws:
        """The laws of some that can be run as one."""
        laws = copy(parts[0])
        laws.shape = (sum(part.shape[0] for part in parts), len(laws.joints))
        laws.forces = DriveForces.joined([part.forces for part in parts])
        if laws.programs is not None:
            programs = [part.programs for part in parts if part.programs is not None]
            laws.programs = ProgramsAtWork.joined(programs)
        laws.of_targets = cls._joined([(part.of_targets, part.shape) for part in parts])
        laws.stepwise = cls._joined([(part.stepwise, part.shape) for part in parts])
        return laws

    @property
    def runs(self) -> bool:
        """Whether something is to be run step by step."""
        return self.programs is not None or not all(law.constant for law, _ in self.stepwise)

    def constant(self) -> tuple[FloatArray, FloatArray]:
        """(n_sims, n_joints) effort and dry friction that they add to every step, if none runs."""
        step = self.step()
        self.bank().run("joint", step)
        return step.extra, step.friction

    @property
    def present(self) -> NDArray[np.bool_]:
        """(n_sims, n_laws) which of the laws that are run step by step act in which simulations."""
        if not self.stepwise:
            return np.ones((self.shape[0], 1), dtype=bool)
        return np.stack([law.acting(p).any(axis=1) for law, p in self.stepwise], axis=1)

    def some(self, rows: NDArray[np.intp]) -> Laws:
        """The laws of some of the simulations, those that act in them."""
        laws = copy(self)
        laws.forces = self.forces.some(rows)
        laws.shape = laws.forces.stiffness.shape
        laws.programs = None if self.programs is None else self.programs.some(rows)
        laws.of_targets = _acting(self.of_targets, rows)
        laws.stepwise = _acting(self.stepwise, rows)
        return laws

    @staticmethod
    def _joined(
        parts: Sequence[tuple[Sequence[_Law], tuple[int, int]]],
    ) -> list[_Law]:
        """Laws of some simulations each, neutral where others have them."""
        each = [(dict(laws), shape) for laws, shape in parts]
        return [
            (
                law,
                {
                    name: np.concatenate(
                        [
                            some[law][name] if law in some else np.full(shape, law.neutral[name])
                            for some, shape in each
                        ]
                    )
                    for name in law.neutral
                },
            )
            for law in in_order(law for some, _ in each for law in some)
        ]

    def bank(self) -> LawBank:
        """The laws that are run step by step, with nothing to remember yet."""
        return LawBank(self.stepwise, self.shape, self.dt, sparse=True)

    def step(self) -> Step:
        """A step in which nothing happens."""
        zeros = np.zeros(self.shape)
        return Step(
            dt=self.dt,
            time=np.zeros((self.shape[0], 1)),
            q=zeros,
            qd=zeros,
            stiffness=self.forces.stiffness,
            damping=self.forces.damping,
            limit=self.forces.limit,
            target=zeros,
            effort=zeros,
            extra=np.zeros(self.shape),
            friction=np.zeros(self.shape),
            dry=zeros,
            held=zeros,
            target_ahead=zeros,
            effort_ahead=zeros,
        )

    def controlled(
        self, ctrl: FloatArray, time: FloatArray
    ) -> tuple[FloatArray, FloatArray | None]:
        """The controls that the controllers make of those that arrive.

        Args:
            ctrl: (n_sims, n_steps, nu).
            time: (n_sims,) of the first step, by the robot's clock [s].

        Returns:
            As `ctrl`, of which it may be a copy, and (n_sims, n_steps, n_joints) what targets are
            at the steps' beginnings over that; None where they are the same all through.
        """
        if not self.of_targets:
            return ctrl, None
        bank = LawBank(self.of_targets, self.shape, self.dt, sparse=True)
        step, forces = self.step(), self.forces
        controls = np.array(ctrl[..., forces.ctrl].swapaxes(0, 1), order="C")
        targets = forces.targets(controls)
        ahead = np.zeros_like(targets)
        for k in range(len(controls)):
            step.time = time[:, None] + k * self.dt
            step.target, step.target_ahead = targets[k], ahead[k]
            bank.run("controller", step)
            controls[k] = forces.moved(controls[k], step.target - targets[k])
            ahead[k] = step.target_ahead
        changed = np.array(ctrl)
        changed[..., forces.ctrl] = controls.swapaxes(0, 1)
        return changed, ahead.swapaxes(0, 1)

    def shown(self, effort: FloatArray, ctrl: FloatArray, ahead: FloatArray) -> FloatArray:
        """What drives report at the steps' beginnings over what they make, as `effort`.

        Args:
            effort: (n_sims, n_steps, n_joints) that they make [N·m; N].
            ctrl: (n_sims, n_steps, nu) their controls.
            ahead: of their targets, (n_sims, n_steps, n_joints).
        """
        found = np.empty_like(effort)
        for k in range(effort.shape[1]):
            found[:, k] = self.forces.ahead(effort[:, k], ctrl[:, k, self.forces.ctrl], ahead[:, k])
        return found


def _acting(laws: Sequence[_Law], rows: NDArray[np.intp]) -> list[_Law]:
    some = [(law, {name: values[rows] for name, values in of.items()}) for law, of in laws]
    return [(law, numbers) for law, numbers in some if law.acting(numbers).any()]
