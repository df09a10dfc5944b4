"""A walker on its feet, until it falls."""

from __future__ import annotations

import abc
from collections.abc import Mapping, Sequence
from typing import Any

import mujoco
import numpy as np
from dm_control import mjcf
from dm_env import specs
from numpy.typing import ArrayLike, NDArray

from walkerkit.tasks.falls import FallDetector, FallLimits, Ground
from walkerkit.tasks.rewards import low_effort, upright
from walkerkit.tasks.trunk import Trunk
from walkerkit.tasks.walker_task import WalkerTask
from walkerkit.walkers.drivetrain import Randomization

FloatArray = NDArray[np.float64]

_OBSERVABLES = (
    "joints_pos",
    "joints_vel",
    "world_zaxis",
    "sensors_gyro",
    "sensors_accelerometer",
    "sensors_velocimeter",
    "prev_action",
)


class UprightTask(WalkerTask):
    """Starts an episode on the ground in the home pose and ends it, with discount 0, on a fall.

    Args:
        walker: as in `WalkerTask`; it floats.
        arena: as in `WalkerTask`, with `ground_geoms`.
        physics_timestep: as in `WalkerTask`.
        control_timestep: as in `WalkerTask`.
        randomizations: as in `WalkerTask`.
        weights: as in `WalkerTask`.
        default_weights: as in `WalkerTask`.
        fall: what counts as a fall.
        joint_noise: joints start within this of home, drawn uniformly [rad; m].

    Raises:
        ValueError: the walker does not float, the noise is negative, or as `WalkerTask`.
    """

    def __init__(
        self,
        walker: Any,
        arena: Any,
        *,
        physics_timestep: float | None,
        control_timestep: float,
        randomizations: Sequence[Randomization],
        weights: Mapping[str, float] | None,
        default_weights: Mapping[str, float],
        fall: FallLimits,
        joint_noise: float,
    ):
        super().__init__(
            walker,
            arena,
            physics_timestep=physics_timestep,
            control_timestep=control_timestep,
            randomizations=randomizations,
            weights=weights,
            default_weights=default_weights,
            observables=_OBSERVABLES,
        )
        if mjcf.get_frame_freejoint(walker.mjcf_model) is None:
            raise ValueError(
                f"the walker {walker.mjcf_model.model!r} has a fixed base, so it can neither stand "
                "nor walk: give it a free joint (floating=True), or use TrackJoints"
            )
        if not (np.isfinite(joint_noise) and joint_noise >= 0):
            raise ValueError(f"joint_noise is {joint_noise} rad; it should be at least 0")
        self._joint_noise = joint_noise
        self._trunk = Trunk(walker)
        self._ground = Ground(walker, self._arena)
        self._falls = FallDetector(fall, self._trunk, self._ground)
        self._fallen: tuple[str, ...] = ()
        self._previous_action: FloatArray = np.zeros(walker.action_spec.shape)
        self._home: FloatArray = np.zeros(0)
        self._positions_at: NDArray[np.intp] = np.zeros(0, dtype=np.intp)

    @abc.abstractmethod
    def _begin(self, physics: Any, random_state: Any) -> None:
        """Draws what a task draws for an episode."""

    # What composer calls.

    def after_compile(self, physics: Any, random_state: Any) -> None:
        """Finds bodies and geoms in the compiled model."""
        del random_state
        self._trunk.after_compile(physics)
        self._ground.after_compile(physics)
        joints = physics.bind(self._walker.observable_joints).element_id
        self._positions_at = physics.model.jnt_qposadr[joints].astype(np.intp)

    def initialize_episode(self, physics: Any, random_state: Any) -> None:
        """Puts the walker on the ground in its home pose, and forgets the last episode."""
        self._walker.reinitialize_pose(physics, random_state)
        joints = physics.bind(self._walker.observable_joints)
        self._home = np.array(joints.qpos)
        noise = random_state.uniform(-self._joint_noise, self._joint_noise, self._home.shape)
        low, high = np.where(np.atleast_2d(joints.limited).T, joints.range, [-np.inf, np.inf]).T
        joints.qpos = np.clip(self._home + noise, low, high)
        mujoco.mj_kinematics(physics.model.ptr, physics.data.ptr)
        self._walker.shift_pose(physics, position=[0.0, 0.0, -self._ground.clearance(physics)])
        mujoco.mj_kinematics(physics.model.ptr, physics.data.ptr)
        self._trunk.begin(physics)
        self._fallen = ()
        self._previous_action = np.zeros(self._walker.action_spec.shape)
        self._randomize(random_state)
        self._begin(physics, random_state)

    def action_spec(self, physics: Any) -> specs.BoundedArray:
        """The walker's, whatever MuJoCo's controls are."""
        del physics
        return self._walker.action_spec

    def before_step(self, physics: Any, action: ArrayLike, random_state: Any) -> None:
        """Gives the action to the walker."""
        self._previous_action = self._walker.prev_action
        self._walker.apply_action(physics, action, random_state)

    def after_step(self, physics: Any, random_state: Any) -> None:
        """Looks whether the walker fell."""
        del random_state
        self._fallen = tuple(self._falls.reasons(physics))

    def should_terminate_episode(self, physics: Any) -> bool:
        """The walker has fallen."""
        del physics
        return bool(self._fallen)

    def get_discount(self, physics: Any) -> float:
        """0 when the walker has fallen, else 1."""
        del physics
        return 0.0 if self._fallen else 1.0

    # What tasks and users ask.

    @property
    def fallen(self) -> tuple[str, ...]:
        """Why the walker counts as fallen: `tilt`, `height`, `contact`; empty while it stands."""
        return self._fallen

    @property
    def fall_limits(self) -> FallLimits:
        """What counts as a fall."""
        return self._falls.limits

    @property
    def trunk(self) -> Trunk:
        """How the root body is held and moves."""
        return self._trunk

    @property
    def ground(self) -> Ground:
        """What the walker has to do with the ground."""
        return self._ground

    @property
    def home_pose(self) -> FloatArray:
        """Positions of the observed joints at home [rad; m], (n_joints,), a copy."""
        return self._home.copy()

    @property
    def positions_at(self) -> NDArray[np.intp]:
        """Places of these in `qpos`, (n_joints,), a copy."""
        return self._positions_at.copy()

    def _pose_error(self, physics: Any) -> FloatArray:
        """How far the joints are from home [rad; m]."""
        return np.asarray(physics.data.qpos[self._positions_at] - self._home)

    def _upright(self, physics: Any) -> float:
        return upright(self._trunk.cos_tilt(physics))

    def _low_effort(self) -> float:
        drivetrain = self._walker.drivetrain
        return low_effort(drivetrain.group.applied_effort, drivetrain.joints.efforts)
