"""What a robot on its feet can be sent, as files, each tried in simulation before.

    battery = standing_targets_for(load_robot("go2_servo.xml"))
    battery.files["2_shift.csv"]         # name to (T,) column: time, <joint>/position_target
    battery.notes                        # what was made smaller or left out, and why

Weight shifts, twists, squats, single feet lifted and small hops, drawn from the model
(`gap.standing.motions`), and made smaller until the model and eight that differ from it in friction
of the ground, payload, gains and delay come through without a fall, a slip or a limit
(`gap.standing.safety`). The first file is a third as large as the next.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from walkerkit.gap.bar import Progress
from walkerkit.gap.errors import InputError, refusal
from walkerkit.gap.own_robot.excite import Battery, check_numbers, fastest
from walkerkit.gap.own_robot.excite_readme import Limits, readme, standing_manner
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.standing.choose import Chosen, drawn, safe_motions
from walkerkit.gap.standing.safety import BOUNDS, effort_limit
from walkerkit.gap.standing.standing_pose import Stand, find_stand
from walkerkit.gap.standing.variants import UNCERTAINTY

FloatArray = NDArray[np.float64]

_SHORTEST = 6.0  # s
_SMALL = 0.3  # of the next file's size, that the first one has


def standing_targets_for(
    robot: Robot,
    *,
    seconds: float = 12.0,
    rate: float = 500.0,
    share: float = 1.0,
    speed: float = 10.0,
    seed: int = 0,
    n_threads: int = 0,
    progress: Progress | None = None,
) -> Battery:
    """Draws what a robot on its feet can be sent.

    Args:
        robot: it floats, stands in its first keyframe, and is sent positions.
        seconds: length of each file whose motion has none of its own.
        rate: samples a second.
        share: of the full size of the motions that is tried first.
        speed: the fastest targets [rad/s; m/s].
        seed: of phases.
        n_threads: of the simulation, 0 for all cores.
        progress: called with what is tried, and how much of it all is done, in [0, 1].

    Raises:
        InputError: a number makes no sense, the robot does not stand, or there is nothing that it
            can be sent.
    """
    check_numbers(seconds=seconds, rate=rate, share=share, speed=speed)
    if seconds < _SHORTEST:
        raise refusal(f"seconds is {seconds:g}. A robot on its feet takes {_SHORTEST:g} or more.")
    if progress is not None:
        progress("standing still", 0.0)
    stand = find_stand(robot, n_threads=n_threads)
    every = safe_motions(
        stand,
        seconds=seconds,
        rate=rate,
        speed=speed,
        share=share,
        seed=seed,
        n_threads=n_threads,
        progress=progress,
    )
    chosen = [one for one in every if one.size]
    if not chosen:
        raise _nothing(robot, every)
    files, purposes = _files(stand, chosen, seed)
    notes = tuple(note for one in every if (note := _note(one, share))) + _of_limits(stand)
    lengths = [float(one.time[-1]) for one in chosen]
    text = readme(
        robot.source,
        purposes,
        _limits(stand, files),
        standing_manner([sole.name for sole in stand.soles], _tried()),
        length=f"{min(lengths):.0f} to {max(lengths):.0f} s",
        rate=rate,
        notes=notes,
    )
    return Battery(files=files, readme=text, notes=notes)


def _nothing(robot: Robot, every: Sequence[Chosen]) -> InputError:
    """The error of a robot that comes through none of the motions."""
    reasons = "; ".join(f"{one.motion.name}: {one.fault}" for one in every)
    return refusal(
        f"{robot.source}: there is nothing that this robot can safely be sent on its feet. "
        f"{reasons}. Hang it up instead (walkerkit hang, walkerkit excite), or give the gains and "
        "the effort limits that it really has."
    )


def _files(
    stand: Stand, chosen: Sequence[Chosen], seed: int
) -> tuple[dict[str, dict[str, FloatArray]], dict[str, str]]:
    """Name to columns, and name to what a file tells, in the order in which they are sent."""
    first = chosen[0]
    _, small = drawn(stand, first.motion, first.time, _SMALL * first.size, np.inf, seed)
    name = f"1_small_{first.motion.name}.csv"
    files = {name: {"time": first.time} | _columns(small)}
    purposes = {name: f"{_SMALL:.0%} of the next: look at its log before all others"}
    for number, one in enumerate(chosen, start=2):
        name = f"{number}_{one.motion.name}.csv"
        files[name] = {"time": one.time} | _columns(one.targets)
        purposes[name] = one.motion.purpose
    return files, purposes


def _columns(targets: dict[str, FloatArray]) -> dict[str, FloatArray]:
    return {f"{joint}/position_target": series for joint, series in targets.items()}


def _note(one: Chosen, share: float) -> str:
    """What a user should know of a motion; empty for one of its full size."""
    if not one.size:
        return f"{one.motion.name} is left out, at its smallest size: {one.fault}"
    if one.fault:
        return f"{one.motion.name} has {one.size / share:.0%} of its size; at more, {one.fault}"
    return ""


def _of_limits(stand: Stand) -> tuple[str, ...]:
    """A note where the model does not say what the drives can do."""
    joints = [j.name for j in stand.joints if not np.isfinite(effort_limit(stand.robot, j))]
    if not joints:
        return ()
    which = "any joint" if len(joints) == len(stand.joints) else ", ".join(joints)
    return (
        f"the model does not say what the drives of {which} can make, so that their efforts were "
        "not checked: give their actuators a forcerange",
    )


def _limits(stand: Stand, files: dict[str, dict[str, FloatArray]]) -> list[Limits]:
    found = []
    for joint, start in zip(stand.joints, stand.targets, strict=True):
        every = [(one["time"], one[f"{joint.name}/position_target"]) for one in files.values()]
        found.append(
            Limits(
                joint=joint.name,
                start=float(start),
                lower=min(float(series.min()) for _, series in every),
                upper=max(float(series.max()) for _, series in every),
                speed=max(fastest(time, series) for time, series in every),
                slide=joint.slide,
            )
        )
    return found


def _tried() -> str:
    """How the targets were tried, a paragraph."""
    (slid, slides), (lighter, heavier), (softer, stiffer), (_, late) = UNCERTAINTY.values()
    return (
        "They were tried in simulation, on the model and on eight that differ from it in friction "
        f"of the ground ({slid:+.0%} and {slides:+.0%}), mass on the trunk ({lighter:+.0%} and "
        f"{heavier:+.0%} of the robot's), gains ({softer:+.0%} and {stiffer:+.0%}) and delay (none "
        f"and {1e3 * late:g} ms): none falls, touches anything but the ground with its feet, comes "
        f"to the end of a joint's range or takes more than {BOUNDS['effort']:.0%} of a drive's "
        f"limit; no foot that stands slips by more than {1e3 * BOUNDS['slip']:g} mm in half a "
        f"second ({1e3 * BOUNDS['slip of a hop']:g} mm over all hops), and but for hops the centre "
        f"of pressure stays inside of the support polygon, by {BOUNDS['pressure']:.0%} of its "
        "depth. A robot that differs by more may fall."
    )
