"""Hold the home pose on the ground.

    task = Stand(Quadruped())
    environment = composer.Environment(task, time_limit=10.0, strip_singleton_obs_buffer_dim=True)

Reward: the weighted mean of

| term | equation | weight |
|---|---|---|
| `upright` | (1 + cos θ)/2, θ the root body's tilt from home | 1 |
| `height` | exp(−((h − h₀)/(h₀/4))²), h its height, h₀ at home | 1 |
| `pose` | meanᵢ exp(−((qᵢ − qᵢ⁰)/0.5 rad)²), q⁰ the home pose | 1 |
| `effort` | 1 − meanᵢ min((τᵢ/τᵢ_max)², 1) | 0.2 |

Observations, of the walker and where it has them: `joints_pos` (n,) rad, `joints_vel` (n,) rad/s,
`world_zaxis` (3,) the world's upward axis in the root body's frame, `sensors_gyro` (3,) rad/s,
`sensors_accelerometer` (3,) m/s², `sensors_velocimeter` (3,) m/s in the frame of its inertial unit,
and `prev_action` (n_actions,). m and m/s on slide joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from walkerkit.tasks.falls import STANDING, FallLimits
from walkerkit.tasks.rewards import closeness
from walkerkit.tasks.upright_task import UprightTask
from walkerkit.walkers.drivetrain import Randomization

_WEIGHTS: Final = {"upright": 1.0, "height": 1.0, "pose": 1.0, "effort": 0.2}
HEIGHT_SCALE: Final = 0.25  # of the height at home
POSE_SCALE: Final = 0.5  # rad, or m


class Stand(UprightTask):
    """A walker that holds its home pose; the episode ends when it falls.

    Args:
        walker: with actuators of ours, and floating.
        arena: where it stands; by default a flat floor.
        physics_timestep: [s]; by default that of the robot's file, else 2 ms.
        control_timestep: [s].
        randomizations: applied to the walker's actuators at the start of each episode, ahead of
            the walker's own.
        weights: {reward term: weight}; terms that are left out have their default.
        fall: what counts as a fall.
        joint_noise: joints start within this of home, drawn uniformly [rad; m].

    Raises:
        TypeError: the walker has no actuators of ours.
        ValueError: it does not float, or an argument is out of its bounds.
    """

    def __init__(
        self,
        walker: Any,
        arena: Any = None,
        *,
        physics_timestep: float | None = None,
        control_timestep: float = 0.02,
        randomizations: Sequence[Randomization] = (),
        weights: Mapping[str, float] | None = None,
        fall: FallLimits = STANDING,
        joint_noise: float = 0.02,
    ):
        super().__init__(
            walker,
            arena,
            physics_timestep=physics_timestep,
            control_timestep=control_timestep,
            randomizations=randomizations,
            weights=weights,
            default_weights=_WEIGHTS,
            fall=fall,
            joint_noise=joint_noise,
        )

    def reward_terms(self, physics: Any) -> dict[str, float]:
        """`upright`, `height`, `pose` and `effort`, as the module says."""
        home = self._trunk.home_height
        return {
            "upright": self._upright(physics),
            "height": closeness(self._trunk.height(physics) - home, HEIGHT_SCALE * home),
            "pose": closeness(self._pose_error(physics), POSE_SCALE),
            "effort": self._low_effort(),
        }

    def _begin(self, physics: Any, random_state: Any) -> None:
        """There is nothing to draw."""
