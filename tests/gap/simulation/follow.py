"""A composer task that plays a log's targets to a walker, physics step by physics step."""

from __future__ import annotations

from dm_control import composer

from walkerkit.actuators import ActuatorCmd


class Follow(composer.Task):
    """Starts where a log does, and sends its targets."""

    def __init__(self, walker, targets, step):
        self._arena = composer.Arena()
        # dm_control's own arenas solve friction once more after each step.
        self._arena.mjcf_model.option.remove()
        self._arena.attach(walker)
        self._walker, self._targets, self._row = walker, targets, 0
        self.set_timesteps(step, step)

    @property
    def root_entity(self):
        return self._arena

    def initialize_episode(self, physics, random_state):
        joints = physics.bind(self._walker.observable_joints)
        joints.qpos, joints.qvel, self._row = self._targets[0], 0.0, 0

    def before_step(self, physics, action, random_state):
        self._walker.command = ActuatorCmd(position_target=self._targets[self._row])
        self._row += 1

    def get_reward(self, physics):
        return 0.0
