"""Lets the quadruped trot without looking, and prints how far it got.

    python examples/trot.py [SECONDS]

The targets are a function of time alone (`walkerkit.walkers.gait`). Nobody holds the heading, so it
drifts.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

os.environ.setdefault("MUJOCO_GL", "disable")

import numpy as np
from _arguments import argument
from dm_control import composer

from walkerkit.actuators import ActuatorCmd
from walkerkit.tasks import TrackVelocity
from walkerkit.walkers import Quadruped, Trot


@dataclass(frozen=True, kw_only=True)
class Trotted:
    """How it went.

    Attributes:
        seconds: how long it went on [s].
        ahead: way in the direction that it faced at the start [m].
        aside: way to the left of that [m].
        fell: why it counts as fallen; empty if it does not.
    """

    seconds: float
    ahead: float
    aside: float
    fell: tuple[str, ...]

    @property
    def speed(self) -> float:
        """Mean speed ahead [m/s]."""
        return self.ahead / self.seconds


def trot(seconds: float, gait: Trot | None = None) -> Iterator[tuple[Any, Quadruped, Any]]:
    """Trots, and hands over the environment, the walker and its task after every control step."""
    gait = Trot() if gait is None else gait
    walker = Quadruped()
    task = TrackVelocity(walker)
    environment = composer.Environment(task, time_limit=seconds, random_state=0)
    step = environment.reset()
    yield environment, walker, task
    while not step.last():
        targets = ActuatorCmd(position_target=gait(environment.physics.time()))
        step = environment.step(walker.action_for(targets))
        yield environment, walker, task
    environment.close()


def main(seconds: float = 8.0) -> Trotted:
    """Trots and prints speed and whether it fell."""
    gait = Trot()
    way = []
    fell: tuple[str, ...] = ()
    time = 0.0
    for environment, walker, task in trot(seconds, gait):
        way.append(np.array(environment.physics.bind(walker.root_body).xpos))
        time, fell = environment.physics.time(), tuple(task.fallen)
    ahead, aside, _ = way[-1] - way[0]
    trotted = Trotted(seconds=time, ahead=float(ahead), aside=float(aside), fell=fell)
    print(
        f"{trotted.speed:.2f} m/s forward over {time:.1f} s (the feet ask for {gait.speed:.2f}), "
        f"{trotted.aside:+.2f} m to the left; "
        + (f"fell: {', '.join(fell)}" if fell else "did not fall")
    )
    return trotted


if __name__ == "__main__":
    main(argument(__doc__, "SECONDS", 8.0))
