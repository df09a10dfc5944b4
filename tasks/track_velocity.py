"""Walk and turn as commanded.

    task = TrackVelocity(Quadruped(), forward=(0.0, 1.0), left=(-0.3, 0.3), yaw_rate=(-0.5, 0.5))
    environment = composer.Environment(task, time_limit=20.0, strip_singleton_obs_buffer_dim=True)

The command is drawn uniformly at the start of each episode, and holds until its end. Velocities are
those of the root body in the frame of its heading: level with the ground, x where the body faces.
Reward: the weighted mean of

| term | equation | weight |
|---|---|---|
| `velocity` | exp(−‖v − v*‖²/(0.5 m/s)²), v forward and to the left | 2 |
| `yaw_rate` | exp(−((ω − ω*)/(0.5 rad/s))²) | 1 |
| `upright` | (1 + cos θ)/2, θ the root body's tilt from home | 0.5 |
| `effort` | 1 − meanᵢ min((τᵢ/τᵢ_max)², 1) | 0.1 |
| `smoothness` | 1 − meanᵢ ((aᵢ − aᵢ')/2)², a' the action before | 0.1 |

Observations are those of `tasks.stand`, and `command` (3,): forward and left velocity [m/s], yaw
rate [rad/s].
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from dm_control.composer.observation import observable
from numpy.typing import NDArray

from walkerkit.actuators.arguments import check_number
from walkerkit.tasks.falls import STANDING, FallLimits
from walkerkit.tasks.rewards import closeness, smoothness
from walkerkit.tasks.upright_task import UprightTask
from walkerkit.walkers.drivetrain import Randomization

FloatArray = NDArray[np.float64]
Range = tuple[float, float]

_WEIGHTS: Final = {
    "velocity": 2.0,
    "yaw_rate": 1.0,
    "upright": 0.5,
    "effort": 0.1,
    "smoothness": 0.1,
}
VELOCITY_SCALE: Final = 0.5  # m/s
YAW_RATE_SCALE: Final = 0.5  # rad/s


class TrackVelocity(UprightTask):
    """A walker that follows a commanded velocity; the episode ends when it falls.

    Args:
        walker: with actuators of ours, and floating.
        arena: where it walks; by default a flat floor.
        forward: (low, high) of the commanded forward velocity [m/s]; twice the same to fix it.
        left: (low, high) of the commanded velocity to the left [m/s].
        yaw_rate: (low, high) of the commanded yaw rate, anticlockwise [rad/s].
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
        forward: Range = (0.0, 1.0),
        left: Range = (-0.3, 0.3),
        yaw_rate: Range = (-0.5, 0.5),
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
        given = {"forward": forward, "left": left, "yaw_rate": yaw_rate}
        self._ranges = np.array([_range(name, pair) for name, pair in given.items()])
        self._command: FloatArray = self._ranges.mean(axis=1)
        self._observed = observable.Generic(lambda _: self._command)
        self._observed.enabled = True

    @property
    def command(self) -> FloatArray:
        """Velocity forward and to the left [m/s], and yaw rate [rad/s], (3,), a copy."""
        return self._command.copy()

    @property
    def task_observables(self) -> OrderedDict[str, Any]:
        """`command`."""
        return OrderedDict(command=self._observed)

    def reward_terms(self, physics: Any) -> dict[str, float]:
        """`velocity`, `yaw_rate`, `upright`, `effort` and `smoothness`, as the module says."""
        error = self._trunk.velocity(physics) - self._command
        return {
            "velocity": closeness(np.hypot(error[0], error[1]), VELOCITY_SCALE),
            "yaw_rate": closeness(error[2], YAW_RATE_SCALE),
            "upright": self._upright(physics),
            "effort": self._low_effort(),
            "smoothness": smoothness(self._walker.prev_action, self._previous_action),
        }

    def _begin(self, physics: Any, random_state: Any) -> None:
        del physics
        self._command = random_state.uniform(*self._ranges.T)


def _range(name: str, pair: Range) -> Range:
    try:
        low, high = pair
    except (TypeError, ValueError):
        raise TypeError(f"{name} should be two numbers (low, high), got {pair!r}") from None
    low, high = (check_number(f"{name}[{i}]", number) for i, number in enumerate((low, high)))
    if low > high:
        raise ValueError(f"{name} should not fall from low to high, got {pair!r}")
    return low, high
