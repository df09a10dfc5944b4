"""Opens dm_control's viewer on one of our robots, which holds its pose.

    python examples/view.py quadruped

Robots that stand hold their home pose; those with a fixed base follow an excitation. The space bar
starts it; pull at them with the mouse (double-click, then Ctrl and drag). Needs a display.
"""

from __future__ import annotations

import argparse
import os
import sys
import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROBOTS = ("quadruped", "biped", "leg", "servo_bench")
NO_DISPLAY = (
    "no display, so there is no window to open: run this where there is a screen (DISPLAY is "
    "{display!r}), or make a video without one: MUJOCO_GL=egl python examples/video.py"
)


def scene(robot: str) -> tuple[Any, Callable[[Any], NDArray[np.float64]]]:
    """The environment to look at, and the policy that runs in it.

    Args:
        robot: one of `ROBOTS`.
    """
    from dm_control import composer

    from walkerkit.tasks import Stand, TrackJoints
    from walkerkit.walkers import Biped, Leg, Quadruped, ServoBench

    robots = {"quadruped": Quadruped, "biped": Biped, "leg": Leg, "servo_bench": ServoBench}
    walker = robots[robot]()
    if walker.floating:
        task, action = Stand(walker), walker.action_for()
    else:
        task = TrackJoints(walker)
        action = np.zeros(len(walker.actuator_group.joint_names))
    return composer.Environment(task, random_state=0), lambda _: action


def has_display() -> bool:
    """A window can be opened."""
    import glfw

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of what is told here in other words
        return bool(glfw.init())


def main() -> None:
    """Opens the window."""
    parser = argparse.ArgumentParser(prog="view.py", description=__doc__)
    parser.add_argument("robot", choices=ROBOTS, nargs="?", default="quadruped")
    robot = parser.parse_args().robot
    if not has_display():
        sys.exit(NO_DISPLAY.format(display=os.environ.get("DISPLAY")))
    os.environ["MUJOCO_GL"] = "glfw"
    from dm_control import viewer

    environment, policy = scene(robot)
    viewer.launch(environment, policy=policy, title=robot)


if __name__ == "__main__":
    main()
