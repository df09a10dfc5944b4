"""The robot that an environment is made with: as given, mended, or with some of the effects.

    def make_environment(robot):
        walker = robot.walker()                     # actuators, delays, laws, encoders, all of it
        return composer.Environment(TrackVelocity(walker), time_limit=8.0)

`robot.model` is for environments that are not composer's; it refuses what MJCF cannot say.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike

from walkerkit.gap.errors import InputError, some
from walkerkit.gap.simulation.ground_geoms import Ground
from walkerkit.gap.simulation.mend import FIELDS
from walkerkit.gap.simulation.mended import Mended
from walkerkit.gap.simulation.robot import Measurement, Robot
from walkerkit.gap.simulation.trials import model_field

if TYPE_CHECKING:
    from walkerkit.walkers import MjcfWalker
    from walkerkit.walkers.actions import ActionTerm
    from walkerkit.walkers.drivetrain import Randomization

_FOUND_BY_COMPILER = ("geom_sameframe",)
_OPTIONS = ("timestep", "integrator")
_CONTACT = ("friction", "solref", "solimp")


@dataclass(frozen=True)
class PolicyRobot(Mended):
    """One of the robots that a policy is rolled out on.

    Attributes:
        robot: the robot, as replays take it.
        effects: names of the effects that it has beside what was given.
        joints: the joints that the robot has as it was given; play adds others, which no policy
            observes.
        taken: what the environment was made of, `walker` or `model`.
    """

    effects: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    taken: set[str] = field(default_factory=set, compare=False, repr=False)

    @property
    def model(self) -> mujoco.MjModel:
        """Its compiled model, a copy.

        Raises:
            InputError: it has what MJCF cannot say, which `walker` has.
        """
        beyond = _beyond_mjcf(self.robot)
        if beyond:
            raise InputError(
                f"{_listed(self.effects)}: the compiled model alone has no {some(beyond)}, so that "
                "the policy would meet another robot. Make the environment with robot.walker(), "
                "which has them, or leave the effect out with `effects`."
            )
        self.taken.add("model")
        return super().model

    def walker(
        self,
        *,
        name: str | None = None,
        action: ActionTerm | Sequence[ActionTerm] | None = None,
        home: str | Mapping[str, float] | ArrayLike | None = None,
        floating: bool | None = None,
        randomizations: Sequence[Randomization] = (),
    ) -> MjcfWalker:
        """A composer walker with its actuators, delays, laws and encoders; see `Mended.walker`.

        Raises:
            InputError: an effect cannot be put into a walker.
        """
        from walkerkit.gap.policy.sensing import SensedWalker
        from walkerkit.walkers.robot_file import escaped

        misread = [
            joint
            for joint, of in self.robot.measurement.items()
            if of.encoder_gain != 1 and self.robot.joints[joint].in_python
        ]
        if misread:
            raise InputError(
                f"{_listed(self.effects)}: the drive of {some(misread)} feeds back what a wrong "
                "encoder gain shows, and its law runs in Python, where no walker has that. Leave "
                "encoder_gain out with `effects`."
            )
        walker = self.made(
            SensedWalker,
            name=name,
            action=action,
            home=home,
            floating=floating,
            joints=[re.escape(escaped(joint)) for joint in self.joints] or None,
            randomizations=randomizations,
        )
        plays = {j.name: j.play.name for j in self.robot.joints.values() if j.play is not None}
        walker.reads(self.robot.measurement, plays)
        self.taken.add("walker")
        return walker


def meets(given: Robot, robot: Robot) -> bool:
    """Whether a policy would meet another robot: some change is not of the log alone."""
    return (
        bool(changed_fields(given.model, robot.model))
        or given.laws != robot.laws
        or _drives(given) != _drives(robot)
        or _numbers(given) != _numbers(robot)
        or any(_met(given.measured(j)) != _met(robot.measured(j)) for j in robot.joints)
    )


def check_in_place(
    given: Robot, robot: PolicyRobot, before: mujoco.MjModel, after: mujoco.MjModel
) -> None:
    """Refuses an environment that has not taken over what a robot has.

    Args:
        given: the robot as it was given.
        robot: that with which the environment was made.
        before: the compiled model of the environment that was made with the first.
        after: the compiled model of its own.

    Raises:
        InputError: the environment was not made with the robot, or has other numbers.
    """
    if not robot.taken:
        raise InputError(
            "make_environment has not used the robot that it was given, so that no effect is in "
            "its environment. Make the walker with robot.walker(), or take robot.model."
        )
    wanted = changed_fields(given.model, robot.robot.model)
    there = changed_fields(before, after)
    # A play has joints of its own, and with them everything has another shape.
    lost = [name for name in wanted if name not in there]
    if lost:
        raise InputError(
            f"{_listed(robot.effects)}: the environment has its own {some(lost)}, so that what was "
            "found is not in it. Let the task or the arena leave that to the walker (timesteps, "
            "gravity, geoms of the ground), or leave the effect out with `effects`."
        )
    contacts = [f"{kind}_{name}" for kind in ("geom", "pair") for name in _CONTACT]
    if any(name in contacts for name in wanted):
        fixed, moving = Ground(after).contacts.T
        # What is no foot touches the ground when it is too late.
        feet = ~np.isin(after.geom_bodyid[moving], after.body_parentid)
        if not (after.geom_priority[moving] > after.geom_priority[fixed])[feet].all():
            raise InputError(
                f"{_listed(robot.effects)}: a contact with the environment's floor has the floor's "
                'numbers too. Give the feet of the model priority="1", which makes theirs count, '
                "or leave the effect out with `effects`."
            )


def changed_fields(one: mujoco.MjModel, other: mujoco.MjModel) -> tuple[str, ...]:
    """What effects write to, where two compiled models differ in it."""
    names = [*(name for name in FIELDS if name not in _FOUND_BY_COMPILER)]
    names += [f"opt.{name}" for name in _OPTIONS]
    names += ["actuator_delay"]
    return tuple(
        name
        for name in names
        if not np.array_equal(model_field(one, name), model_field(other, name))
    )


def as_given(robot: Robot) -> PolicyRobot:
    """A robot that is not changed."""
    return PolicyRobot(robot, joints=tuple(robot.joints))


def with_effects(given: Robot, robot: Robot, effects: Sequence[str]) -> PolicyRobot:
    """The same with effects."""
    # Time stamps of a log are nothing that a policy meets.
    measurement = {j: replace(of, clock_skew=0.0) for j, of in robot.measurement.items()}
    return PolicyRobot(
        replace(robot, measurement=measurement),
        effects=tuple(effects),
        joints=tuple(given.joints),
    )


def _beyond_mjcf(robot: Robot) -> list[str]:
    """What of a robot its compiled model does not have, in words."""
    found = [f"law {law} of {joint}" for joint, laws in robot.laws.items() for law in laws]
    found += [
        f"delay of targets of {joint.name}"
        for joint in robot.joints.values()
        if any(drive.late for drive in joint.commanded)
    ]
    found += [f"law in Python of {joint}" for p in robot.programs for joint in p.joints]
    ideal = _met(Measurement())[:-2]  # without what a drive says of its effort
    return found + [
        f"reading of {joint}"
        for joint, of in robot.measurement.items()
        if _met(of)[:-2] != ideal and joint in robot.joints
    ]


def _met(of: Measurement) -> tuple[float, ...]:
    """What a policy meets of a measurement."""
    wave = (of.error_amplitude, of.error_periods, of.error_phase) if of.error_amplitude else ()
    return (
        of.position_delay,
        of.encoder_gain,
        of.load_side,
        *(wave or (0.0, 0.0, 0.0)),
        of.effort_scale,
        of.effort_offset,
    )


def _drives(robot: Robot) -> dict[str, Any]:
    return {
        name: [(one.slope, one.offset, one.late) for one in joint.commanded]
        for name, joint in robot.joints.items()
    }


def _numbers(robot: Robot) -> list[dict[str, list[float]]]:
    return [
        {name: np.asarray(values, dtype=float).tolist() for name, values in one.numbers.items()}
        for one in robot.programs
    ]


def _listed(effects: Sequence[str]) -> str:
    return ", ".join(effects) or "the model as given"
