"""The log that a simulated robot leaves: the same as that of a real one.

    from walkerkit import gap
    from walkerkit.tasks import TrackJoints
    from walkerkit.walkers import Leg

    environment = composer.Environment(TrackJoints(Leg(), excitation="chirp"))
    recording = gap.record(environment)
    gap.diagnose("leg.xml", [recording])

A row is the instant at which a command begins to act: `time` from the start of the episode;
`position` and `velocity` as they are then; the targets that are sent then and hold until the next
row (as sent: a delay of the drive comes after); and `effort`, what the drives make of both in the
physics step that begins there, on the joint's side of gears and limits. That is how replay reads a
log, so a log that is replayed by the model that made it, at its timestep, leaves no gap. Joints are
called as in the robot's own model. A base that floats leaves its pose and velocity too, or what an
inertial unit and foot switches read (`base="imu"`; log it at the rate of the physics, since a row
shows the acceleration of one step).

Which model to compare with: MuJoCo's actuators (`Builtin…`, `Xml…`, those of the file) are in the
robot's own MJCF. That has a bare motor for a law that runs in Python (`IdealPdActuatorCfg`,
`DcMotorActuatorCfg`, one of your own, with the delays in front of it), and nothing for drivetrain
laws (`laws=`). Give as the model a `package.module:callable` that returns the walker, and all of
them are replayed. A model without them, or with a `BuiltinPdActuatorCfg` of the same gains, has a
gap to be found. For a robot that `TrackJoints` hung up, the model is its `task.walker`.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import Any, Literal

import numpy as np

from walkerkit.actuators.messages import closest
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.robot_log import BaseLog, RobotLog
from walkerkit.tasks.excitation import Excitation
from walkerkit.tasks.reference import Reference
from walkerkit.tasks.track_joints import TrackJoints
from walkerkit.walkers.drivetrain import Drivetrain

Policy = Callable[[Any], Any]
Every = Literal["control_step", "physics_step"]

LONGEST = 600.0
"""An episode that nobody limits is run this long, and then refused [s]."""


def record(
    environment: Any,
    policy: Policy | Excitation | str | None = None,
    *,
    seconds: float | None = None,
    n_steps: int | None = None,
    every: Every = "control_step",
    walker: Any = None,
    seed: int = 0,
    name: str = "simulation",
    base: BaseLog = "pose",
) -> Recording:
    """Runs an episode, or the beginning of one, and logs the joints.

    Args:
        environment: a composer environment, or a suite environment (`tasks.suite.load`). It is
            reset.
        policy: a function of the last `TimeStep` that returns an action; or an excitation, or its
            name, for the joints of a walker with actuators of ours that follow position targets,
            around its default pose; or None for actions of zero, which leave `TrackJoints` to its
            own excitation.
        seconds: how long to run [s]; by default until the episode ends.
        n_steps: the same in control steps; give one of the two, or none.
        every: a row for each `control_step`, or for each `physics_step`.
        walker: whose joints to log, where the arena has several walkers.
        seed: of the excitation.
        name: the recording's name.
        base: what is logged of a base that floats: its `pose` and velocity; what an ideal `imu`
            reads, and which feet touch the ground; or `both`.

    Returns:
        The recording; shorter than asked for, with a note, where the episode ended before.

    Raises:
        InputError: no joint has a target, or the episode has fewer than two rows.
        TypeError: the policy is none of these.
        ValueError: an argument is unusable, there is not one walker alone and none is named, or
            neither a length is given nor the episode ends.
    """
    _check_choices(every, base)
    control_step = float(environment.control_timestep())
    wanted = _wanted(seconds, n_steps, control_step)
    timestep = environment.reset()
    log = RobotLog(environment, walker, base)
    act = _policy(
        policy, environment, log.drivetrain, seed=seed, n_steps=wanted, control_step=control_step
    )
    with _watched(environment.physics, log) as watch:
        watch.always = every == "physics_step"
        done = _played(environment, act, timestep, watch, wanted)
    return Recording(
        name=name,
        time=float(environment.physics.timestep()) * np.array(watch.steps, dtype=np.float64),
        columns=log.columns(),
        notes=(*log.notes, *_cut_short(done, wanted, control_step)),
    )


def _check_choices(every: str, base: str) -> None:
    """Raises ValueError where one of these is none of the words for it."""
    if every not in ("control_step", "physics_step"):
        raise ValueError(
            f"every is {every!r}{closest(str(every), ('control_step', 'physics_step'))}; it should "
            "be 'control_step' or 'physics_step'"
        )
    if base not in ("pose", "imu", "both"):
        raise ValueError(
            f"base is {base!r}{closest(str(base), ('pose', 'imu', 'both'))}; it should be 'pose', "
            "'imu' or 'both'"
        )


def _played(environment: Any, act: Policy, timestep: Any, watch: _Watch, wanted: int | None) -> int:
    """Plays an episode from its first time step on; returns how many control steps it took.

    Raises:
        ValueError: it would not end.
    """
    done, longest = 0, wanted
    if longest is None:
        longest = round(LONGEST / float(environment.control_timestep()))
    while done < longest and not timestep.last():
        watch.due = True
        timestep = environment.step(act(timestep))
        done += 1
    if wanted is None and not timestep.last():
        raise ValueError(
            f"the episode has not ended after {LONGEST:g} s: give seconds or n_steps, or a time "
            "limit to the environment"
        )
    return done


def _cut_short(done: int, wanted: int | None, control_step: float) -> Iterator[str]:
    """That an episode ended before it was to."""
    if wanted is not None and done < wanted:
        yield (
            f"the episode ended after {done * control_step:g} s of {wanted * control_step:g}: the "
            "robot fell, or the time limit came first"
        )


class _Watch:
    """Which physics steps to log.

    Attributes:
        due: the next one is a row.
        always: every one is.
        count: how many there were.
        steps: the number of each row's.
    """

    def __init__(self) -> None:
        self.due = False
        self.always = False
        self.count = 0
        self.steps: list[int] = []

    def begins(self) -> bool:
        """A step begins; is it a row?"""
        row = self.due or self.always
        if row:
            self.steps.append(self.count)
        self.due = False
        self.count += 1
        return row


@contextlib.contextmanager
def _watched(physics: Any, log: RobotLog) -> Iterator[_Watch]:
    """Logs around the physics' own `step`, wherever it is called from.

    composer's hooks could not be taken off again, and suite environments have none.
    """
    watch = _Watch()
    step = physics.step

    def logged(nstep: int = 1) -> None:
        for _ in range(nstep):
            row = watch.begins()
            if row:
                log.before_step()
            step()
            if row:
                log.after_step()

    physics.step = logged
    try:
        yield watch
    finally:
        del physics.step


def _wanted(seconds: float | None, n_steps: int | None, control_step: float) -> int | None:
    """Control steps to run, or None until the episode ends."""
    if seconds is not None and n_steps is not None:
        raise ValueError(f"seconds={seconds} and n_steps={n_steps}: give one of the two, or none")
    if seconds is not None:
        if not 0 < seconds < np.inf:
            raise ValueError(f"seconds is {seconds}; it should be above 0 and finite")
        return max(round(seconds / control_step), 1)
    if n_steps is not None and n_steps < 1:
        raise ValueError(f"n_steps is {n_steps}; it should be at least 1")
    return n_steps


def _policy(
    policy: Policy | Excitation | str | None,
    environment: Any,
    drivetrain: Drivetrain | None,
    *,
    seed: int,
    n_steps: int | None,
    control_step: float,
) -> Policy:
    if policy is None:
        spec = environment.action_spec()
        still = np.clip(np.zeros(spec.shape), spec.minimum, spec.maximum)
        return lambda timestep: still
    if not isinstance(policy, Excitation | str):
        if not callable(policy):
            raise TypeError(
                f"policy is {policy!r}; it should be a function of a TimeStep that returns an "
                "action, an excitation or its name, or None"
            )
        return policy
    if drivetrain is None or isinstance(environment.task, TrackJoints):
        raise ValueError(
            f"policy is the excitation {getattr(policy, 'name', policy)!r}, which "
            + (
                "TrackJoints takes itself: give it as its `excitation`"
                if drivetrain is not None
                else "takes actuators of ours: use with_actuators, MjcfWalker or tasks.suite.load"
            )
        )
    if n_steps is None:
        raise ValueError("an excitation has no length of its own: give seconds or n_steps")
    reference = Reference(drivetrain, policy, seconds=n_steps * control_step, timestep=control_step)
    rows = iter(reference.draw(np.random.default_rng(seed)))
    return lambda timestep: drivetrain.action_for(reference.command(next(rows)))
