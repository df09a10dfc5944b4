"""What a robot on its feet can be asked to do, as logs that a replay begins with.

    logs = standing_battery(robot, seconds=10.0, rate=500.0)     # name of a motion to its log

Empty for a robot that hangs, that does not stand by itself in its first keyframe, or that is not
sent positions.
"""

from __future__ import annotations

from walkerkit.gap.errors import InputError
from walkerkit.gap.recordings.recording import Recording
from walkerkit.gap.simulation.robot import Robot
from walkerkit.gap.standing.choose import safe_motions
from walkerkit.gap.standing.simulated import sent
from walkerkit.gap.standing.standing_pose import find_stand

_FASTEST = 10.0  # rad/s


def standing_battery(
    robot: Robot, *, seconds: float, rate: float, n_threads: int = 0
) -> dict[str, Recording]:
    """The motions that a robot on its feet comes through.

    Args:
        robot: the robot.
        seconds: length of those that have none of their own [s].
        rate: targets a second.
        n_threads: of the simulation, 0 for all cores.

    Returns:
        Name of the motion to its targets, with the pose in which the robot stands.
    """
    if robot.base is None:
        return {}
    try:
        stand = find_stand(robot, n_threads=n_threads)
    except InputError:  # then it is asked for what its recordings show
        return {}
    chosen = safe_motions(stand, seconds=seconds, rate=rate, speed=_FASTEST, n_threads=n_threads)
    return {
        one.motion.name: sent(robot, stand.base, stand.qpos, one.time, one.targets)
        for one in chosen
        if one.size
    }
