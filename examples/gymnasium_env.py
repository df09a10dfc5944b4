"""A task of this package as a Gymnasium environment, through Shimmy, Farama's adapter.

    pip install 'walkerkit[gymnasium]'
    python examples/gymnasium_env.py [EPISODES]

The quadruped is asked for a velocity; random actions are tried, as any learner begins. A fall comes
out as `terminated`, the time limit as `truncated`. Every composer or suite environment goes the
same way.
"""

from __future__ import annotations

from typing import Any

import gymnasium
from _arguments import argument
from shimmy import DmControlCompatibilityV0

from walkerkit.tasks import JointPositionAction, suite


def make(time_limit: float = 5.0, render_mode: str | None = None) -> gymnasium.Env[Any, Any]:
    """The quadruped's `walk`, with all observations in one vector.

    Args:
        time_limit: after which an episode is truncated [s].
        render_mode: one of Shimmy's, such as `rgb_array`.
    """
    environment = suite.load(
        "walkerkit_quadruped",
        "walk",
        action=JointPositionAction(joint_names_expr=(".*",), scale=0.3),
        task_kwargs={"time_limit": time_limit},
    )
    adapted = DmControlCompatibilityV0(environment, render_mode=render_mode)
    # Shimmy states the control timestep in milliseconds as frames per second, for every instance.
    adapted.metadata = {**adapted.metadata, "render_fps": round(1 / adapted.dt)}
    return gymnasium.wrappers.FlattenObservation(adapted)


def main(episodes: int) -> list[float]:
    """Runs episodes of random actions.

    Returns:
        The return of each.
    """
    environment = make()
    environment.action_space.seed(0)
    returns = []
    for episode in range(episodes):
        environment.reset(seed=0 if episode == 0 else None)
        total, steps, ended = 0.0, 0, False
        while not ended:
            _, reward, terminated, truncated, _ = environment.step(
                environment.action_space.sample()
            )
            total, steps, ended = total + float(reward), steps + 1, terminated or truncated
        print(f"episode {episode}: {steps} steps, return {total:.2f}, fell: {terminated}")
        returns.append(total)
    environment.close()
    return returns


if __name__ == "__main__":
    main(argument(__doc__, "EPISODES", 3))
