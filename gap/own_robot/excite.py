"""The battery of excitation as files that a robot can be sent, with what goes with them.

    battery = targets_for(load_robot("go2_hung.xml"), seconds=12.0)
    battery.files["2_slow_triangle.csv"]      # name to (T,) column: time, <joint>/position_target
    battery.readme                            # the order, the limits, safety, what to log

Targets stay inside the joints' ranges and what their servos take, around the model's first
keyframe, no faster than they are told to be. Where links of the robot would meet in the model on
the way, the room is made smaller until they do not. The first file is a tenth as large as the next.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.errors import closest, refusal, some
from walkerkit.gap.own_robot.excite_readme import HUNG, Limits, readme
from walkerkit.gap.simulation.robot import Joint, Robot
from walkerkit.tasks.excitation import BATTERY
from walkerkit.tasks.room import room_about

FloatArray = NDArray[np.float64]

ORDER: Final = (
    "slow_triangle",
    "micro_sine_on_ramp",
    "steps",
    "multisine",
    "chirp",
    "fast_sine",
)
"""From the slowest to the fastest."""

_SMALL: Final = 0.1  # of the next file's room, that the first one has
_SHRINK, _TRIES = 0.8, 10
_LOOKED_AT = 0.02  # s between poses that are looked at for collisions
_LONGEST = 600.0  # s


@dataclass(frozen=True, kw_only=True)
class Battery:
    """What to send to a robot.

    Attributes:
        files: name to columns, in the order in which they are to be sent.
        readme: what goes with them, Markdown.
        notes: what a user should know of how they were made.
    """

    files: Mapping[str, Mapping[str, FloatArray]]
    readme: str
    notes: tuple[str, ...]


def targets_for(
    robot: Robot,
    *,
    joints: Sequence[str] = (),
    seconds: float = 12.0,
    rate: float = 500.0,
    share: float = 1.0,
    speed: float = 4.0,
    seed: int = 0,
) -> Battery:
    """Draws the battery for a robot.

    Args:
        robot: its joints, ranges, links and first keyframe.
        joints: regular expressions of whole names; by default all joints that are driven.
        seconds: length of each file.
        rate: samples a second.
        share: of the room that the targets would have, a third of each joint's range.
        speed: the fastest targets [rad/s; m/s].
        seed: of phases and levels.

    Raises:
        InputError: a number makes no sense, or there is no such joint.
    """
    check_numbers(seconds=seconds, rate=rate, share=share, speed=speed)
    chosen = _chosen(robot, joints)
    lower, upper = _room(robot, chosen)
    notes = _before(robot, chosen)
    time = np.arange(0.0, seconds, 1 / rate)
    (low, high), targets, told = _fitting(robot, chosen, time, (lower, upper), share, speed, seed)
    notes += told
    small = _drawn(time, *_scaled(low, high, _SMALL), speed, seed)[ORDER[0]]
    drawn = {f"1_small_{ORDER[0]}": small}
    drawn |= {f"{k}_{name}": targets[name] for k, name in enumerate(ORDER, start=2)}
    limits = _limits(chosen, time, low, high, drawn)
    files = {
        f"{name}.csv": {
            "time": time,
            **{f"{joint.name}/position_target": one[:, k] for k, joint in enumerate(chosen)},
        }
        for name, one in drawn.items()
    }
    purposes = {file: _purpose(file) for file in files}
    text = readme(
        robot.source, purposes, limits, HUNG, length=f"{seconds:g} s", rate=rate, notes=notes
    )
    return Battery(files=files, readme=text, notes=tuple(notes))


def _fitting(
    robot: Robot,
    chosen: Sequence[Joint],
    time: FloatArray,
    room: tuple[FloatArray, FloatArray],
    share: float,
    speed: float,
    seed: int,
) -> tuple[tuple[FloatArray, FloatArray], dict[str, FloatArray], list[str]]:
    """Targets in so much of their room that links do not meet in the model.

    Returns:
        The lowest and highest targets, the targets by name, and what is to be said of them.
    """
    met, notes = "", list[str]()
    for attempt in range(_TRIES):
        size = share * _SHRINK**attempt
        low, high = _scaled(*room, size)
        targets = _drawn(time, low, high, speed, seed)
        meeting = _meeting(robot, chosen, time, targets)
        if meeting is None:
            break
        met = met or meeting
    else:
        notes.append(
            f"{meeting} meet in the model even in a tenth of the room: leave joints out with "
            "--joint, or keep the stop at hand"
        )
    if size < share:
        notes.append(
            f"targets have {size / share:.0%} of their room, so that links do not meet in the "
            f"model, as {met} would"
        )
    return (low, high), targets, notes


def _limits(
    chosen: Sequence[Joint],
    time: FloatArray,
    low: FloatArray,
    high: FloatArray,
    drawn: Mapping[str, FloatArray],
) -> list[Limits]:
    """Where each joint is sent by the targets that were drawn."""
    return [
        Limits(
            joint=joint.name,
            start=float(0.5 * (low[k] + high[k])),
            lower=float(low[k]),
            upper=float(high[k]),
            speed=max(fastest(time, one[:, k]) for one in drawn.values()),
            slide=joint.slide,
        )
        for k, joint in enumerate(chosen)
    ]


def _before(robot: Robot, chosen: Sequence[Joint]) -> list[str]:
    """What the model lacks to be compared with a log of these targets."""
    notes = []
    if robot.base is not None:
        notes.append(
            f"{robot.base.body} floats in this model: hang it with `walkerkit hang` before it is "
            "compared with a log of the robot hung up, or make targets for its feet with --standing"
        )
    motors = [joint.name for joint in chosen if {d.kind for d in joint.commanded} == {"effort"}]
    if motors:
        notes.append(
            f"{some(motors)} have torque motors in this model: make servos of them with `walkerkit "
            "servo` before it is compared with a log of position targets"
        )
    return notes


def check_numbers(*, seconds: float, rate: float, share: float, speed: float) -> None:
    """Raises InputError where one of these makes no sense; `targets_for` says what they are."""
    for name, value, most in (
        ("seconds", seconds, _LONGEST),
        ("rate", rate, 1e4),
        ("share", share, 1.0),
        ("speed", speed, 1e3),
    ):
        if not 0 < value <= most:
            raise refusal(f"{name} is {value:g}. Give a number above 0 and up to {most:g}.")


def _purpose(file: str) -> str:
    """What a file is for."""
    name = file.removesuffix(".csv").partition("_")[2]
    told = BATTERY[name.removeprefix("small_")].description
    small = name.startswith("small_")
    return "a tenth as large: look at its log before all others" if small else told


def _chosen(robot: Robot, expressions: Sequence[str]) -> list[Joint]:
    driven = {n: j for n, j in robot.joints.items() if j.drives} or dict(robot.joints)
    if not expressions:
        return list(driven.values())
    found: dict[str, Joint] = {}
    for expression in expressions:
        try:
            some = {n: j for n, j in driven.items() if re.fullmatch(expression, n)}
        except re.error as error:
            raise refusal(f"--joint {expression!r} is no regular expression: {error}.") from None
        if not some:
            raise refusal(
                f"{robot.source}: no driven joint is called {expression!r}"
                f"{closest(expression, driven)}. They are {', '.join(driven)}."
            )
        found |= some
    return list(found.values())


def _room(robot: Robot, joints: Sequence[Joint]) -> tuple[FloatArray, FloatArray]:
    """Lowest and highest targets around the first keyframe [rad; m]."""
    model = robot.model
    home = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, home, 0)
    ranges = np.array([_range(robot, joint) for joint in joints])
    middle = np.clip(home.qpos[[joint.qpos for joint in joints]], ranges[:, 0], ranges[:, 1])
    return room_about(middle, ranges)


def _range(robot: Robot, joint: Joint) -> tuple[float, float]:
    """Where a joint may be and be sent [rad; m], infinite where nothing limits it."""
    lower, upper = robot.target_range(joint)
    if not lower < upper:
        raise refusal(
            f"{robot.source}: joint {joint.name!r} has no room between its range and its "
            "actuator's ctrlrange. Mend one of them, or leave the joint out with --joint."
        )
    return lower, upper


def _scaled(lower: FloatArray, upper: FloatArray, size: float) -> tuple[FloatArray, FloatArray]:
    middle, half = 0.5 * (lower + upper), 0.5 * size * (upper - lower)
    return middle - half, middle + half


def _drawn(
    time: FloatArray, lower: FloatArray, upper: FloatArray, speed: float, seed: int
) -> dict[str, FloatArray]:
    return {
        name: BATTERY[name](
            time, lower=lower, upper=upper, rng=np.random.default_rng(seed), max_velocity=speed
        )
        for name in ORDER
    }


def _meeting(
    robot: Robot, joints: Sequence[Joint], time: FloatArray, targets: Mapping[str, FloatArray]
) -> str | None:
    """Two bodies that meet on the way and do not at its start, None where none do."""
    model = robot.model
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    addresses = [joint.qpos for joint in joints]
    stride = max(1, round(_LOOKED_AT / float(time[1] - time[0])))
    data.qpos[addresses] = next(iter(targets.values()))[0]
    before = _touching(robot, data)
    for one in targets.values():
        for pose in one[::stride]:
            data.qpos[addresses] = pose
            met = _touching(robot, data) - before
            if met:
                return " and ".join(model.body(body).name or f"body {body}" for body in min(met))
    return None


def _touching(robot: Robot, data: mujoco.MjData) -> set[tuple[int, int]]:
    """Pairs of bodies in contact; the world counts where the robot is mounted in it."""
    model = robot.model
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_collision(model, data)
    found = set()
    for k in range(data.ncon):
        contact = data.contact[k]
        if contact.dist > 0:
            continue
        pair = sorted(int(model.geom_bodyid[geom]) for geom in contact.geom)
        if robot.base is None or model.body_weldid[pair[0]]:
            found.add((pair[0], pair[1]))
    return found


def fastest(time: FloatArray, targets: FloatArray) -> float:
    """The highest speed of (T,) targets, or of (T, n) [rad/s; m/s]."""
    return float((np.abs(np.diff(targets.T)) / np.diff(time)).max())
